#!/usr/bin/env bash
# Feeds made-up bytes to everything that reads what comes from outside, and says how much of the code they reach.
#
# Usage: [SECONDS_EACH=600] scripts/fuzz.sh [TARGET...]
# Needs a nightly compiler and `cargo install cargo-fuzz`; the corpus grows in fuzz/corpus (ignored by git). What is
# found lies in fuzz/artifacts and ends this with 1. The last lines are a table of what was reached.
set -u
cd "$(dirname "$0")/.." || exit 2

seconds=${SECONDS_EACH:-600}
if [ $# -gt 0 ]; then targets=("$@"); else mapfile -t targets < <(cargo +nightly fuzz list); fi

seed() {
    case $1 in
    map_file) cp maps/golden/*.map "$2" ;;
    manifest) cp datasets/*.toml "$2" ;;
    file_storage) cp tests/data/file_storage/*.yaml "$2" ;;
    index_csv) printf 'place,time,path,x,y,width,height\na,2024-01-01T00:00:00Z,a.png,0,0,9,9\n' >"$2/good" ;;
    exported_folder) printf '\2place,visit,session,time_us\n' >"$2/visits" ;;
    esac
}

cargo +nightly fuzz build || exit 2
table=
status=0
for target in "${targets[@]}"; do
    corpus=fuzz/corpus/$target
    log=fuzz/artifacts/$target.log
    mkdir -p "$corpus" fuzz/artifacts
    seed "$target" "$corpus"
    kept=tests/data/fuzz/$target
    [ "$target" = bag ] && kept=bindings/mcap/tests/data/fuzz/bag
    cargo +nightly fuzz run "$target" "$corpus" "$kept" -- -max_len=65536 -timeout=20 \
        -rss_limit_mb=2048 -max_total_time="$seconds" -print_final_stats=1 >"$log" 2>&1 || status=1
    last=$(grep -o 'cov: [0-9]* ft: [0-9]*' "$log" | tail -n 1)
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    found=$(grep -c '^SUMMARY' "$log")
    table+="| \`$target\` | $seconds s | ${runs:-?} | ${last:-?} | $found |"$'\n'
done
printf '| target | time | inputs | reached | found |\n|---|---|---|---|---|\n%s' "$table"
exit "$status"
