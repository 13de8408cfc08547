"""Several services on one PostgreSQL and one folder of blobs: shared work, and failures on purpose.

    python farm.py BINARY [JOBS [KILLS [STOPS [STREAMS]]]]

A front end (`--work off`) and two workers run. First, single things are shown across services: jobs that one accepts
and another does, events and results read elsewhere, cancellation, a request sent to two services at once, a worker that
is killed, a database that is stopped. Then JOBS (100) jobs come in at all services while KILLS (8) times a service is
ended by SIGKILL and started again, and STOPS (2) times the database is. In the end every job has ended once, with the
labels that the command line gives, its events are numbered without a gap, and no result is missing. `farm_failures` has
the checks that need a moment of their own, `farm_streams` STREAMS (1000) event streams of one job. At the end all jobs
expire, and the sweep leaves no file.

With FARM_OLD=BINARY in the environment, the services begin as those of an older release, and are replaced one by one
while jobs come in.
"""

import contextlib
import http.client
import json
import os
import pathlib
import random
import sys
import threading
import time
import uuid

import farm_failures
import farm_streams
from database import Database
from farm_replica import (
    BINARY, BLOBS, LEASE, MANY, SMALL, WORK, Kind, Replica, check, ended, submitted, wait_for
)

JOBS, KILLS, STOPS, STREAMS = (int(sys.argv[place]) if len(sys.argv) > place else number
                               for place, number in [(2, 100), (3, 8), (4, 2), (5, 1000)])
SEED = int(os.environ.get("SEED", random.randrange(1 << 30)))
CLIENTS = 8
# binary of an older release
OLD = pathlib.Path(os.environ["FARM_OLD"]).resolve() if os.environ.get("FARM_OLD") else None


def show_single_things(database, front, workers, kinds, long):
    everyone = [front, *workers]
    # accepted anywhere, done once, read anywhere
    ids = [(submitted(kind, replica)["id"], kind) for kind in kinds for replica in everyone]
    done_by = set()
    for number, (id, kind) in enumerate(ids):
        done_by.add(ended(front, id)["worker"])
        assert check(everyone[number % 3], id, kind.digest) == 1
    assert done_by <= {worker.name for worker in workers}, done_by
    job = submitted(kinds[0], front, {"Prefer": "wait=30"})
    assert job["state"] == "succeeded", "a front end waits for what a worker does"
    print(f"farm: {len(ids)} jobs of three services, done once, with the labels of the command line")

    # one request at two services at once
    key, answers = {"Idempotency-Key": f'"{uuid.uuid4()}"'}, []
    threads = [threading.Thread(target=lambda replica=replica: answers.append(submitted(kinds[0], replica, key)["id"]))
               for replica in everyone * 4]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 12 and len(set(answers)) == 1, answers

    # live events at another service, and a cancellation there
    id = submitted(long, workers[0])["id"]
    connection = http.client.HTTPConnection(*front.address, timeout=60)
    connection.request("GET", f"/v1/jobs/{id}/events", headers={"Authorization": f"Bearer {MANY}"})
    stream = connection.getresponse()
    lines = []
    while "event: iteration" not in lines:
        lines.append(stream.readline().decode().strip())
        assert len(lines) < 1000
    assert front.job(id)["state"] == "running", "events come while the job runs"
    started = time.monotonic()
    front.request("DELETE", f"/v1/jobs/{id}")
    assert ended(workers[1], id)["state"] == "cancelled"
    rest = stream.read().decode()
    assert "event: end" in rest, rest
    print(f"farm: events elsewhere as they come; cancelled from elsewhere in {time.monotonic() - started:.1f} s")

    # a worker is killed in the middle of a job
    id = submitted(long, front)["id"]
    name = wait_for(lambda: front.job(id)["progress"]["iterations"] > 0 and front.job(id)["worker"], "it runs")
    killed = next(worker for worker in workers if worker.name == name)
    killed.kill()
    started = time.monotonic()
    job = wait_for(lambda: (job := front.job(id))["attempt"] == 2 and job, "another worker has it", 3 * LEASE)
    assert job["worker"] != name, "another worker has it"
    print(f"farm: taken over from a killed worker in {time.monotonic() - started:.1f} s with leases of {LEASE} s")
    killed.start()
    assert ended(front, id, 120)["state"] == "succeeded" and check(killed_or(front, killed), id, long.digest) == 2

    # the database is stopped
    waiting = [submitted(kind, front)["id"] for kind in kinds * 3]
    database.kill()
    status, body, headers = kinds[0].submit(front)
    assert status == 503 and headers["Retry-After"] and b"/problems/unavailable" in body, (status, body)
    wait_for(lambda: front.request("GET", "/readyz")[0] == 503, "not ready without a database")
    assert front.request("GET", "/healthz")[0] == 200
    database.start()
    for replica in everyone:
        replica.wait_until_ready()
    for id, kind in zip(waiting, kinds * 3):
        assert ended(front, id)["state"] == "succeeded"
        check(workers[0], id, kind.digest)
    print("farm: 503 while the database is stopped, and nothing lost")


def killed_or(front, killed):
    killed.wait_until_ready()
    return killed


