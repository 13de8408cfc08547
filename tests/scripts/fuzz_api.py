"""Schemathesis against the service: answers and `openapi.yaml` must agree, and nothing may end in a 5xx.

    python fuzz_api.py BINARY
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import urllib.request

from service import Service

# `make test-long` sets it, for three times the examples
IS_LONG = "TESSERAE_TEST_LONG" in os.environ
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


# A query that is too long is refused by its length, whatever is in it.
REFUSALS = """
[checks]
negative_data_rejection.expected-statuses = [
    "400", "401", "403", "404", "405", "406", "409", "413", "414", "415", "422", "428", "429", "5xx"]
"""

# The contract: a job of a flat algorithm exists, and has no hierarchy.
NO_HIERARCHY = """
[[operations]]
include-path = "/v1/jobs/{id}/hierarchy"
checks.ensure_resource_availability.enabled = false
"""


# On a busy machine DELETE finds the job running, and cancels it: it is there afterwards. What a deletion removes,
# tests/service/results.rs has.
CANCELLED = ["--exclude-checks", "positive_data_acceptance,use_after_free"]

# Operations one by one, without the links between them.
ONE_BY_ONE = ["--phases", "examples,coverage,fuzzing"]


def fuzz(url, folder, config, examples, *options, **more):
    """One run. Whether bytes are a mesh is nothing that the document can say: that they are refused is no fault."""
    most = ["--max-examples", str(examples if IS_LONG else examples // 3)]
    path = folder / "schemathesis.toml"
    path.write_text(f'hooks = "{HOOKS}"\n' + config + REFUSALS + NO_HIERARCHY)
    # by one worker: in several threads, ast of CPython 3.11 and 3.12.1 fails at random (python/cpython issue 106905)
    subprocess.run(
        [SCHEMATHESIS, "--no-color", "--config-file", path, "run", url + "/openapi.yaml", "--seed", "1", "--workers", "1",
         "--request-timeout", "30", "--max-failures", "20", "--exclude-checks", "positive_data_acceptance", *most,
         *options],
        check=True, timeout=2400, cwd=folder, **more)


def follow_links(url, folder):
    """A run along the links of the document, from jobs that are made to jobs that are read, retried and deleted."""
    output = folder / "links.txt"
    try:
        with output.open("w") as file:
            fuzz(url, folder, "", 40, *CANCELLED, "--phases", "stateful",
                 env={**os.environ, "LINKS_ONLY": "1"}, stdout=file)
    finally:
        print(output.read_text(), flush=True)
    covered = re.search(r"API Links:\s+(\d+) covered", output.read_text())
    assert covered and int(covered[1]) > 0, "no link of the document was followed to an answer"


def main(binary):
    with Service(binary) as service, tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        print("every operation", flush=True)
        fuzz(service.url, folder, "", 150, *ONE_BY_ONE)
        print("links from one operation to the next", flush=True)
        follow_links(service.url, folder)
        # made only now, because the first run deletes what it finds
        job = ended_job(binary, service.url, folder)
        print("everything that can be read of a job that ended", flush=True)
        fuzz(service.url, folder, f'[parameters]\n"path.id" = "{job}"\n', 60, *ONE_BY_ONE, "--include-method", "GET")
        assert "panicked" not in service.logged(), service.logged()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        tokens = folder / "tokens.json"
        new = [binary, "token", "new", "fuzz", "--metrics", "--tokens", tokens]
        token = subprocess.run(new, check=True, capture_output=True, text=True).stdout.strip()
        with Service(binary, "--tokens", str(tokens)) as service:
            print("every operation, with a token", flush=True)
            header = ["--header", f"Authorization: Bearer {token}"]
            fuzz(service.url, folder, "", 40, *ONE_BY_ONE, *header)
            job = ended_job(binary, service.url, folder, token)
            print("everything that can be read of a job that ended, without one", flush=True)
            fuzz(service.url, folder, f'[parameters]\n"path.id" = "{job}"\n', 30, *ONE_BY_ONE, "--include-method", "GET")
            assert "panicked" not in service.logged() and token not in service.logged(), service.logged()


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]).resolve())
