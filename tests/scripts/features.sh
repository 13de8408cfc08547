#!/usr/bin/env bash
# Choices of cargo features compile without warnings, and have no crate of a feature that is left out. Tests turn on no
# feature of a dependency, which would compile it, and all that uses it, once for the program and once for the tests.
set -euo pipefail
cd "$(dirname "$0")/../.."

of_gpu="naga wgpu wgpu-core"
of_s3="h2 quick-xml"
of_postgres="tokio-postgres tokio-postgres-rustls"
of_service="axum hyper object_store reqwest rusqlite rustls tokio"

fail() {
    echo "features: $*" >&2
    exit 1
}

# crates FEATURES: the names of the crates in a build.
crates() {
    cargo tree --locked -p tesserae-cli --edges normal,build --prefix none --format '{p}' --no-default-features --features "$1" |
        sed 's/ .*//' | sort -u
}

# without FEATURES CRATE…: the build has none of these crates.
without() {
    local built crate
    built=$(crates "$1")
    for crate in "${@:2}"; do
        if grep --quiet --line-regexp "$crate" <<<"$built"; then fail "with the features '$1', there is $crate"; fi
    done
}

# otherwise the names above would be wrong
built=$(crates gpu,postgres,s3,service)
for crate in $of_gpu $of_postgres $of_s3 $of_service; do
    grep --quiet --line-regexp "$crate" <<<"$built" || fail "no dependency of any feature: $crate"
done

# shellcheck disable=SC2086 # lists of names
{
    without "" $of_gpu $of_service
    without gpu $of_service
    without service $of_gpu
    without gpu,service $of_s3 $of_postgres
}

# `gpu` alone changes nothing but the engine, which `make lint` checks with it; `make test-long` also checks `postgres`
# and `s3`, each alone
for features in "" service ${TESSERAE_TEST_LONG:+postgres s3}; do
    cargo clippy --locked --quiet -p tesserae-cli --no-default-features --features "$features" -- -D warnings
done

# with_features EDGES: the crates with their features.
with_features() {
    cargo tree --locked --edges "$1" --prefix none --no-dedupe --format '{p} {f}' | sort -u
}
twice=$(comm -23 <(with_features normal,build) <(with_features normal,build,dev))
[ -z "$twice" ] || fail "tests turn on more features of: $twice"
echo "features: all in order"
