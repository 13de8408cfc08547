"""Whether the service's memory stays the same over many jobs that come and go.

    python memory.py BINARY [JOBS [FACES [GROWTH]]]

CLIENTS clients on loopback submit JOBS (500) meshes of FACES (300) faces, each job is kept for a second after its end. Prints
the memory after a tenth, a quarter, a half and all of them, when all are forgotten, with a temporary folder and with a data folder, and
what is left on disk. Fails when the memory at the end is more than GROWTH (1.2) times that after a quarter, and 4 MB more, and
as many jobs again add more than 4 MB.
"""

import http.client
import json
import pathlib
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

from service import Service, resident

BINARY = pathlib.Path(sys.argv[1]).resolve()
JOBS, FACES = (int(sys.argv[at]) if len(sys.argv) > at else default for at, default in [(2, 500), (3, 300)])
GROWTH = float(sys.argv[4]) if len(sys.argv) > 4 else 1.2
CLIENTS = 8
SPARE_MB = 4


def client(address, mesh, jobs, failures):
    connection = http.client.HTTPConnection(address, timeout=60)
    for _ in range(jobs):
        headers = {"Content-Type": "model/gltf-binary", "Prefer": "wait=60"}
        connection.request("POST", "/v1/jobs?clusters=20&quality=fast", mesh, headers)
        answer = connection.getresponse()
        body = answer.read()
        if answer.status != 200:
            failures.append(f"{answer.status} {body!r}")
            return


def submit(service, mesh, jobs):
    failures = []
    threads = [threading.Thread(target=client, args=(service.url[7:], mesh, jobs // CLIENTS, failures))
               for _ in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures, failures[0]


def wait_until_forgotten(service):
    deadline = time.monotonic() + 120
    while json.load(urllib.request.urlopen(service.url + "/v1/jobs?limit=1", timeout=60))["jobs"]:
        assert time.monotonic() < deadline, "jobs are not forgotten"
        time.sleep(0.1)


def measure(name, mesh, *arguments):
    with Service(BINARY, "--device", "cpu", "--log", "warn", "--retention", "1", *arguments) as service:
        done, memory = 0, []
        for share in (0.1, 0.25, 0.5, 1):
            jobs = int(JOBS * share)
            submit(service, mesh, jobs - done)
            done = jobs
            wait_until_forgotten(service)
            memory.append(resident(service.process))
        told = ", ".join(f"{int(JOBS * share)}: {megabytes:.1f} MB" for share, megabytes in zip((0.1, 0.25, 0.5, 1), memory))
        print(f"{name}: memory after jobs: {told}")
        if memory[3] > GROWTH * memory[1] + SPARE_MB:
            # an arena of the allocator is there from some job on; what grows with the jobs grows as much again
            submit(service, mesh, JOBS)
            wait_until_forgotten(service)
            memory.append(resident(service.process))
            assert memory[4] <= memory[3] + SPARE_MB, f"{name}: memory grows with the jobs: {memory} MB"


def main():
    with tempfile.TemporaryDirectory(prefix="tesserae-memory-", dir=".") as folder:
        mesh = pathlib.Path(folder) / "mesh.glb"
        subprocess.run([BINARY, "sample", "sphere", "--faces", str(FACES), mesh], check=True, stdout=subprocess.DEVNULL)
        mesh = mesh.read_bytes()
        measure("temporary", mesh)
        data = pathlib.Path(folder) / "data"
        measure("durable", mesh, "--data-dir", str(data))
        left = sum(path.stat().st_size for path in data.rglob("*") if path.is_file())
        print(f"durable: {left / 1e6:.1f} MB on disk when it had ended")


if __name__ == "__main__":
    main()
