#!/usr/bin/env bash
# Fuzzes every parser for so many seconds each, from a corpus of small meshes and requests made by the program itself.
#
#   fuzz/run.sh [SECONDS [TARGET…]]
#
# Needs cargo-fuzz (`cargo install cargo-fuzz`), and a nightly compiler or any other: RUSTC_BOOTSTRAP lets the stable one
# take the flags of the instrumentation. What it found worth keeping is in fuzz/corpus, what crashed in fuzz/artifacts. Goes
# on with the next target after a crash; says at the end what each came to, and fails if one crashed.
set -euo pipefail
cd "$(dirname "$0")"
command -v cargo-fuzz >/dev/null || {
    echo "fuzz: cargo-fuzz is missing: cargo install cargo-fuzz" >&2
    exit 1
}
seconds=${1:-60}
shift || true
targets=("$@")
if [ ${#targets[@]} -eq 0 ]; then
    targets=(obj gltf ply stl off number stored points image lists request form tokens headers)
fi
export RUSTC_BOOTSTRAP=1
python3 seeds.py
log=$(mktemp)
trap 'rm -f "$log"' EXIT
results=()
failed=0
for target in "${targets[@]}"; do
    mkdir -p "corpus/$target"
    outcome="no crash"
    # the parsers of meshes and files are built in minutes without the service
    features=--no-default-features
    case "$target" in request | form | tokens | headers) features= ;; esac
    # Without a sanitizer: the crate has no unsafe code, so what there is to find are panics, hangs and memory. A hang is
    # 60 s, because others come first at this niceness.
    nice -n 19 cargo fuzz run --sanitizer none $features "$target" "corpus/$target" "seeds/$target" -- \
        -max_total_time="$seconds" -rss_limit_mb=2048 -malloc_limit_mb=1024 -timeout=60 -max_len=65536 \
        -print_final_stats=1 2>&1 | tee "$log" || {
        outcome="FAILED"
        failed=1
    }
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    results+=("$(printf '%-8s %12s executions, %s' "$target" "${runs:-no}" "$outcome")")
done
printf '%s\n' "${results[@]}"
exit "$failed"
