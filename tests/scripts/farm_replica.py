"""What the checks of a farm share: its services, its jobs, and waiting for them."""

import contextlib
import http.client
import json
import pathlib
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time

BINARY = pathlib.Path(sys.argv[1]).resolve()
TEMPORARY = tempfile.TemporaryDirectory(prefix="tesserae-farm-")
WORK = pathlib.Path(TEMPORARY.name)
BLOBS = WORK / "blobs"
TOKENS = WORK / "tokens.json"
# bytes above which an upload is a file
SMALL = 256 << 10
# seconds after which the jobs of a killed worker are given to another one, at most
LEASE = 30


def new_token(tenant, *options):
    made = subprocess.run([BINARY, "token", "new", tenant, "--tokens", TOKENS, *options], check=True,
                          stdout=subprocess.PIPE, text=True)
    return made.stdout.strip()


# tenants: one for most jobs, one with few
MANY, FEW = new_token("many"), new_token("few")


class Replica:
    """A service of the farm, which is killed and started again, always at the same address."""

    def __init__(self, name, database, binary, *arguments):
        self.part = name
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = probe.getsockname()
        self.log = open(WORK / f"{self.part}.log", "ab")
        self.binary = binary
        self.arguments = [
            "serve", "--listen", "%s:%d" % self.address, "--store", database.url, "--blobs", BLOBS,
            "--tokens", TOKENS, "--device", "cpu", "--min-free-bytes", "0", "--log", "info",
            "--max-queued-jobs", "100000", "--max-queued-jobs-per-tenant", "100000",
            "--crash-pause", "0",
            # kills are so many that a job may be alone at work in several
            "--max-attempts", "1000", *arguments]
        self.start()

    def start(self):
        self.process = subprocess.Popen(
            [self.binary, *self.arguments], stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log)

    @property
    def name(self):
        """As jobs tell which worker had them: new at every start."""
        return f"{socket.gethostname()}-{self.process.pid}"

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(timeout=60)
        assert status == 0, f"{self.part} ended with {status}:\n{self.tail()}"

    def tail(self):
        return (WORK / f"{self.part}.log").read_text(errors="replace")[-3000:]

    def request(self, method, path, body=None, headers={}, timeout=60):
        connection = http.client.HTTPConnection(*self.address, timeout=timeout)
        try:
            connection.request(method, path, body, {"Authorization": f"Bearer {MANY}", **headers})
            answer = connection.getresponse()
            return answer.status, answer.read(), answer.headers
        except http.client.HTTPException as error:
            raise ConnectionError(str(error)) from error
        finally:
            connection.close()

    def get(self, path):
        status, body, _ = self.request("GET", path)
        assert status == 200, f"{self.part}: GET {path}: {status} {body!r}"
        return body

    def job(self, id):
        return json.loads(self.get(f"/v1/jobs/{id}"))

    def wait_until_ready(self):
        def is_ready():
            with contextlib.suppress(OSError):
                return self.request("GET", "/readyz")[0] == 200
            assert self.process.poll() is None, f"{self.part} ended by itself:\n{self.tail()}"
        wait_for(is_ready, f"{self.part} is ready")


def wait_for(condition, what, seconds=60):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.02)
    return found


class Kind:
    """A job, and the labels that the command line gives for it."""

    def __init__(self, name, faces, flags, comment=0):
        mesh, report = WORK / f"{name}-{faces}.obj", WORK / f"{name}.json"
        subprocess.run([BINARY, "sample", name, "--faces", str(faces), mesh], check=True, stdout=subprocess.DEVNULL)
        with mesh.open("a") as file:
            file.write("# a comment as long as a large mesh\n" * (comment // 36))
        subprocess.run([BINARY, "cluster", mesh, *flags, "--device", "cpu", "--report", report, "--labels",
                        WORK / f"{name}.npy"], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.query = "&".join(f"{flag[2:].replace('-', '_')}={value}" for flag, value in zip(flags[::2], flags[1::2]))
        self.mesh, self.digest = mesh.read_bytes(), json.loads(report.read_text())["labels_sha256"]

    def submit(self, replica, headers={}):
        return replica.request("POST", f"/v1/jobs?{self.query}", self.mesh, {"Content-Type": "model/obj", **headers})


def submitted(kind, replica, headers={}):
    status, body, _ = kind.submit(replica, headers)
    assert status in (200, 202), f"{status} {body!r}"
    return json.loads(body)


def ended(replica, id, seconds=60):
    def job():
        with contextlib.suppress(OSError, AssertionError):
            found = replica.job(id)
            return found if found["state"] in ("succeeded", "failed", "cancelled") else None
    return wait_for(job, f"the end of {id}", seconds)


def check(replica, id, digest):
    """Result and events of a job that succeeded, as one service tells them; the number of its attempts."""
    job = replica.job(id)
    assert job["state"] == "succeeded", job
    report = json.loads(replica.get(f"/v1/jobs/{id}/report"))
    assert report["labels_sha256"] == digest, f"other labels: {id}"
    assert len(json.loads(replica.get(f"/v1/jobs/{id}/labels"))["labels"]) == report["input"]["faces"]
    events = replica.get(f"/v1/jobs/{id}/events").decode()
    numbers = [int(number) for number in re.findall(r"^id: (\d+)$", events, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1)), f"numbers of events are missing: {id}: {numbers}"
    names = re.findall(r"^event: (\w+)$", events, re.MULTILINE)
    assert names.count("end") == 1 and names[-1] == "end", f"it did not end once: {id}"
    attempts = re.findall(r'^data: {"state":"running","attempt":(\d+),', events, re.MULTILINE)
    assert [int(attempt) for attempt in attempts] == list(range(1, len(attempts) + 1)), f"{id}: {attempts}"
    return len(attempts)
