#!/usr/bin/env bash
# Builds the image and tries it as deploy/compose.yaml runs it: not as root, without capabilities, with a root folder that
# is read-only. The rest is what an operator would look at: a token, health, devices, a mesh, the end.
#
#   deploy/try-image.sh [ENGINE…]        # docker; or podman with its options
#
# BUILD_OPTIONS are for the build: what this machine needs to reach packages, say. Needs an engine, curl, and the machine's
# own network: the service listens on a free port of loopback.
set -euo pipefail
cd "$(dirname "$0")/.."
engine=("${@:-docker}")
image=tesserae-try
name=tesserae-try-$$
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
url=http://127.0.0.1:$port
work=$(mktemp -d)
# podman: the form of image that has a health check
export BUILDAH_FORMAT=docker

fail() {
    echo "try-image: $*" >&2
    "${engine[@]}" logs "$name" 2>&1 | tail -20 >&2 || true
    exit 1
}

clean_up() {
    "${engine[@]}" rm --force "$name" >/dev/null 2>&1 || true
    "${engine[@]}" volume rm --force "$name" >/dev/null 2>&1 || true
    rm -rf "$work"
}
trap clean_up EXIT

# locked OPTION…: runs the image as compose.yaml does.
locked() {
    "${engine[@]}" run --read-only --tmpfs /tmp --cap-drop ALL --security-opt no-new-privileges --network host \
        --volume "$name:/data" --env "TESSERAE_LISTEN=127.0.0.1:$port" "$@"
}

inside() {
    "${engine[@]}" exec "$name" "$@"
}

# ask PATH [OPTION…]: a request with the token.
ask() {
    local path=$1
    shift
    curl --silent --show-error --fail-with-body --max-time 120 --header "Authorization: Bearer $token" "$@" "$url$path"
}

echo "building"
read -ra build_options <<<"${BUILD_OPTIONS:-}"
"${engine[@]}" build "${build_options[@]}" --file deploy/Dockerfile --tag "$image" . >"$work/build.log" 2>&1 || {
    tail -40 "$work/build.log" >&2
    exit 1
}
"${engine[@]}" volume create "$name" >/dev/null

token=$(locked --rm "$image" token new first --metrics)
[[ $token == tess_* ]] || fail "no token but: $token"
locked --detach --name "$name" "$image" >/dev/null

# by the image's own health check: podman runs it when asked, docker by itself
is_healthy() {
    "${engine[@]}" healthcheck run "$name" >/dev/null 2>&1 ||
        [ "$("${engine[@]}" inspect --format '{{.State.Health.Status}}' "$name" 2>/dev/null)" = healthy ]
}
for _ in $(seq 120); do
    is_healthy && break
    sleep 0.5
done
is_healthy || fail "the health check does not pass"
[ "$(curl --silent --output /dev/null --write-out '%{http_code}' "$url/healthz")" = 200 ] || fail "/healthz is not 200"
[ "$(curl --silent --output /dev/null --write-out '%{http_code}' "$url/v1/jobs")" = 401 ] || fail "a token is not asked for"
echo "healthy: $(curl --silent "$url/readyz")"

[ "$(inside id --user)" = 10001 ] || fail "it runs as user $(inside id --user)"
for path in / /usr/local/bin /etc; do
    if inside touch "$path/x" 2>/dev/null; then fail "$path can be written to"; fi
done
inside grep --quiet '^CapEff:[[:space:]]*0*$' /proc/1/status || fail "it has capabilities"

# its symbols are in the stage `symbols`
inside cat /usr/local/bin/tesserae >"$work/tesserae"
if grep --quiet '\.debug_info' <<<"$(readelf --sections --wide "$work/tesserae")"; then fail "the binary has its symbols"; fi

inside tesserae devices >"$work/devices"
grep --ignore-case --quiet llvmpipe "$work/devices" || fail "Vulkan finds no driver: $(cat "$work/devices")"
cat "$work/devices"
inside tesserae sample torus --faces 20000 /tmp/torus.glb
inside tesserae cluster /tmp/torus.glb --clusters 50 --device gpu --labels /tmp/gpu.bin
inside tesserae cluster /tmp/torus.glb --clusters 50 --device cpu --labels /tmp/cpu.bin
inside cmp /tmp/gpu.bin /tmp/cpu.bin || fail "the software gpu and the cpu differ"

mesh=$work/mesh.obj
if [ -n "${TESSERAE_TEST_MESHES:-}" ]; then
    mesh=$(find "$TESSERAE_TEST_MESHES" -name '*.obj' -size +1M -size -20M | sort | sed -n 1p)
else
    inside tesserae sample knot --faces 50000 /tmp/knot.obj
    inside cat /tmp/knot.obj >"$mesh"
fi
ask '/v1/jobs?clusters=200' --header 'Content-Type: model/obj' --header 'Prefer: wait=60' --data-binary "@$mesh" \
    --output "$work/job.json"
job=$(python3 -c 'import json, sys; job = json.load(open(sys.argv[1])); assert job["state"] == "succeeded", job; print(job["id"])' \
    "$work/job.json") || fail "the job did not succeed"
ask "/v1/jobs/$job/labels" --header 'Accept: application/octet-stream' --output "$work/labels.bin"
ask "/v1/jobs/$job/report" --output "$work/report.json"
python3 - "$work" <<'CHECK' || fail "labels and report do not agree"
import hashlib, json, pathlib, sys
work = pathlib.Path(sys.argv[1])
labels, report = (work / "labels.bin").read_bytes(), json.loads((work / "report.json").read_text())
assert len(labels) == 4 * report["input"]["faces"], (len(labels), report["input"])
assert hashlib.sha256(labels).hexdigest() == report["labels_sha256"]
assert (report["clusters"], report["disconnected_clusters"]) == (200, 0), report
print(f"{report['input']['faces']} faces in {report['clusters']} clusters on {report['device']['name']}")
CHECK

"${engine[@]}" stop --time 40 "$name" >/dev/null
status=$("${engine[@]}" inspect --format '{{.State.ExitCode}}' "$name")
[ "$status" = 0 ] || fail "it ended with status $status"
echo "stopped with status 0"

# what it kept is there for the next one
locked --detach --name "$name-again" "$image" >/dev/null
trap '"${engine[@]}" rm --force "$name-again" >/dev/null 2>&1; clean_up' EXIT
for _ in $(seq 120); do
    curl --silent --fail "$url/readyz" >/dev/null && break
    sleep 0.5
done
[ "$(ask "/v1/jobs/$job" | python3 -c 'import json, sys; print(json.load(sys.stdin)["state"])')" = succeeded ] ||
    fail "the job is gone after a restart"
"${engine[@]}" stop --time 40 "$name-again" >/dev/null
echo "the image does what it should"
