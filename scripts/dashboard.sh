#!/usr/bin/env bash
# Localises in the rendered street of the demo and records what was believed, for the rerun viewer.
# Needs Rust and a C compiler (installed through apt-get where missing), no data, no OpenCV, no
# viewer.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/system_packages.sh

out=target/dashboard
need_rust
need_c_compiler

say "building the evaluation (release)"
cargo build --release --locked -p chronotope-eval

say "building the dashboard (rerun: about ten minutes of processor time, once)"
cargo build --locked --manifest-path crates/dashboard/Cargo.toml

say "learning, localising and recording"
mkdir -p "$out"
"${CARGO_TARGET_DIR:-target}/release/chronotope-eval" replay synthetic \
    --trace "$out/synthetic.jsonl" </dev/null
"${CARGO_TARGET_DIR:-crates/dashboard/target}/debug/chronotope-dashboard" "$out/synthetic.jsonl" \
    --save "$out/synthetic.rrd"
[ -s "$out/synthetic.rrd" ] || fail "$out/synthetic.rrd was not written"

say "done"
cat <<END
The recording: $PWD/$out/synthetic.rrd
To open it:    pip install rerun-sdk==0.36.3 && rerun $out/synthetic.rrd
A live robot:  chronotope localize MAP --camera 0 --trace - |
                   crates/dashboard/target/debug/chronotope-dashboard --connect
Pictures of it without a screen: make screenshots
END
