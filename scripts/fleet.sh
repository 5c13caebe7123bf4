#!/usr/bin/env bash
# Learns what a made-up fleet has observed on a Spark cluster of two worker processes, in one process, and with
# pandas; compares the first two byte for byte, and prints a table of times and memory.
# Needs Rust, a C compiler, python3 and Java 17 (the last two installed through apt-get where missing); PySpark
# and the rest come from PyPI into a throw-away environment.
# `scripts/fleet.sh tests` runs the tests of chronotope.spark alone, with a small fleet.
# CHRONOTOPE_WHEEL names a wheel that is built already; CHRONOTOPE_FLEET_VISITS visits of each of 100 places with
# 200 features are made, 2500 by default: 50 million observations.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/system_packages.sh

what=${1:-all}
num_visits=${CHRONOTOPE_FLEET_VISITS:-2500}
[ "$what" = all ] || num_visits=${CHRONOTOPE_FLEET_VISITS:-50}
package=bindings/python
need_rust
need_c_compiler
need_python
need_java

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export CHRONOTOPE_LOG=warn

say "fleet: one process in Rust"
cargo build --locked --release -p chronotope-fleet --example fleet
fleet=$(realpath "${CARGO_TARGET_DIR:-target}")/release/examples/fleet

say "fleet: an environment with PySpark"
python3 -m venv "$work/venv"
python=$work/venv/bin/python
"$python" -m pip install --quiet --disable-pip-version-check 'pyspark[sql]>=4,<5' pytest 'maturin>=1.16,<2'
wheel=${CHRONOTOPE_WHEEL:-}
if [ -z "$wheel" ]; then
    say "fleet: the wheel"
    (cd $package && "$work/venv/bin/maturin" build --quiet --release --locked --interpreter "$python" \
        --out "$work/wheels")
    wheel=$(ls "$work"/wheels/*.whl)
fi
"$python" -m pip install --quiet --disable-pip-version-check --no-deps "$wheel"
# Workers run the same Python as the driver.
export PYSPARK_PYTHON=$python PYSPARK_DRIVER_PYTHON=$python

if [ "$what" != table ]; then
    say "fleet: tests on a cluster of two processes"
    (cd $package && "$python" -m pytest --quiet -p no:cacheprovider tests/test_spark.py)
fi

say "fleet: 100 places, 200 features, $num_visits visits"
"$fleet" make "$work/even" 100 200 "$num_visits"
"$fleet" make "$work/skewed" 100 200 "$num_visits" skewed
du -sh "$work/even" "$work/skewed"

# run NAME COMMAND...: keeps what the command prints, a line of JSON.
run() {
    local name=$1
    shift
    say "fleet: $name"
    "$@" 2>"$work/stderr" | tee -a "$work/$name.json" || { tail -40 "$work/stderr" >&2; exit 1; }
}
for fleet_of in even skewed; do
    run "rust-1-$fleet_of" "$fleet" learn "$work/rust-1-$fleet_of" 1 "$work/$fleet_of"
    run "rust-2-$fleet_of" "$fleet" learn "$work/rust-2-$fleet_of" 2 "$work/$fleet_of"
    run "spark-2-$fleet_of" "$python" $package/examples/fleet.py spark \
        "$work/$fleet_of" "$work/spark-2-$fleet_of" --workers 2
done
run "spark-1-even" "$python" $package/examples/fleet.py spark "$work/even" "$work/spark-1-even" --workers 1
if [ "$what" = all ]; then
    run "pandas-even" "$python" $package/examples/fleet.py pandas "$work/even"
fi

say "fleet: are the models of Spark those of one process?"
"$fleet" same "$work/rust-1-even" "$work/spark-2-even"
"$fleet" same "$work/rust-1-even" "$work/spark-1-even"
"$fleet" same "$work/rust-1-even" "$work/rust-2-even"
"$fleet" same "$work/rust-1-skewed" "$work/spark-2-skewed"

say "fleet: the table"
"$python" - "$work" <<'PYTHON'
import json, pathlib, sys

print(f"{'':<14} {'rows':>11} {'seconds':>8} {'million rows/s':>15} {'peak MB':>8}")
for path in sorted(pathlib.Path(sys.argv[1]).glob("*.json")):
    it = json.loads(path.read_text().splitlines()[-1])
    rate = it["rows"] / it["total_s"] / 1e6
    print(f"{path.stem:<14} {it['rows']:>11} {it['total_s']:>8.1f} {rate:>15.1f} {it['peak_mb']:>8.0f}")
PYTHON
