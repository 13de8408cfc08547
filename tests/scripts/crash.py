"""Kills the service at random moments while clients keep it busy, and counts afterwards.

    python crash.py BINARY [KILLS [SECONDS]]

KILLS (100 when left out) times, as often as fit in SECONDS (60), a service on one data folder is ended by SIGKILL and
started again. Clients submit small meshes with an Idempotency-Key each, and ask again with the same key until they are
answered. In the end every key has one job, every job has succeeded once with the labels that the command line gives, its
events are numbered without a gap, and nothing else of the jobs is left in the folder. There are more jobs than kills, however slow the machine is.
"""

import http.client
import json
import os
import pathlib
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid

BINARY = pathlib.Path(sys.argv[1]).resolve()
KILLS = int(sys.argv[2]) if len(sys.argv) > 2 else 100
SECONDS = float(sys.argv[3]) if len(sys.argv) > 3 else 60
CLIENTS = 12
# jobs that wait at most: so few that they end soon after the last kill
QUEUED = 50
# bytes above which an upload is a file
SMALL = 256 << 10
TEMPORARY = tempfile.TemporaryDirectory(prefix="tesserae-crash-")
WORK = pathlib.Path(TEMPORARY.name)
DATA = WORK / "data"
SEED = int(os.environ.get("SEED", random.randrange(1 << 30)))


class Server:
    """The service, which is killed and started again, always at the same address."""

    def __init__(self):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = probe.getsockname()
        self.log = open(WORK / "log", "wb")
        self.process = None

    def start(self):
        self.process = subprocess.Popen(
            [BINARY, "serve", "--listen", "%s:%d" % self.address, "--data-dir", DATA, "--device", "cpu",
             "--max-queued-jobs", str(QUEUED), "--min-free-bytes", "0", "--log", "warn",
             # kills are so many that a job may be alone at work in several, and so close that pauses would fill the time
             "--crash-pause", "0", "--max-attempts", "1000"],
            stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log)

    def wait_until_it_answers(self):
        deadline = time.monotonic() + 60
        while True:
            try:
                return get(self, "/healthz")
            except OSError:
                assert self.process.poll() is None and time.monotonic() < deadline, f"it did not start:\n{self.tail()}"
                time.sleep(0.005)

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        assert self.process.wait() == -signal.SIGKILL, f"it had ended by itself:\n{self.tail()}"

    def tail(self):
        return (WORK / "log").read_text(errors="replace")[-3000:]


def request(server, method, path, body=None, headers={}):
    connection = http.client.HTTPConnection(*server.address, timeout=60)
    try:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.read()
    except http.client.HTTPException as error:
        raise ConnectionError(str(error)) from error
    finally:
        connection.close()


def get(server, path):
    status, body = request(server, "GET", path)
    assert status == 200, f"{path}: {status} {body!r}"
    return body


class Client(threading.Thread):
    """Submits jobs until it is stopped, and remembers the id of each."""

    def __init__(self, server, kinds, number, stop):
        super().__init__()
        self.server, self.kinds, self.stop = server, kinds, stop
        self.random = random.Random(SEED + number)
        self.accepted, self.retries, self.failure = {}, 0, None

    def run(self):
        try:
            while not self.stop.is_set():
                kind = self.random.choices(range(len(self.kinds)), [3, 3, 3, 3, 1])[0]
                job = self.submit(kind, str(uuid.UUID(int=self.random.getrandbits(128))))
                assert job["id"] not in self.accepted, "two keys have one job"
                self.accepted[job["id"]] = kind
        except BaseException as failure:
            self.failure = failure

    def submit(self, kind, key):
        query, mesh, _ = self.kinds[kind]
        headers = {"Content-Type": "model/obj", "Idempotency-Key": f'"{key}"'}
        deadline = time.monotonic() + 120
        while True:
            if self.random.random() < 0.1:
                headers["Prefer"] = "wait=5"
            else:
                headers.pop("Prefer", None)
            try:
                status, body = request(self.server, "POST", "/v1/jobs?" + query, mesh, headers)
                if status in (200, 202):
                    return json.loads(body)
                # it stops, or has too much to do
                assert status in (429, 503), f"{status}: {body!r}"
            except OSError:
                pass
            self.retries += 1
            assert time.monotonic() < deadline, "no answer for two minutes"
            time.sleep(0.05)


def count(clients):
    """Jobs accepted so far."""
    return sum(len(client.accepted) for client in clients)


