# Sourced by the other scripts: installs Debian and Ubuntu packages, and says so.

# The words of the arguments, in bold on a terminal, and the seconds since the script began.
say() {
    if [ -t 1 ]; then
        printf '\n\033[1m== %s\033[0m (%s s)\n' "$*" "$SECONDS"
    else
        printf '\n== %s (%s s)\n' "$*" "$SECONDS"
    fi
}

fail() {
    echo "error: $*" >&2
    exit 2
}

# install_packages PACKAGE...: through apt-get, as root or with sudo.
install_packages() {
    command -v apt-get >/dev/null ||
        fail "this needs $* (names of Debian packages), and there is no apt-get to install them with"
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || fail "this needs $*; run as root: apt-get install $*"
        as_root=(sudo)
    fi
    say "installing $* (apt-get, as root${as_root[*]:+ with sudo})"
    "${as_root[@]}" apt-get update -q </dev/null
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -q -y --no-install-recommends "$@" </dev/null
}

# A linker for Rust, and a compiler and headers for the bundled SQLite.
need_c_compiler() {
    local folder works=no
    folder=$(mktemp -d)
    if command -v cc >/dev/null && printf '#include <stdio.h>\nint main(void) { return 0; }\n' |
        cc -x c - -o "$folder/program" 2>/dev/null; then
        works=yes
    fi
    rm -r "$folder"
    [ "$works" = yes ] || install_packages gcc libc6-dev
}

# OpenCV and libclang, from which the crate `opencv` makes its bindings.
need_opencv() {
    local package missing=()
    if command -v dpkg-query >/dev/null; then
        for package in libopencv-dev clang libclang-dev; do
            [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] ||
                missing+=("$package")
        done
    elif ! { command -v clang && pkg-config --exists opencv4; } >/dev/null 2>&1; then
        fail "this needs OpenCV 4 with its headers, clang and libclang, found by pkg-config"
    fi
    [ ${#missing[@]} -eq 0 ] || install_packages "${missing[@]}"
}

# A browser for the test of the report. Without one the test says that it is skipped: some systems have no
# package of that name, or nobody there may install it.
want_browser() {
    local name
    for name in chromium chromium-browser google-chrome; do
        if command -v "$name" >/dev/null; then return; fi
    done
    (install_packages chromium) ||
        say "no Chromium could be installed: the test that opens the report in a browser is skipped"
}

# A C++ compiler; and, without which something is skipped, what the examples in C are built and watched with.
need_robot_tools() {
    local tool missing=()
    command -v c++ >/dev/null || install_packages g++
    for tool in cmake pkg-config valgrind; do
        command -v "$tool" >/dev/null || missing+=("$tool")
    done
    [ ${#missing[@]} -eq 0 ] || (install_packages "${missing[@]}") ||
        say "${missing[*]} could not be installed: some checks of the C library are skipped"
}

# Python 3.10 or later that can make environments: Debian keeps `venv` in a package of its own.
need_python() {
    if ! python3 -c 'import ensurepip, venv' >/dev/null 2>&1; then install_packages python3 python3-venv; fi
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' ||
        fail "this needs Python 3.10 or later, and python3 is $(python3 --version)"
}

# Java 17 or later, without a screen, for Spark.
need_java() {
    if java -version >/dev/null 2>&1; then return; fi
    install_packages openjdk-17-jre-headless
}

need_rust() {
    command -v cargo >/dev/null ||
        fail "there is no cargo on the PATH; https://rustup.rs installs Rust"
}
