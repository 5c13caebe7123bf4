#!/bin/sh
# Compares our STAR + BRIEF with OpenCV's on every image below a folder.
#
# Usage: scripts/parity.sh DATA_DIR
# Builds our side in release mode and installs OpenCV (with contrib, from PyPI) in a throw-away
# environment. Exit code: 0 equal, 1 something differs or cannot be read, 2 the comparison could not be made.
set -u

wheel='opencv-contrib-python-headless==5.0.0.93'

fail() {
    echo "parity: $1" >&2
    exit 2
}

[ $# -eq 1 ] || fail "usage: scripts/parity.sh DATA_DIR"
[ -d "$1" ] || fail "$1 is not a folder"
data=$(cd "$1" && pwd) || fail "$1 cannot be entered"
cd "$(dirname "$0")/.." || exit 2

command -v python3 >/dev/null || fail "python3 is needed for OpenCV's side (apt-get install python3 python3-venv)"
environment=$(mktemp -d) || fail "no temporary folder"
trap 'rm -rf "$environment"' EXIT
trap 'exit 2' INT TERM
python3 -m venv "$environment" >&2 || fail "python3 cannot make a virtual environment (apt-get install python3-venv)"
echo "parity: installing $wheel" >&2
"$environment/bin/pip" install --quiet --disable-pip-version-check "$wheel" >&2 ||
    fail "pip could not install $wheel: is there a network, and a wheel for this machine?"

cargo build --release --example dump_features || fail "our side does not build"
target=${CARGO_TARGET_DIR:-target}
"$environment/bin/python" scripts/parity.py "$data" "$target/release/examples/dump_features"
