#!/usr/bin/env bash
# Checks what is in this folder as far as that goes without a container engine.
#
#   deploy/check.sh FOLDER     where hadolint and check-jsonschema are
set -euo pipefail
cd "$(dirname "$0")"
tools=$1

"$tools/hadolint" Dockerfile
"$tools/check-jsonschema" --builtin-schema vendor.compose-spec compose.yaml compose.nvidia.yaml
if command -v systemd-analyze >/dev/null; then
    unit=$(mktemp -d)/tesserae.service
    trap 'rm -r "${unit%/*}"' EXIT
    # the binary need not be installed here
    sed 's|^ExecStart=[^ ]*|ExecStart=/bin/true|' tesserae.service > "$unit"
    systemd-analyze verify "$unit"
fi
# every setting that these files speak of exists
known=$(grep -o 'TESSERAE_[A-Z_]*' ../docs/operations.md | sort -u)
for name in $(grep -oh 'TESSERAE_[A-Z_]*' Dockerfile compose.yaml tesserae.service | sort -u); do
    grep -qx "$name" <<<"$known" || { echo "no setting of the service: $name" >&2; exit 1; }
done
echo "deploy: all in order"
