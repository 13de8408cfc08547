"""Two builds of the service in turns: start, stop, latency of one client and jobs a second, as medians and their ratio.

    python service.py BEFORE AFTER [ROUNDS]

Both are programs with the command `serve`, on the cpu device; ROUNDS (5) times each. Nothing else should run.
Data folders are in the temporary folder (TMPDIR), which should be on a disk.

| row | what is measured |
|---|---|
| start | from the start of the process until `/readyz` answers; the data folder is new |
| stop | from SIGTERM until the process has ended |
| latency of N faces | median of 200 jobs into 20 clusters at `fast` with `Prefer: wait`, five turns of 40, each after 5 others |
| jobs a second | 320 such jobs of 300 faces by 8 clients, median of four turns |
"""

import concurrent.futures
import http.client
import json
import os
import pathlib
import socket
import statistics
import subprocess
import sys
import tempfile
import time

PATH = "/v1/jobs?clusters=20&quality=fast"
HEADERS = {"Content-Type": "model/gltf-binary", "Prefer": "wait=60"}


def jobs(port, mesh, count):
    """Milliseconds of each of `count` jobs of one client."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    times = []
    for _ in range(count):
        started = time.perf_counter()
        connection.request("POST", PATH, mesh, HEADERS)
        answer = connection.getresponse()
        body = answer.read()
        assert answer.status == 200 and json.loads(body)["state"] == "succeeded", body
        times.append(1000 * (time.perf_counter() - started))
    return times


def started(binary, arguments, temporary):
    """The process, its port, and the milliseconds until it is ready."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    begin = time.perf_counter()
    listen = ["--listen", f"127.0.0.1:{port}"]
    environment = os.environ | {"TMPDIR": temporary}
    process = subprocess.Popen([binary, "serve", "--device", "cpu", "--log", "error", *listen, *arguments], env=environment)
    while time.perf_counter() < begin + 60:
        try:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
            connection.request("GET", "/readyz")
            if connection.getresponse().status == 200:
                return process, port, 1000 * (time.perf_counter() - begin)
        except OSError:
            assert process.poll() is None, "the service ended"
        time.sleep(0.0005)
    process.kill()
    raise TimeoutError("the service is not ready after a minute")


def stopped(process):
    begin = time.perf_counter()
    process.terminate()
    # with a time limit, Python would look at growing intervals
    process.wait()
    return 1000 * (time.perf_counter() - begin)


def measure(binaries, order, meshes, arguments, temporary):
    """One round: for each binary the name of each row and its value. Both run, and work in turns of some seconds at most.

    Each has a temporary folder of its own, since 1a3f6f8 removes folders of others there.
    """
    services, rows = {}, ({}, {})
    try:
        for at in order:
            *services[at], rows[at]["start, ms"] = started(binaries[at], arguments[at], temporary[at])
        for faces, mesh in meshes.items():
            times = ([], [])
            for turn in range(5):
                for at in order if turn % 2 == 0 else order[::-1]:
                    times[at].extend(jobs(services[at][1], mesh, 45)[5:])
            for at in order:
                rows[at][f"latency of {faces:,} faces, ms"] = statistics.median(times[at])
        rates = ([], [])
        for turn in range(4):
            for at in order if turn % 2 == 0 else order[::-1]:
                begin = time.perf_counter()
                with concurrent.futures.ThreadPoolExecutor(8) as clients:
                    list(clients.map(lambda _, port=services[at][1]: jobs(port, meshes[300], 40), range(8)))
                rates[at].append(320 / (time.perf_counter() - begin))
        for at in order:
            rows[at]["jobs a second"] = statistics.median(rates[at])
    finally:
        for at, (process, _) in services.items():
            rows[at]["stop, ms"] = stopped(process)
    assert all(process.returncode == 0 for process, _ in services.values())
    return rows


def main():
    binaries = [pathlib.Path(path).resolve() for path in sys.argv[1:3]]
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    with tempfile.TemporaryDirectory(prefix="tesserae-service-") as folder:
        temporary = [f"{folder}/temporary-{at}" for at in (0, 1)]
        for path in temporary:
            os.mkdir(path)
        meshes = {}
        for faces in (300, 1000):
            file = pathlib.Path(folder) / f"{faces}.glb"
            sample = [binaries[1], "sample", "sphere", "--faces", str(faces), file]
            subprocess.run(sample, check=True, stdout=subprocess.DEVNULL)
            meshes[faces] = file.read_bytes()
        for is_durable in (True, False):
            values = ({}, {})
            for turn in range(rounds):
                arguments = [["--data-dir", f"{folder}/data-{turn}-{at}"] if is_durable else [] for at in (0, 1)]
                order = (0, 1) if turn % 2 == 0 else (1, 0)
                measured = measure(binaries, order, meshes, arguments, temporary)
                for at in (0, 1):
                    for name, value in measured[at].items():
                        values[at].setdefault(name, []).append(value)
            where = "with" if is_durable else "without"
            print(f"\n| {where} a data folder | before | after | ratio | ratios of rounds |")
            print("|---|--:|--:|--:|---|")
            for name in values[0]:
                before, after = (statistics.median(of[name]) for of in values)
                each = ", ".join(f"{b / a:.2f}" for a, b in zip(values[0][name], values[1][name]))
                print(f"| {name} | {before:.2f} | {after:.2f} | {after / before:.2f} | {each} |")


if __name__ == "__main__":
    main()
