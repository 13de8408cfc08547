#!/usr/bin/env bash
# Takes the symbols out of a binary and puts them into a file beside it, BINARY.debug, to which the binary keeps a link:
# debuggers and the backtraces of panics find the file where both lie in the same folder, or in /usr/lib/debug.
#
#   deploy/split-symbols.sh BINARY
#
# Needs binutils.
set -euo pipefail
[ $# -eq 1 ] || {
    echo "usage: deploy/split-symbols.sh BINARY" >&2
    exit 2
}
binary=$1
symbols=$1.debug
objcopy --only-keep-debug "$binary" "$symbols"
chmod 0644 "$symbols"
strip --strip-unneeded --remove-section=.gnu_debuglink "$binary"
# the link holds the name and a checksum of the file
(cd "$(dirname "$binary")" && objcopy --add-gnu-debuglink="$(basename "$symbols")" "$(basename "$binary")")
