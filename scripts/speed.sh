#!/bin/sh
# One table of speeds: ours, OpenCV, hnsw_rs and, where they can be installed, FAISS and OctoMap, in one run.
#
# Usage: scripts/speed.sh [ARGUMENTS OF chronotope-eval speed]
# Builds in release mode and installs OpenCV (with contrib) and FAISS from PyPI in a throw-away environment;
# without a network or Python the command runs without them and says so in its table.
set -u
cd "$(dirname "$0")/.." || exit 2

wheels='opencv-contrib-python-headless==5.0.0.93 faiss-cpu'

say() { echo "speed: $1" >&2; }

python=
environment=$(mktemp -d) || exit 2
trap 'rm -rf "$environment"' EXIT
trap 'exit 2' INT TERM
if command -v python3 >/dev/null && python3 -m venv "$environment" >&2; then
    say "installing $wheels"
    # shellcheck disable=SC2086 # two words
    if "$environment/bin/pip" install --quiet --disable-pip-version-check $wheels >&2; then
        python=$environment/bin/python
    else
        say "pip could not install them: going on without"
    fi
else
    say "no python3 with venv: going on without OpenCV's extraction and FAISS"
fi

features=
if pkg-config --exists opencv4 2>/dev/null; then
    features='--features opencv'
else
    say "no OpenCV library: going on without its BFMatcher (apt-get install libopencv-dev clang libclang-dev)"
fi
# shellcheck disable=SC2086 # none or two words
cargo build --release --locked -p chronotope-eval $features || exit 2
target=${CARGO_TARGET_DIR:-target}
"$target/release/chronotope-eval" speed ${python:+--python "$python"} "$@" || exit

# Grids: OctoMap takes in the same frames.
if command -v g++ >/dev/null && printf '#include <octomap/octomap.h>\n' | g++ -fsyntax-only -x c++ - 2>/dev/null; then
    if g++ -O2 scripts/octomap_rate.cpp -o "$environment/octomap_rate" -loctomap -loctomath; then
        "$environment/octomap_rate"
    fi
else
    say "no OctoMap: its rate is not measured (apt-get install liboctomap-dev g++)"
fi
