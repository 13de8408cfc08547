#!/usr/bin/env bash
# Makes the images that deploy/Dockerfile begins with out of Debian packages and this machine's Rust, for machines that
# reach a mirror of Debian but no registry of images. They are much like the official ones, and no replacement for them.
#
#   deploy/base-images.sh ENGINE…        # docker; or podman with its options
#
# Needs mmdebstrap, root, and a Rust toolchain of the version that the Dockerfile names.
set -euo pipefail
cd "$(dirname "$0")"
[ $# -gt 0 ] || {
    echo "usage: deploy/base-images.sh ENGINE…" >&2
    exit 2
}
engine=("$@")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

sed -n 's/^ARG [A-Z]*_IMAGE=//p' Dockerfile | sort -u | while read -r image; do
    if "${engine[@]}" image inspect "$image" >/dev/null 2>&1; then
        echo "$image is there"
        continue
    fi
    tag=${image#*:}
    root=$work/${image%%:*}
    case $image in
    debian:*-slim)
        suite=${tag%-slim}
        packages=ca-certificates
        ;;
    rust:*-slim-*)
        suite=${tag##*-}
        packages=ca-certificates,gcc,libc6-dev
        version=${tag%%-*}
        grep --quiet "^rustc $version\." <<<"$(rustc --version)" || {
            echo "base-images: $image needs Rust $version, here is $(rustc --version)" >&2
            exit 1
        }
        ;;
    *)
        echo "base-images: it is not known how to make $image" >&2
        exit 1
        ;;
    esac
    echo "making $image"
    mmdebstrap --quiet --variant=minbase --include="$packages" "$suite" "$root" </dev/null
    case $image in
    rust:*)
        sysroot=$(rustc --print sysroot)
        host=$(rustc --version --verbose | sed -n 's/^host: //p')
        cp -a "$sysroot/bin/cargo" "$sysroot/bin/rustc" "$root/usr/local/bin/"
        cp -a "$sysroot"/lib/*.so* "$root/usr/local/lib/"
        mkdir -p "$root/usr/local/lib/rustlib"
        cp -a "$sysroot/lib/rustlib/$host" "$root/usr/local/lib/rustlib/"
        ;;
    esac
    tar -C "$root" --one-file-system -c . |
        "${engine[@]}" import --change 'ENV PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin' \
            --change 'ENV CARGO_HOME=/usr/local/cargo' - "$image" >/dev/null
    rm -rf "$root"
done
