#!/usr/bin/env bash
# Builds the Python package in a throw-away environment and tests it: the wheel, `pip install .`, the
# committed stub, types, docstrings, tests, notebooks. Needs Rust, a C compiler and python3 (with venv,
# installed through apt-get where missing); everything else comes from PyPI into the environment.
# CHRONOTOPE_COMMAND names the command that answers are compared with; it is built otherwise.
# CHRONOTOPE_DATA adds the tests on real data. PROFILE=dev builds what `make test` builds, in less time than what
# users get (release).
# `scripts/python.sh build DIR` and then `scripts/python.sh check DIR` do the same in two parts.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/system_packages.sh

package=bindings/python
profile=${PROFILE:-release}
need_rust
need_c_compiler
need_python

part=${1:-all}
if [ "$part" = all ]; then
    environment=$(mktemp -d)
    trap 'rm -rf "$environment"' EXIT
else
    mkdir -p "$2"
    environment=$(realpath "$2")
fi
python=$environment/build/bin/python

if [ "$part" != check ]; then
    say "python: an environment with what is needed to build and to test"
    python3 -m venv "$environment/build"
    "$python" -m pip install --quiet --disable-pip-version-check -r $package/requirements-test.txt

    say "python: fmt"
    cargo fmt --manifest-path $package/Cargo.toml --all --check

    say "python: the wheel"
    maturin=$environment/build/bin/maturin
    (cd $package && "$maturin" build --quiet --profile "$profile" --locked --interpreter "$python" \
        --out "$environment/wheels")
    wheel=$(ls "$environment"/wheels/*.whl)
    num_bytes=$(stat -c %s "$wheel")
    echo "$(basename "$wheel"): $num_bytes bytes"
    [ "$profile" != release ] || [ "$num_bytes" -le 8000000 ] || fail "the wheel is larger than 8 MB"
    "$python" -m pip install --quiet --disable-pip-version-check --no-deps "$wheel"

    # `generate-stubs` in pyproject.toml has no effect (maturin 1.16), so the stub is committed.
    say "python: the committed stub is the generated one"
    (cd $package && "$maturin" generate-stubs --quiet --profile "$profile" --locked --interpreter "$python" \
        --out "$environment/stubs")
    stub=$(find "$environment/stubs" -name '*.pyi')
    diff "$stub" $package/python/chronotope/_chronotope.pyi ||
        fail "commit what 'maturin generate-stubs' writes as $package/python/chronotope/_chronotope.pyi"

    say "python: pip install . in a fresh environment, with numpy and nothing else"
    python3 -m venv "$environment/fresh"
    MATURIN_PEP517_ARGS="--profile $profile" "$environment/fresh/bin/python" -m pip install --quiet \
        --disable-pip-version-check ./$package
    (cd "$environment" && fresh/bin/python -c 'import chronotope; print(repr(chronotope.Street(num_places=1)))')
    "$environment/fresh/bin/python" -m pip list --disable-pip-version-check --format freeze
fi
[ "$part" != build ] || exit 0

if [ -z "${CHRONOTOPE_COMMAND:-}" ]; then
    say "python: the command to compare with"
    cargo build --locked -p chronotope-cli
    CHRONOTOPE_COMMAND=$(realpath "${CARGO_TARGET_DIR:-target}/debug/chronotope")
fi
export CHRONOTOPE_COMMAND

say "python: types"
(cd $package && "$python" -m mypy examples python/chronotope)
(cd "$environment" && "$python" -m mypy.stubtest chronotope \
    --mypy-config-file "$OLDPWD/$package/pyproject.toml" \
    --ignore-unused-allowlist --allowlist <(echo chronotope.spark)) # it needs PySpark: scripts/fleet.sh

say "python: tests"
(cd $package && "$python" -m pytest --quiet -p no:cacheprovider)

say "python: notebooks"
"$python" $package/notebooks/run.py --out "$environment/notebooks"

say "python: done"
