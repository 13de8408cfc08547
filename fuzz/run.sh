#!/usr/bin/env bash
# Fuzzes every parser for so many seconds each, from a corpus of small meshes and requests made by the program itself.
#
#   fuzz/run.sh [SECONDS [TARGET…]]
#
# Needs cargo-fuzz (`cargo install cargo-fuzz`). What it found worth keeping is in fuzz/corpus, what crashed in
# fuzz/artifacts. RUSTC_BOOTSTRAP lets the stable compiler take the flags of the instrumentation.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:-60}
shift || true
targets=("$@")
if [ ${#targets[@]} -eq 0 ]; then
    targets=(obj gltf number stored lists request form tokens headers)
fi
export RUSTC_BOOTSTRAP=1
python3 seeds.py
for target in "${targets[@]}"; do
    mkdir -p "corpus/$target"
    # without a sanitizer: the crate has no unsafe code, so what there is to find are panics, hangs and memory
    nice -n 19 cargo fuzz run --sanitizer none "$target" "corpus/$target" "seeds/$target" -- \
        -max_total_time="$seconds" -rss_limit_mb=2048 -malloc_limit_mb=1024 -timeout=20 -max_len=65536 -print_final_stats=1
done
