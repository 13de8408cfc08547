#!/usr/bin/env bash
# Puts promtool, which tests alert rules, into a folder: out of Debian's package `prometheus`, whose service is not
# installed. Needs no rights. Where it cannot be had, says so and succeeds: check.sh then only reads the rules.
#
#   deploy/promtool.sh FOLDER
set -euo pipefail
folder=$1

if [ -x "$folder/promtool" ] || command -v promtool >/dev/null; then
    exit 0
fi
package=$(mktemp -d)
trap 'rm -r "$package"' EXIT
take() {
    (cd "$package" && apt-get download -qq prometheus) &&
        dpkg-deb --fsys-tarfile "$package"/prometheus_*.deb | tar -xO ./usr/bin/promtool > "$package/promtool" &&
        [ -s "$package/promtool" ]
}
if take 2>/dev/null; then
    install "$package/promtool" "$folder/promtool"
    echo "installed promtool, of Debian's package prometheus, in $folder"
else
    echo "promtool is not there, and Debian's package prometheus cannot be downloaded" >&2
fi
