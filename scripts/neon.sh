#!/bin/sh
# The NEON kernel against its scalar twin, bit for bit: on ARM as it is, elsewhere under qemu.
#
# Usage: scripts/neon.sh
# Needs `rustup target add aarch64-unknown-linux-musl` and, not on ARM, qemu's user emulation (Debian's
# qemu-user-static). Compiles src/simd alone, so that no C compiler for ARM is needed.
set -eu
cd "$(dirname "$0")/.." || exit 2

folder=${CARGO_TARGET_DIR:-$PWD/target}/neon
mkdir -p "$folder"
cat >"$folder/Cargo.toml" <<EOF
[package]
name = "neon"
version = "0.0.0"
edition = "2024"
publish = false
[workspace]
[lib]
path = "$PWD/tests/neon/lib.rs"
[dependencies]
fremen = { path = "$PWD/crates/fremen" }
[dev-dependencies]
proptest = { version = "1.12", default-features = false, features = ["std"] }
EOF
if [ "$(uname -m)" != aarch64 ]; then
    qemu=$(command -v qemu-aarch64-static || command -v qemu-aarch64) || {
        echo "neon: no qemu-aarch64: apt-get install qemu-user-static" >&2
        exit 2
    }
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_RUNNER="$qemu"
fi
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_LINKER=rust-lld
exec cargo test --release --manifest-path "$folder/Cargo.toml" --target-dir "$folder/target" \
    --target aarch64-unknown-linux-musl