def kinds():
    """Queries with their meshes and the labels that they must give."""
    made = []
    for name, faces, flags in [("sphere", 60, ["--clusters", "4"]), ("knot", 200, ["--clusters", "9"]),
                               ("terrain", 120, ["--clusters", "7", "--seeds", "random", "--seed", "7"]),
                               ("torus", 100, ["--algorithm", "pml", "--clusters", "5"]),
                               # its upload and its result are files, which those of the others are not
                               ("plane", 6000, ["--clusters", "60", "--max-iterations", "13",
                                                "--snapshots", ",".join(map(str, range(1, 13)))])]:
        mesh, report = WORK / f"{name}.obj", WORK / f"{name}.json"
        subprocess.run([BINARY, "sample", name, "--faces", str(faces), mesh], check=True, stdout=subprocess.DEVNULL)
        if name == "plane":
            with mesh.open("a") as file:
                file.write("# a comment as long as a large mesh\n" * (SMALL // 36))
        subprocess.run([BINARY, "cluster", mesh, *flags, "--device", "cpu", "--report", report,
                        "--labels", WORK / f"{name}.npy"], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        query = "&".join(f"{flag[2:].replace('-', '_')}={value}" for flag, value in zip(flags[::2], flags[1::2]))
        made.append((query, mesh.read_bytes(), json.loads(report.read_text())["labels_sha256"]))
    return made


def jobs(server):
    """Every job that the service knows."""
    cursor = ""
    while True:
        page = json.loads(get(server, f"/v1/jobs?limit=1000{cursor}"))
        yield from page["jobs"]
        if page["next"] is None:
            return
        cursor = "&cursor=" + page["next"]


def check(server, job, digest):
    assert job["state"] == "succeeded", job
    report = json.loads(get(server, job["urls"]["report"]))
    assert report["labels_sha256"] == digest, f"another result: {job['id']}"
    labels = json.loads(get(server, job["urls"]["labels"]))
    assert len(labels["labels"]) == report["input"]["faces"]
    events = get(server, job["urls"]["events"]).decode()
    numbers = [int(number) for number in re.findall(r"^id: (\d+)$", events, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1)), f"numbers are missing: {job['id']}"
    names = re.findall(r"^event: (\w+)$", events, re.MULTILINE)
    assert names.count("end") == 1 and names[-1] == "end", f"it did not end once: {job['id']}"
    attempts = [int(number) for number in re.findall(r'^data: {"state":"running","attempt":(\d+),', events, re.MULTILINE)]
    assert attempts == list(range(1, len(attempts) + 1)), f"attempts are missing: {job['id']}"
    return len(attempts)


def main():
    chance = random.Random(SEED)
    prepared = kinds()
    server = Server()
    server.start()
    server.wait_until_it_answers()
    stop = threading.Event()
    clients = [Client(server, prepared, number, stop) for number in range(CLIENTS)]
    for client in clients:
        client.start()
    started, kills = time.monotonic(), 0
    while kills < KILLS and time.monotonic() - started < SECONDS and not any(client.failure for client in clients):
        # half of the kills come before it answers, or while it takes up what the one before it left; the others after
        # some more jobs, however fast the machine is
        if chance.random() < 0.5:
            server.wait_until_it_answers()
            wanted, latest = count(clients) + chance.randrange(20), time.monotonic() + 5
            while count(clients) < wanted and time.monotonic() < latest:
                time.sleep(0.005)
        time.sleep(chance.uniform(0, 0.05))
        server.kill()
        kills += 1
        server.start()
    server.wait_until_it_answers()
    stop.set()
    for client in clients:
        client.join()
        if client.failure:
            print(server.tail())
            raise client.failure
    accepted = {id: kind for client in clients for id, kind in client.accepted.items()}
    deadline = time.monotonic() + 300
    while any(job["state"] in ("queued", "running") for job in jobs(server)):
        assert time.monotonic() < deadline, f"jobs do not end:\n{server.tail()}"
        time.sleep(0.2)
    known = {job["id"]: job for job in jobs(server)}
    assert known.keys() == accepted.keys(), \
        f"lost: {accepted.keys() - known.keys()}, nobody's: {known.keys() - accepted.keys()}"
    attempts = [check(server, known[id], prepared[kind][2]) for id, kind in accepted.items()]
    server.process.send_signal(signal.SIGTERM)
    assert server.process.wait(timeout=120) == 0, server.tail()
    uploads = {path.name for path in (DATA / "uploads").iterdir()}
    assert not uploads & accepted.keys(), "uploads of ended jobs are left"
    results = {path.name for path in (DATA / "results").iterdir()}
    large = {id for id, kind in accepted.items() if kind == len(prepared) - 1}
    assert results == large, "results that are nobody's are left, or some are missing"
    assert all(len(list(path.iterdir())) == 1 for path in (DATA / "results").iterdir()), "results of failed attempts"
    again = sum(count > 1 for count in attempts)
    print(f"{kills} kills in {time.monotonic() - started:.0f} s: {len(accepted)} jobs accepted, each ended once with its "
          f"labels; {again} ran more than once, {max(attempts)} times at most; {sum(c.retries for c in clients)} requests "
          f"asked again (SEED={SEED})")
    assert again > 0 and kills > 0, "nothing was interrupted: this tested nothing"
    assert len(accepted) > kills, "too few jobs: most kills met none"


if __name__ == "__main__":
    main()
