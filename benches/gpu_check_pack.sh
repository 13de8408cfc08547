#!/usr/bin/env bash
# Packs what gpu_check.py needs into FOLDER, for a machine without network and toolchain: PROFILE is cargo's, `release`
# but for a trial of the check itself.
#
#   gpu_check_pack.sh FOLDER [PROFILE]
set -euo pipefail

folder=$1
profile=${2:-release}
target=${CARGO_TARGET_DIR:-target}

# nothing of the service
cargo build --locked --profile "$profile" -p tesserae-cli --no-default-features --features gpu >&2
cargo test --locked --profile "$profile" -p tesserae-mesh --no-default-features --features gpu --no-run --test gpu 2>&1 |
    tee "$target/gpu-check.log" >&2

rm -rf "$folder"
mkdir -p "$folder"/{bin,tests,lib,meshes}
built=$profile
[ "$profile" = dev ] && built=debug
cp "$target/$built/tesserae" "$folder/bin/"
cp "$(sed -n "s|.*Executable tests/gpu/main.rs (\(.*\))|\1|p" "$target/gpu-check.log")" "$folder/tests/gpu"
strip "$folder"/bin/* "$folder"/tests/*
# the loader only: the driver belongs to the card
loader=$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p | sed -n 's|.*libvulkan.so.1 .*=> ||p' | head -n 1)
[ -n "$loader" ] && cp -L "$loader" "$folder/lib/libvulkan.so.1"
for mesh in stanford-bunny.glb armadillo-172k.glb horse.glb igea.glb; do
    source=${TESSERAE_TEST_MESHES:-../shared/meshes}/$mesh
    if [ -e "$source" ]; then
        cp "$source" "$folder/meshes/"
    fi
done
cp "$(dirname "$0")/gpu_check.py" "$folder/"
du -sh "$folder"
