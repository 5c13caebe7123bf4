#!/usr/bin/env bash
# Learns a rendered year at eight look-alike places and localises images of the next one with every
# method. Needs Rust and a C compiler (installed through apt-get where missing), no data, no OpenCV.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/system_packages.sh

out=target/demo
need_rust
need_c_compiler

say "building (release)"
cargo build --release --locked -p chronotope-eval

# Eight of the suite's thirty worlds: a few minutes on two cores.
say "learning and localising"
"${CARGO_TARGET_DIR:-target}/release/chronotope-eval" run synthetic --worlds 8 --out "$out" </dev/null
[ -s "$out/report.html" ] || fail "$out/report.html was not written"

say "done"
echo "The report, with plots and pictures: $PWD/$out/report.html"
