"""Checks that need a moment: a stream whose service dies, a frozen database, a flood, a rolling update, and what is left at the end."""

import http.client
import json
import os
import threading
import time
import types

from farm_replica import (
    BINARY, BLOBS, FEW, MANY, Replica, check, ended, new_token, submitted, wait_for
)
from gate import Gate

# jobs that a worker has at a time by default, and the one for a newcomer
PLACES = 9


def read_tokens_again(front):
    """The tenant of the checks may list workers from now on: the file is read again when it changes."""
    assert front.request("GET", "/v1/workers")[0] == 403
    new_token("many", "--metrics")
    wait_for(lambda: front.request("GET", "/v1/workers")[0] == 200, "the tokens are read again")


def check_end(replica, id, kind):
    assert ended(replica, id, 180)["state"] == "succeeded"
    return check(replica, id, kind.digest)


def read_events(replica, id, after, enough):
    """Numbers and names of events after a number, until there are enough or the stream ends."""
    connection = http.client.HTTPConnection(*replica.address, timeout=120)
    connection.request("GET", f"/v1/jobs/{id}/events",
                       headers={"Authorization": f"Bearer {MANY}", "Last-Event-ID": str(after)})
    stream, events, number, name = connection.getresponse(), [], 0, None
    assert stream.status == 200, stream.read()
    while len(events) < enough and (line := stream.readline().decode()):
        field, _, value = line.strip().partition(": ")
        if field == "id":
            number = int(value)
        elif field == "event":
            name = value
        elif not field and name:
            events.append((number, name))
            name = None
    connection.close()
    return events


def stream_across_a_kill(front, workers, long):
    """A stream goes on at another service where the one that died left off."""
    id = submitted(long, front)["id"]
    name = wait_for(lambda: front.job(id)["progress"]["iterations"] > 0 and front.job(id)["worker"], "it runs")
    other = next(worker for worker in workers if worker.name != name)
    first = read_events(front, id, 0, 4)
    front.kill()
    rest = read_events(other, id, first[-1][0], 1 << 30)
    front.start()
    front.wait_until_ready()
    numbers = [number for number, _ in first + rest]
    assert numbers == list(range(1, len(numbers) + 1)), numbers
    assert rest[-1][1] == "end", rest[-1]
    print(f"farm: {len(first)} events at a service that was killed, {len(rest)} at another one, without a gap")


def frozen_database(database, kinds, long):
    """PostgreSQL takes connections and answers nothing: as an overloaded machine, or a network that drops packets."""
    gate = Gate(database.port)
    behind = types.SimpleNamespace(url=database.url.replace(f":{database.port}/", f":{gate.address[1]}/"))
    front, worker = [Replica(f"frozen-{name}", behind, BINARY, "--work", work)
                     for name, work in [("front", "off"), ("worker", "on")]]
    try:
        for replica in (front, worker):
            replica.wait_until_ready()
        running = submitted(long, front)["id"]
        wait_for(lambda: front.job(running)["progress"]["iterations"] > 0, "it runs")
        waiting = [(submitted(kind, front)["id"], kind) for kind in kinds]
        gate.freeze()
        started = time.monotonic()
        status, body, headers = kinds[0].submit(front)
        assert status == 503 and headers["Retry-After"] and b"/problems/unavailable" in body, (status, body)
        took = time.monotonic() - started
        wait_for(lambda: front.request("GET", "/readyz")[0] == 503, "not ready without a database")
        assert front.request("GET", "/healthz")[0] == 200
        # a lease is over, by the clock of the database
        wait_for(lambda: database.ask(f"SELECT 1 FROM tesserae.jobs WHERE id = '{running}' AND state = 'running' "
                                      "AND lease_until < extract(epoch FROM clock_timestamp()) * 1000000"), "no heartbeat arrives")
        gate.thaw()
        for replica in (front, worker):
            replica.wait_until_ready()
        attempts = [check_end(front, id, kind) for id, kind in [(running, long), *waiting]]
        print(f"farm: 503 after {took:.1f} s while the database was frozen; then all of {len(attempts)} jobs ended once, "
              f"after {max(attempts)} attempts at most")
    finally:
        gate.thaw()
        for replica in (front, worker):
            replica.stop()


