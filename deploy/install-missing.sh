#!/usr/bin/env bash
# Installs the Debian packages that building (`build`), testing (`test`) or emulation (`aarch64`) needs and this machine lacks.
# What is there already is left alone, so it does nothing, and needs no rights, on a machine that has everything.
set -euo pipefail

if ! command -v cargo >/dev/null; then
    echo "cargo is missing: install a Rust toolchain first" >&2
    exit 1
fi

if [ "${1:-}" = test ] && ! { cargo fmt --version && cargo clippy --version; } >/dev/null 2>&1; then
    if ! command -v rustup >/dev/null; then
        echo "cargo fmt or cargo clippy is missing, and there is no rustup to install them with" >&2
        exit 1
    fi
    echo "installing with rustup: rustfmt clippy"
    rustup component add rustfmt clippy
fi

packages=()

# need PACKAGE COMMAND…: the package is missing when the command fails.
need() {
    local package=$1
    shift
    "$@" >/dev/null 2>&1 || packages+=("$package")
}

has_library() {
    PATH=$PATH:/sbin:/usr/sbin ldconfig -p | grep -F "$1"
}

has_software_vulkan() {
    compgen -G '/usr/share/vulkan/icd.d/lvp_icd*.json' || compgen -G '/etc/vulkan/icd.d/lvp_icd*.json'
}

has_software_gl() {
    has_library libEGL_mesa.so.0 && { compgen -G '/usr/lib/*/dri/swrast_dri.so' || compgen -G '/usr/lib/*/libgallium*.so'; }
}

has_postgresql() {
    command -v initdb || compgen -G '/usr/lib/postgresql/*/bin/initdb'
}

need g++ command -v c++
need nodejs command -v node
need npm command -v npm
if [ "${1:-}" = test ]; then
    need libvulkan1 has_library libvulkan.so.1
    need mesa-vulkan-drivers has_software_vulkan
    need libegl1 has_library libEGL.so.1
    need libegl-mesa0 has_software_gl
    need libgl1-mesa-dri has_software_gl
    need curl command -v curl
    need postgresql has_postgresql
    need python3 command -v python3
    need chromium-headless-shell command -v "${CHROMIUM:-chromium-headless-shell}"
    need python3-venv python3 -c 'import ensurepip, venv'
fi

if [ "${1:-}" = aarch64 ]; then
    need gcc-aarch64-linux-gnu command -v aarch64-linux-gnu-gcc
    need g++-aarch64-linux-gnu command -v aarch64-linux-gnu-g++
    need qemu-user command -v qemu-aarch64
    target=aarch64-unknown-linux-gnu
    if ! [ -d "$(rustc --print sysroot)/lib/rustlib/$target/lib" ]; then
        if ! command -v rustup >/dev/null; then
            echo "the standard library for $target is missing, and there is no rustup to install it with" >&2
            exit 1
        fi
        echo "installing with rustup: $target"
        rustup target add "$target" || {
            echo "the standard library for $target cannot be fetched: install rust-std of $(rustc --version) for it" >&2
            exit 1
        }
    fi
fi

if [ ${#packages[@]} -eq 0 ]; then
    exit 0
fi
if ! command -v apt-get >/dev/null; then
    echo "missing, and there is no apt-get to install them with: ${packages[*]}" >&2
    exit 1
fi
sudo=()
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "missing; install them as root: apt-get install ${packages[*]}" >&2
        exit 1
    fi
    sudo=(sudo)
fi
echo "installing with apt-get: ${packages[*]}"
export DEBIAN_FRONTEND=noninteractive
"${sudo[@]}" apt-get update -qq
"${sudo[@]}" apt-get install -qq -y --no-install-recommends "${packages[@]}"
