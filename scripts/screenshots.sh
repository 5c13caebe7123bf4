#!/usr/bin/env bash
# Opens recordings in the real viewer without a screen and saves pictures of both pages in docs/.
#
# Usage: scripts/screenshots.sh [DATA_DIR]
# The rendered street always; stromovka-loo and lasvegas if DATA_DIR (or CHRONOTOPE_DATA) has them.
# The viewer comes from PyPI into target/dashboard/viewer, a software Vulkan from apt-get where none
# is there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/system_packages.sh

data=${1:-${CHRONOTOPE_DATA:-}}
out=target/dashboard
viewer=$out/viewer
max_bytes=300000

need_rust
need_c_compiler
command -v python3 >/dev/null || install_packages python3 python3-venv
if ! compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || ! ldconfig -p | grep -q libvulkan.so.1; then
    install_packages mesa-vulkan-drivers libvulkan1
fi

say "the viewer"
if [ ! -x "$viewer/bin/rerun" ]; then
    python3 -m venv "$viewer" || fail "python3 cannot make a virtual environment (apt-get install python3-venv)"
    "$viewer/bin/pip" install --quiet --disable-pip-version-check rerun-sdk==0.36.3 pillow ||
        fail "pip could not install rerun-sdk==0.36.3: is there a network, and a wheel for this machine?"
fi
"$viewer/bin/rerun" analytics disable </dev/null

say "building"
cargo build --release --locked -p chronotope-eval
cargo build --locked --manifest-path crates/dashboard/Cargo.toml
dashboard=${CARGO_TARGET_DIR:-crates/dashboard/target}/debug/chronotope-dashboard
eval_command=${CARGO_TARGET_DIR:-target}/release/chronotope-eval

photograph() {
    "$viewer/bin/python" scripts/photograph.py "$viewer/bin/rerun" "$1" "$2" "$max_bytes"
}

# show SUITE NAME [ARGUMENTS OF chronotope-eval replay]: one picture of each page.
show() {
    local suite=$1 name=$2
    shift 2
    say "$suite"
    "$eval_command" replay "$suite" "$@" --cache "$out/cache" --trace "$out/$name.jsonl" </dev/null
    "$dashboard" "$out/$name.jsonl" --save "$out/$name.rrd"
    photograph "$out/$name.rrd" "docs/dashboard-$name.webp"
    "$dashboard" "$out/$name.jsonl" --save "$out/$name-why.rrd" --why
    photograph "$out/$name-why.rrd" "docs/dashboard-$name-why.webp"
}

mkdir -p "$out" docs
show synthetic synthetic
for suite in stromovka-loo lasvegas; do
    if [ -n "$data" ] && [ -d "$data/${suite%%-*}" ]; then
        show "$suite" "${suite%%-*}" --data "$data"
    else
        say "$suite is left out: name the folder of its dataset with DATA=DIR"
    fi
done
