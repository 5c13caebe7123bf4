#!/usr/bin/env bash
# Everything that CI runs. One profile and one set of features for all tests, so that dependencies are
# compiled once: `dev` with the feature `opencv`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/system_packages.sh

need_rust
need_c_compiler
need_opencv
# All now: two installations at a time exclude each other.
need_python
need_robot_tools
want_browser

log=${CARGO_TARGET_DIR:-target}/test.log
mkdir -p "$(dirname "$log")"
# Tests that could not do what they are there for (no rights, no strace) say so here.
CHRONOTOPE_SKIPS=$(realpath "$(dirname "$log")")/test.skips
export CHRONOTOPE_SKIPS
: >"$CHRONOTOPE_SKIPS"

# Kernels that this processor can run beside its best one, which all tests use (src/simd finds them out);
# the name is that of CHRONOTOPE_KERNEL.
other_kernels() {
    case $(uname -m) in
    x86_64)
        grep -qw avx2 /proc/cpuinfo && echo scalar
        grep -qw avx512f /proc/cpuinfo && grep -qw avx512_vpopcntdq /proc/cpuinfo && echo avx2
        ;;
    aarch64) echo scalar ;;
    esac
    true
}

say "scripts"
for script in .ci/run scripts/*.sh; do
    bash -n "$script"
    [ -x "$script" ] || fail "$script cannot be run by its name (help: chmod +x)"
done

say "cargo fmt"
for workspace in . bindings bindings/python crates/dashboard; do
    cargo fmt --manifest-path "$workspace/Cargo.toml" --all --check
done

# Much of what follows waits, or keeps one processor busy. With what it leaves of the processors bindings and
# dashboard are built, in a folder of their own, since cargo builds one thing at a time in a folder. The three
# workspaces share there what they have in common (.cargo/config.toml).
say "bindings and dashboard: built beside all that follows"
beside=${CARGO_TARGET_DIR:-target}/beside
mkdir -p "$beside"
beside=$(realpath "$beside")
export beside
rm -rf "$beside/python"
# A process group of its own, so that nothing of it outlives this script; not a session, within which alone
# `nice` counts on many systems.
set -m
CARGO_TARGET_DIR=$beside nice -n 19 bash -ec '
    # First and whole: its tests take one processor for minutes, while the dashboard is built.
    PROFILE=dev bash scripts/python.sh build "$beside/python"
    touch "$beside/python/is-built"
    cargo test --locked --no-run --manifest-path bindings/Cargo.toml --workspace
    bash scripts/robots.sh tools
    cargo test --locked --no-run --manifest-path crates/dashboard/Cargo.toml
' </dev/null >"$beside.log" 2>&1 &
building=$!
set +m
trap 'kill -- "-$building" 2>/dev/null || true' EXIT

say "clippy: workspace with opencv"
cargo clippy --locked --workspace --all-targets --features opencv,parquet,onnx -- -D warnings

say "feature matrix: without default features, each of them alone, default"
for features in "" dataset trace hnsw onnx; do
    cargo clippy --locked -p chronotope --lib --no-default-features --features "$features" -- -D warnings
done
cargo clippy --locked -p chronotope --lib -- -D warnings
cargo clippy --locked -p chronotope --lib --no-default-features --features opencv -- -D warnings
cargo clippy --locked -p chronotope-fleet --lib --no-default-features -- -D warnings
cargo clippy --locked -p chronotope-cli --all-targets -- -D warnings

say "rustdoc"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps --lib --features opencv,parquet,onnx

say "packages: what would be published"
for package in fremen chronotope-store fremen-grid fremen-explore chronotope-fleet chronotope chronotope-cli; do
    cargo package --locked --allow-dirty --list -p "$package" >/dev/null
done

# Licences, sources and duplicates of all dependencies (deny.toml); advisories need the network.
if cargo deny --version >/dev/null 2>&1; then
    say "cargo deny"
    cargo deny --offline --all-features check bans licenses sources
else
    say "cargo deny: skipped (cargo install --locked cargo-deny)"
fi

say "tests: workspace with opencv; their build"
cargo test --locked --workspace --features opencv,parquet,onnx --no-run

say "tests: workspace with opencv, and doctests"
cargo test --locked --workspace --features opencv,parquet,onnx </dev/null 2>&1 | tee "$log"

# The engine's own: the command and the evaluation call the same kernels.
engine_tests=$(cargo test --locked --workspace --features opencv,parquet,onnx --lib --test it \
    --no-run --message-format json 2>/dev/null |
    sed -n "s|.*\"manifest_path\":\"$(pwd -P)/Cargo.toml\".*\"executable\":\"\([^\"]*\)\".*|\1|p")
[ "$(wc -l <<<"$engine_tests")" = 2 ] || fail "unit tests and tests/it are expected, not $engine_tests"
for kernel in $(other_kernels); do
    say "tests of matching and localising with kernel $kernel"
    while read -r tests; do
        CHRONOTOPE_KERNEL=$kernel "$tests" simd matching localize learn </dev/null
    done <<<"$engine_tests"
done

# The same command as above, whose answers the package has to give bit for bit.
CHRONOTOPE_COMMAND=$(realpath "${CARGO_TARGET_DIR:-target}/debug/chronotope")
export CHRONOTOPE_COMMAND
say "python"
until [ -e "$beside/python/is-built" ]; do
    kill -0 "$building" 2>/dev/null || { cat "$beside.log"; fail "the Python package cannot be built"; }
    sleep 1
done
bash scripts/python.sh check "$beside/python"
rm -rf "$beside/python"

say "bindings and dashboard: the rest of their build"
wait "$building" || { cat "$beside.log"; fail "bindings or dashboard cannot be built"; }

# Maps from bags are compared with those of the same command. Nodes answer within times: nothing else runs.
say "robots"
CARGO_TARGET_DIR=$beside bash scripts/robots.sh

# No release and no clippy, which would go through 400 crates a second time.
say "dashboard: tests, the evaluation that records"
CARGO_TARGET_DIR=$beside cargo test --locked --manifest-path crates/dashboard/Cargo.toml </dev/null

say "done"
# tests/it/architecture.rs sees to it that tests on real data, and no others, have such names.
num_real=$(grep -cE '^test (.*::)?real_data_.* \.\.\. ok$' "$log" || true)
if [ -s "$CHRONOTOPE_SKIPS" ]; then
    echo "skipped: $(wc -l <"$CHRONOTOPE_SKIPS") tests that passed did nothing:"
    sort "$CHRONOTOPE_SKIPS" | uniq -c
fi
command -v chromium chromium-browser google-chrome >/dev/null ||
    echo "browser: skipped, the report was opened in none"
if [ -n "${CHRONOTOPE_DATA:-}" ]; then
    echo "real data: $num_real tests ran on $CHRONOTOPE_DATA"
else
    echo "real data: 0 tests ran, $num_real skipped; CHRONOTOPE_DATA=DIR make test runs them"
fi
