"""How many small jobs a second the service does, with and without a data folder, what of a processor and which memory it takes.

    python throughput.py BINARY [JOBS [CLIENTS [FACES]]]

CLIENTS (8) clients on loopback submit JOBS (2000) meshes of FACES (5000) faces with quality `fast`, where the service's own
work counts most, then a quarter of them with the default; each with `Prefer: wait`, so that the next one follows the end of
the last. Prints figures; tests nothing.
"""

import http.client
import os
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


def client(address, mesh, quality, jobs, failures):
    path = f"/v1/jobs?clusters=100&quality={quality}"
    connection = http.client.HTTPConnection(address, timeout=60)
    for _ in range(jobs):
        connection.request("POST", path, mesh, {"Content-Type": "model/gltf-binary", "Prefer": "wait=60"})
        answer = connection.getresponse()
        body = answer.read()
        if answer.status != 200:
            failures.append(f"{answer.status} {body!r}")
            return


def counted(service):
    """Commits of the store, changes in them, and seconds spent on them."""
    text = urllib.request.urlopen(service.url + "/metrics", timeout=60).read().decode()
    values = dict(line.rsplit(" ", 1) for line in text.splitlines() if line and line[0] != "#")
    return [float(values[f"tesserae_store_{name}_total"]) for name in ("commits", "commands", "commit_seconds")]


def processor(process):
    """Seconds of a processor that a process took."""
    times = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, times)) / os.sysconf("SC_CLK_TCK")


def measure(name, quality, total, mesh, *arguments):
    with Service(BINARY, "--device", "cpu", "--log", "warn", *arguments) as service:
        memory = [round(resident(service.process))]
        before, worked = counted(service), processor(service.process)
        started = time.monotonic()
        for _ in range(4):
            failures = []
            threads = [threading.Thread(target=client, args=(service.url[7:], mesh, quality, total // CLIENTS // 4, failures))
                       for _ in range(CLIENTS)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert not failures, failures[0]
            memory.append(round(resident(service.process)))
        seconds = time.monotonic() - started
        worked = processor(service.process) - worked
        print(f"{name}, quality {quality}: {total / seconds:.0f} jobs/s, {1000 * worked / total:.1f} ms of a processor each; "
              f"memory after each quarter: {memory[1:]} MB, {memory[0]} at the start")
        commits, changes, busy = (now - then for now, then in zip(counted(service), before))
        if commits:
            print(f"    the store: {commits / seconds:.0f} commits/s with {changes / commits:.1f} changes each, "
                  f"{changes / total:.1f} changes a job, busy {100 * busy / seconds:.0f} %")


def main():
    with tempfile.TemporaryDirectory(prefix="tesserae-throughput-") as folder:
        mesh = pathlib.Path(folder) / "mesh.glb"
        subprocess.run([BINARY, "sample", "sphere", "--faces", str(FACES), mesh], check=True, stdout=subprocess.DEVNULL)
        mesh = mesh.read_bytes()
        for quality, total in [("fast", JOBS), ("default", JOBS // 4)]:
            measure("temporary", quality, total, mesh)
            measure("durable", quality, total, mesh, "--data-dir", f"{folder}/{quality}")


if __name__ == "__main__":
    main()
