"""How many small jobs a second the service does, with and without a data folder, and what memory it takes.

    python throughput.py BINARY [JOBS [CLIENTS [FACES]]]

CLIENTS (8) clients on loopback submit JOBS (2000) meshes of FACES (5000) faces, each with `Prefer: wait`, so that the next
one follows the end of the last. Prints figures; tests nothing.
"""

import http.client
import pathlib
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

from service import Service, resident

BINARY = pathlib.Path(sys.argv[1]).resolve()
JOBS, CLIENTS, FACES = (int(sys.argv[at]) if len(sys.argv) > at else default
                        for at, default in [(2, 2000), (3, 8), (4, 5000)])


def client(address, mesh, jobs, failures):
    connection = http.client.HTTPConnection(address, timeout=60)
    for _ in range(jobs):
        connection.request("POST", "/v1/jobs?clusters=100", mesh, {"Content-Type": "model/gltf-binary", "Prefer": "wait=60"})
        answer = connection.getresponse()
        body = answer.read()
        if answer.status != 200:
            failures.append(f"{answer.status} {body!r}")
            return


def counted(service):
    """Commits of the store, changes in them, and seconds spent on them."""
    text = urllib.request.urlopen(service.url + "/metrics", timeout=10).read().decode()
    values = dict(line.rsplit(" ", 1) for line in text.splitlines() if line and line[0] != "#")
    return [float(values[f"tesserae_store_{name}_total"]) for name in ("commits", "commands", "commit_seconds")]


def measure(name, mesh, *arguments):
    with Service(BINARY, "--device", "cpu", "--log", "warn", "--max-request-rate", "1000000", *arguments) as service:
        memory = [round(resident(service.process))]
        before = counted(service)
        started = time.monotonic()
        for _ in range(4):
            failures = []
            threads = [threading.Thread(target=client, args=(service.url[7:], mesh, JOBS // CLIENTS // 4, failures))
                       for _ in range(CLIENTS)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert not failures, failures[0]
            memory.append(round(resident(service.process)))
        seconds = time.monotonic() - started
        print(f"{name}: {JOBS / seconds:.0f} jobs/s; memory after each quarter: {memory[1:]} MB, {memory[0]} at the start")
        commits, changes, busy = (now - then for now, then in zip(counted(service), before))
        if commits:
            print(f"    the store: {commits / seconds:.0f} commits/s with {changes / commits:.1f} changes each, "
                  f"{changes / JOBS:.1f} changes a job, busy {100 * busy / seconds:.0f} %")


def main():
    with tempfile.TemporaryDirectory(prefix="tesserae-throughput-", dir=".") as folder:
        mesh = pathlib.Path(folder) / "mesh.glb"
        subprocess.run([BINARY, "sample", "sphere", "--faces", str(FACES), mesh], check=True, stdout=subprocess.DEVNULL)
        mesh = mesh.read_bytes()
        measure("in memory", mesh)
        measure("durable", mesh, "--data-dir", f"{folder}/data")


if __name__ == "__main__":
    main()
