#!/usr/bin/env bash
# Checks what is in this folder as far as that goes without a container engine.
#
#   deploy/check.sh FOLDER     where hadolint and check-jsonschema are
set -euo pipefail
cd "$(dirname "$0")"
tools=$1

"$tools/hadolint" Dockerfile
"$tools/check-jsonschema" --builtin-schema vendor.compose-spec compose.yaml compose.nvidia.yaml farm.compose.yaml
"$tools/python" check-chart.py
if command -v systemd-analyze >/dev/null; then
    unit=$(mktemp -d)/tesserae.service
    trap 'rm -r "${unit%/*}"' EXIT
    # the binary need not be installed here
    sed 's|^ExecStart=[^ ]*|ExecStart=/bin/true|' tesserae.service > "$unit"
    systemd-analyze verify "$unit"
fi
# with promtool where there is one (promtool.sh puts it there); otherwise at least that it is YAML with rules in it
promtool=$tools/promtool
[ -x "$promtool" ] || promtool=$(command -v promtool || true)
if [ -n "$promtool" ]; then
    for rules in alerts farm-alerts; do
        "$promtool" check rules "$rules.yaml"
        "$promtool" test rules "$rules.test.yaml"
        for alert in $(sed -n 's/^ *- alert: //p' "$rules.yaml"); do
            grep --quiet "alertname: $alert\$" "$rules.test.yaml" || { echo "an alert without a test: $alert" >&2; exit 1; }
        done
    done
else
    echo "promtool is not there: alert rules are only read" >&2
    "$tools/python" -c 'import yaml
groups = [group for name in ("alerts", "farm-alerts") for group in yaml.safe_load(open(name + ".yaml"))["groups"]]
for rule in (rule for group in groups for rule in group["rules"]):
    assert {"alert", "expr", "labels", "annotations"} <= set(rule), rule
    assert rule["expr"].count("(") == rule["expr"].count(")"), rule
print(sum(len(group["rules"]) for group in groups), "alert rules")'
fi
# symbols leave the binary, which runs without them
symbols=$(mktemp -d)
echo "int main(void) { return 0; }" | cc -g -x c -o "$symbols/program" -
./split-symbols.sh "$symbols/program"
"$symbols/program" && [ -s "$symbols/program.debug" ]
grep --quiet '\.gnu_debuglink' <<<"$(readelf --sections "$symbols/program")" || { echo "no link to the symbols" >&2; exit 1; }
rm -r "$symbols"
profile=$(sed -n 's/.*cargo build --profile \([a-z]*\).*/\1/p' Dockerfile)
grep --quiet "^\[profile\.$profile\]" ../Cargo.toml || { echo "no profile of cargo: '$profile'" >&2; exit 1; }
# it has the settings of `dev`, which are for tests, where it has none of its own
for package in $(sed -n 's/^\[profile\.dev\.package\.\([^"]*\)\]/\1/p' ../Cargo.toml); do
    section=$(sed -n "/^\[profile\.$profile\.package\.$package\]/,/^\[/p" ../Cargo.toml)
    grep --quiet '^opt-level = 3' <<<"$section" || { echo "the profile '$profile' does not optimise $package" >&2; exit 1; }
done
# every setting that these files speak of exists
known=$(grep -oh 'TESSERAE_[A-Z_]*' ../docs/operations.md ../docs/farm.md | sort -u)
for name in $(grep -oh 'TESSERAE_[A-Z_]*' Dockerfile compose.yaml farm.compose.yaml tesserae.service | sort -u); do
    grep -qx "$name" <<<"$known" || { echo "no setting of the service: $name" >&2; exit 1; }
done
echo "deploy: all in order"