class Client(threading.Thread):
    """Submits its share of the jobs at random services, each with a key, until it is answered."""

    def __init__(self, replicas, kinds, number):
        super().__init__()
        self.replicas, self.kinds = replicas, kinds
        self.random = random.Random(SEED + number)
        self.count = JOBS // CLIENTS
        self.accepted, self.retries, self.failure = {}, 0, None

    def run(self):
        try:
            for _ in range(self.count):
                kind = self.random.randrange(len(self.kinds))
                self.accepted[self.submit(self.kinds[kind])] = kind
                time.sleep(self.random.uniform(0, 0.2))
        except BaseException as failure:
            self.failure = failure

    def submit(self, kind):
        key = {"Idempotency-Key": f'"{uuid.UUID(int=self.random.getrandbits(128))}"'}
        deadline = time.monotonic() + 120
        while True:
            with contextlib.suppress(OSError):
                status, body, _ = kind.submit(self.random.choice(self.replicas), key)
                if status in (200, 202):
                    return json.loads(body)["id"]
                assert status in (429, 503), f"{status}: {body!r}"
            self.retries += 1
            assert time.monotonic() < deadline, "no answer for two minutes"
            time.sleep(0.1)


def survive(database, replicas, kinds):
    chance = random.Random(SEED)
    clients = [Client(replicas, kinds, number) for number in range(CLIENTS)]
    for client in clients:
        client.start()
    started = time.monotonic()
    failures = ["kill"] * KILLS + ["stop"] * STOPS
    chance.shuffle(failures)
    for failure in failures:
        time.sleep(chance.uniform(0.2, 1.2))
        if failure == "stop":
            database.kill()
            time.sleep(chance.uniform(0, 1))
            database.start()
        else:
            replica = chance.choice(replicas)
            replica.kill()
            replica.start()
        for replica in replicas:
            # one that started while the database was stopped ends, as its supervisor would see
            if replica.process.poll() is not None:
                replica.start()
    for client in clients:
        client.join()
        if client.failure:
            raise client.failure
    for replica in replicas:
        if replica.process.poll() is not None:
            replica.start()
        replica.wait_until_ready()
    accepted = {id: kind for client in clients for id, kind in client.accepted.items()}
    attempts = []
    for number, (id, kind) in enumerate(accepted.items()):
        assert ended(replicas[0], id, 180)["state"] == "succeeded", replicas[0].job(id)
        attempts.append(check(replicas[number % len(replicas)], id, kinds[kind].digest))
    live = database.ask("SELECT count(*) FROM tesserae.jobs WHERE state IN ('queued', 'running')")
    assert live == "0", f"{live} jobs have not ended"
    print(f"farm: {KILLS} services and {STOPS} databases killed within {time.monotonic() - started:.0f} s: "
          f"{len(accepted)} jobs accepted, each ended once with its labels; {sum(count > 1 for count in attempts)} ran "
          f"more than once, {max(attempts)} times at most; {sum(client.retries for client in clients)} requests again "
          f"(SEED={SEED})")
    return accepted


def check_files(database):
    """Files of jobs that succeeded are there, of the attempt that did; uploads of jobs that ended are not."""
    known = dict(line.split("|") for line in database.ask(
        "SELECT id, attempt FROM tesserae.jobs WHERE state = 'succeeded' AND NOT (summary::json ->> 'is_small')::boolean"
    ).splitlines())
    found = {folder.name: {attempt.name for attempt in folder.iterdir()}
             for folder in (BLOBS / "results").iterdir()} if (BLOBS / "results").exists() else {}
    lost = [id for id, attempt in known.items() if attempt not in found.get(id, ())]
    assert not lost, f"results are missing: {lost}"
    assert not database.ask("SELECT 1 FROM tesserae.events GROUP BY job HAVING max(seq) <> count(*)"), "events"


def main():
    kinds = [Kind("sphere", 60, ["--clusters", "4"]), Kind("knot", 200, ["--clusters", "9"]),
             Kind("torus", 100, ["--algorithm", "pml", "--clusters", "5"]),
             # its upload is a file, which those of the others are not
             Kind("plane", 6000, ["--clusters", "60", "--max-iterations", "13"], SMALL)]
    long = Kind("terrain", 200_000, ["--clusters", "2000", "--quality", "best"])
    with Database() as database, contextlib.ExitStack() as stack:
        replicas = []
        try:
            for name, work in [("front", "off"), ("one", "on"), ("two", "on")]:
                arguments = ["--work", work, "--data-dir", WORK / f"data-{name}"]
                replicas.append(Replica(name, database, OLD or BINARY, *arguments))
                stack.callback(lambda replica=replicas[-1]: replica.process.poll() is None and replica.kill())
            for replica in replicas:
                replica.wait_until_ready()
            front, *workers = replicas
            if OLD:
                farm_failures.rolling_update(replicas, kinds)
            farm_failures.read_tokens_again(front)
            show_single_things(database, front, workers, kinds, long)
            farm_failures.stream_across_a_kill(front, workers, long)
            for worker in workers:
                worker.stop()
            farm_streams.follow_one_job(database, kinds[2], STREAMS)
            farm_failures.frozen_database(database, kinds, long)
            for worker in workers:
                worker.start()
                worker.wait_until_ready()
            farm_failures.flood(database, front, workers, kinds[0], min(1000, 2 * JOBS))
            survive(database, replicas, kinds)
            check_files(database)
            for replica in replicas:
                replica.stop()
            farm_failures.nothing_is_left(database, front)
            assert database.ask(f"SELECT count(*) FROM tesserae.workers WHERE name = '{front.name}'") == "0"
            for replica in replicas:
                assert "not-a-secret" not in (WORK / f"{replica.part}.log").read_text(errors="replace"), "a password"
        except BaseException:
            for replica in replicas:
                print(f"--- {replica.part}\n{replica.tail()}")
            raise


if __name__ == "__main__":
    main()