def flood(database, front, workers, kind, count):
    """One tenant has many jobs; another one's single job starts when a place is free."""
    def listed():
        return {worker["name"] for worker in json.loads(front.get("/v1/workers"))["workers"]}
    wait_for(lambda: listed() >= {worker.name for worker in workers}, "all workers are listed")
    # SIGTERM drains: the jobs wait
    for worker in workers:
        worker.stop()
    threads = [threading.Thread(target=lambda: [submitted(kind, front) for _ in range(count // 8)]) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    def waiting():
        return int(database.ask("SELECT count(*) FROM tesserae.jobs WHERE state = 'queued'"))
    assert waiting() == count // 8 * 8
    for worker in workers:
        worker.start()
    wait_for(lambda: waiting() < count * 7 // 8, "an eighth has started", 120)
    few = {"Authorization": f"Bearer {FEW}"}
    status, body, _ = kind.submit(front, few)
    assert status == 202, body
    id = json.loads(body)["id"]
    wait_for(lambda: json.loads(front.request("GET", f"/v1/jobs/{id}", headers=few)[1])["state"] == "succeeded",
             "the other tenant's job", 120)
    left = waiting()
    assert left > 0, "the flood was over before"
    before = int(database.ask(
        f"SELECT count(*) FROM tesserae.jobs AS flood, tesserae.jobs AS one WHERE one.id = '{id}' "
        "AND flood.tenant = 'many' AND flood.started_at > one.created_at AND flood.started_at < one.started_at"))
    assert before <= PLACES * len(workers), before
    wait = database.ask(f"SELECT (started_at - created_at) / 1000 FROM tesserae.jobs "
                        f"WHERE id = '{id}'")
    wait_for(lambda: database.ask("SELECT 1 FROM tesserae.jobs WHERE state IN ('queued', 'running') LIMIT 1") == "",
             "the flood ends", 300)
    print(f"farm: another tenant's job started after {wait} ms and {before} jobs of a flood of {count}, of which "
          f"{left} still waited when it had ended")


def rolling_update(replicas, kinds):
    """Services of an older release are replaced one by one while jobs come in."""
    accepted, stop, failures = [], threading.Event(), []

    def submit():
        number = 0
        while not stop.is_set():
            kind = kinds[number % len(kinds)]
            try:
                status, body, _ = kind.submit(replicas[number % len(replicas)])
            except OSError:
                status = None
            if status == 202:
                accepted.append((json.loads(body)["id"], kind))
            elif status not in (None, 429, 503):
                failures.append((status, body))
            number += 1
    client = threading.Thread(target=submit)
    client.start()
    try:
        for replica in [replicas[1], replicas[0], replicas[2]]:
            enough = len(accepted) + 20
            wait_for(lambda: len(accepted) > enough or failures, "jobs come in")
            replica.stop()
            replica.binary = BINARY
            replica.start()
            replica.wait_until_ready()
        enough = len(accepted) + 20
        wait_for(lambda: len(accepted) > enough or failures, "jobs come in")
    finally:
        stop.set()
        client.join()
    assert not failures, failures
    for number, (id, kind) in enumerate(accepted):
        check_end(replicas[number % len(replicas)], id, kind)
    print(f"farm: {len(accepted)} jobs during a rolling update, each ended once with its labels")


def nothing_is_left(database, front):
    """Jobs expire, and the sweep removes what killed services left."""
    eight_days_ago = time.time() - 8 * 86_400

    def files():
        return [os.path.join(folder, name) for folder, _, names in os.walk(BLOBS) for name in names if name != "owner"]
    # what a service leaves that is killed while it probes its storage
    probe = BLOBS / "probes" / "left" / "probe"
    probe.parent.mkdir(parents=True)
    probe.write_text("probe")
    leftovers = files()
    for path in leftovers:
        os.utime(path, (eight_days_ago, eight_days_ago))
    front.arguments += ["--retention", "1"]
    front.start()
    front.wait_until_ready()
    wait_for(lambda: database.ask("SELECT count(*) FROM tesserae.jobs") == "0", "all jobs expire", 120)
    try:
        wait_for(lambda: not files(), f"{len(leftovers)} files go", 120)
    finally:
        print(*files(), sep="\n", end="")
    front.stop()
    print(f"farm: all jobs expired, and of {len(leftovers)} files none is left after the sweep")
