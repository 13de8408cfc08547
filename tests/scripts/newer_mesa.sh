#!/usr/bin/env bash
# Prints the driver file, for VK_DRIVER_FILES, of a software Vulkan with arrays of bindings, which tests/gpu/pages.rs
# needs. Debian 12 has Mesa 22.3, which has none: the driver of its backports is unpacked into DIR, beside the installed
# one, which users have. Prints nothing elsewhere, and where there are no backports: newer systems have newer drivers.
#
#     tests/scripts/newer_mesa.sh DIR
set -euo pipefail

mkdir -p "$1"
folder=$(realpath "$1")
driver=$folder/lvp.json
if [ -e /etc/os-release ]; then
    . /etc/os-release
fi
if [ ! -e "$driver" ] && [ "${VERSION_CODENAME:-}" = bookworm ]; then
    echo "unpacking into $folder: mesa-vulkan-drivers of bookworm-backports" >&2
    mkdir -p "$folder/lists/partial"
    archive=$(apt-get indextargets --format '$(REPO_URI)' 'Codename: bookworm' | sed -n 1p)
    echo "deb $archive bookworm-backports main" >"$folder/backports.list"
    options=(-qq -o Dir::Etc::sourcelist="$folder/backports.list" -o Dir::Etc::sourceparts=/dev/null
        -o Dir::State::lists="$folder/lists" -o APT::Sandbox::User=root)
    if (
        cd "$folder" &&
            rm -f mesa-vulkan-drivers_*.deb &&
            timeout 120 apt-get "${options[@]}" update &&
            timeout 120 apt-get "${options[@]}" download mesa-vulkan-drivers &&
            dpkg -x mesa-vulkan-drivers_*.deb .
    ) >&2; then
        library=$(echo "$folder"/usr/lib/*/libvulkan_lvp.so)
        printf '{"file_format_version": "1.0.0", "ICD": {"library_path": "%s", "api_version": "1.4.305"}}\n' \
            "$library" >"$driver"
    else
        echo "notice: no newer Mesa, so the tests of pages are skipped" >&2
    fi
fi
if [ -e "$driver" ]; then
    echo "$driver"
fi
