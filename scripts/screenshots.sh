#!/usr/bin/env bash
# Opens recordings in the real viewer without a screen and saves pictures of both pages in docs/.
#
# Usage: scripts/screenshots.sh [DATA_DIR]
# The rendered street always; stromovka-loo and lasvegas if DATA_DIR (or CHRONOTOPE_DATA) has them. The
# viewer comes from PyPI into target/dashboard/viewer, a software Vulkan from apt-get where none is there.
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
cargo build --locked --manifest-path crates/dashboard/Cargo.toml --target-dir "$out/build"
dashboard=$out/build/debug/chronotope-dashboard
eval_command=${CARGO_TARGET_DIR:-target}/release/chronotope-eval

# photograph RECORDING PICTURE: about ten seconds with software rendering.
photograph() {
    local raw=$out/raw.png
    rm -f "$raw"
    timeout 180 "$viewer/bin/rerun" "$1" --headless --bind 127.0.0.1 --window-size 1600x1000 \
        --screenshot-to "$raw" </dev/null || fail "the viewer gave no picture of $1"
    [ -s "$raw" ] || fail "the viewer gave no picture of $1"
    "$viewer/bin/python" - "$raw" "$2" "$max_bytes" <<'PYTHON'
import os, sys
from PIL import Image

raw, picture, max_bytes = sys.argv[1], sys.argv[2], int(sys.argv[3])
for num_colours in (256, 128, 64, 32):
    Image.open(raw).convert("RGB").quantize(num_colours, dither=Image.Dither.NONE).save(picture, optimize=True)
    if os.path.getsize(picture) < max_bytes:
        break
else:
    sys.exit(f"{picture} has {os.path.getsize(picture)} bytes, more than {max_bytes}")
PYTHON
    echo "$2: $(stat -c %s "$2") bytes"
}

# show SUITE NAME [ARGUMENTS OF chronotope-eval run]: one picture of each page.
show() {
    local suite=$1 name=$2
    shift 2
    say "$suite"
    if [ ! -s "$out/$name.jsonl" ]; then
        "$eval_command" run "$suite" "$@" --out "$out" --trace "$out/$name.part" </dev/null
        mv "$out/$name.part" "$out/$name.jsonl"
    fi
    "$dashboard" "$out/$name.jsonl" --save "$out/$name.rrd"
    photograph "$out/$name.rrd" "docs/dashboard-$name.png"
    "$dashboard" "$out/$name.jsonl" --save "$out/$name-why.rrd" --why
    photograph "$out/$name-why.rrd" "docs/dashboard-$name-why.png"
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
