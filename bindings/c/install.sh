#!/usr/bin/env bash
# Installs the C library that was built: install.sh PREFIX [TARGET_FOLDER/PROFILE]
#
#   cargo build --locked --release --manifest-path bindings/c/Cargo.toml
#   bash bindings/c/install.sh /usr/local bindings/target/release
set -euo pipefail
prefix=${1:?name the folder to install to}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
built=${2:-$here/../target/release}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../Cargo.toml" | head -1)
mkdir -p "$prefix/lib/pkgconfig" "$prefix/include"
prefix=$(cd "$prefix" && pwd)
install -m 755 "$built/libchronotope.so" "$prefix/lib/libchronotope.so.$version"
ln -sf "libchronotope.so.$version" "$prefix/lib/libchronotope.so.1"
ln -sf libchronotope.so.1 "$prefix/lib/libchronotope.so"
install -m 644 "$built/libchronotope.a" "$prefix/lib/"
install -m 644 "$here/include/chronotope.h" "$here/include/chronotope.hpp" "$prefix/include/"
sed "s|@PREFIX@|$prefix|; s|@VERSION@|$version|" "$here/chronotope.pc.in" \
    >"$prefix/lib/pkgconfig/chronotope.pc"
