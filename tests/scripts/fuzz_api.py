"""Schemathesis against the service: answers and `openapi.yaml` must agree, and nothing may end in a 5xx.

    python fuzz_api.py BINARY
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import urllib.request

from service import Service

SCHEMATHESIS = pathlib.Path(sys.executable).parent / "schemathesis"
HOOKS = pathlib.Path(__file__).resolve().parent / "fuzz_hooks.py"


def ended_job(binary, url, folder, token=None):
    """Id of a job that succeeded."""
    mesh = folder / "sphere.glb"
    subprocess.run([binary, "sample", "sphere", "--faces", "500", mesh], check=True, stdout=subprocess.DEVNULL)
    request = urllib.request.Request(
        url + "/v1/jobs?clusters=10", mesh.read_bytes(), {"Content-Type": "model/gltf-binary", "Prefer": "wait=30"})
    if token:
        request.add_header("Authorization", f"Bearer {token}")
    with urllib.request.urlopen(request) as answer:
        job = json.load(answer)
    assert job["state"] == "succeeded", job
    return job["id"]


# The contract: a job of a flat algorithm exists, and has no hierarchy.
NO_HIERARCHY = """
[[operations]]
include-path = "/v1/jobs/{id}/hierarchy"
checks.ensure_resource_availability.enabled = false
"""


def fuzz(url, folder, config, *options):
    """One run. Whether bytes are a mesh is nothing that the document can say: that they are refused is no fault."""
    path = folder / "schemathesis.toml"
    path.write_text(f'hooks = "{HOOKS}"\n' + config + NO_HIERARCHY)
    subprocess.run(
        [SCHEMATHESIS, "--no-color", "--config-file", path, "run", url + "/openapi.yaml", "--seed", "1", "--workers", "2",
         "--request-timeout", "30", "--max-failures", "20", "--exclude-checks", "positive_data_acceptance", *options],
        check=True, timeout=300, cwd=folder)


def main(binary):
    # as fast as it comes: the limits have tests of their own
    unlimited = ["--max-request-rate", "0"]
    with Service(binary, *unlimited) as service, tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        print("every operation", flush=True)
        fuzz(service.url, folder, "", "--max-examples", "150")
        # made only now, because the first run deletes what it finds
        job = ended_job(binary, service.url, folder)
        print("everything that can be read of a job that ended", flush=True)
        fuzz(service.url, folder, f'[parameters]\n"path.id" = "{job}"\n',
             "--max-examples", "60", "--phases", "examples,coverage,fuzzing", "--include-method", "GET")
        assert "panicked" not in service.logged(), service.logged()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        tokens = folder / "tokens.json"
        new = [binary, "token", "new", "fuzz", "--metrics", "--tokens", tokens]
        token = subprocess.run(new, check=True, capture_output=True, text=True).stdout.strip()
        with Service(binary, *unlimited, "--tokens", str(tokens)) as service:
            print("every operation, with a token", flush=True)
            header = ["--header", f"Authorization: Bearer {token}"]
            fuzz(service.url, folder, "", "--max-examples", "40", *header)
            job = ended_job(binary, service.url, folder, token)
            print("everything that can be read of a job that ended, without one", flush=True)
            fuzz(service.url, folder, f'[parameters]\n"path.id" = "{job}"\n',
                 "--max-examples", "30", "--phases", "examples,coverage,fuzzing", "--include-method", "GET")
            assert "panicked" not in service.logged() and token not in service.logged(), service.logged()


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]).resolve())
