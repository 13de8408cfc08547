"""Many event streams of one job, over two front ends."""

import asyncio
import json
import re
import resource
import subprocess
import time

from farm_replica import BINARY, MANY, TOKENS, WORK, Replica, ended, submitted
from service import resident


# streams from one address: a service takes 2,048 connections from one
FROM_ADDRESS = 1000


async def open_stream(replica, path, number):
    """A stream of a job's events that has given its first one: both ends of the connection, and that event."""
    # not the address of the services: a port of a stream could be that of the worker, which starts later
    address = f"127.0.0.{2 + number // FROM_ADDRESS}"
    reader, writer = await asyncio.open_connection(*replica.address, local_addr=(address, 0))
    host = "%s:%d" % replica.address
    # 1.0, so that the stream comes without the lengths of chunks
    writer.write(f"GET {path} HTTP/1.0\r\nHost: {host}\r\nAuthorization: Bearer {MANY}\r\n\r\n".encode())
    head = await reader.readuntil(b"\r\n\r\n")
    assert b" 200 " in head.split(b"\r\n")[0], head
    return reader, writer, await reader.readuntil(b"\n\n")


async def read_to_end(reader, writer, first):
    """Numbers and names of the events of a stream."""
    text = (first + await reader.read()).decode()
    writer.close()
    return re.findall(r"^id: (\d+)$", text, re.MULTILINE), re.findall(r"^event: (\w+)$", text, re.MULTILINE)


async def follow_all(fronts, worker, path, count):
    """What every stream had, memory with all of them open, seconds to open them, and those from the worker's start on."""
    started, at_once = time.monotonic(), asyncio.Semaphore(100)

    async def one(number):
        async with at_once:
            return await open_stream(fronts[number % 2], path, number)

    streams = await asyncio.gather(*(one(number) for number in range(count)))
    full = [resident(front.process) for front in fronts]
    opening, started = time.monotonic() - started, time.monotonic()
    worker.start()
    seen = await asyncio.wait_for(asyncio.gather(*(read_to_end(*stream) for stream in streams)), 300)
    return seen, full, opening, time.monotonic() - started


def follow_one_job(database, kind, count):
    """Each of `count` streams has all events of a job once, in their order, wherever it is open."""
    if count == 0:
        return
    resource.setrlimit(resource.RLIMIT_NOFILE, (resource.getrlimit(resource.RLIMIT_NOFILE)[1],) * 2)
    quota = json.dumps({"max_streams": count})
    subprocess.run([BINARY, "token", "quota", "many", quota, "--tokens", TOKENS], check=True)
    names = [("stream-front-1", ["--work", "off"]), ("stream-front-2", ["--work", "off"]),
             ("stream-worker", ["--work", "on"])]
    replicas = []
    try:
        for name, arguments in names:
            replicas.append(Replica(name, database, BINARY, "--data-dir", WORK / f"data-{name}", *arguments))
            replicas[-1].wait_until_ready()
        *fronts, worker = replicas
        worker.stop()
        empty = [resident(front.process) for front in fronts]
        id = submitted(kind, fronts[0])["id"]
        seen, full, opening, lasting = asyncio.run(follow_all(fronts, worker, f"/v1/jobs/{id}/events", count))
        numbers, events = seen[0]
        assert numbers == [str(number) for number in range(1, len(numbers) + 1)], numbers
        assert events[-1] == "end" and events.count("end") == 1, events
        others = [index for index, other in enumerate(seen) if other != seen[0]]
        assert not others, f"streams differ from the first one: {others[:9]}"
        assert ended(fronts[1], id)["state"] == "succeeded"
        each = (sum(full) - sum(empty)) / count * 1024
        print(f"farm: {count} event streams over two front ends, open within {opening:.1f} s, {each:.0f} KiB of memory "
              f"each; all had the {len(numbers)} events of a job {lasting:.1f} s after its worker was started")
    except BaseException:
        for replica in replicas:
            print(f"--- {replica.part}\n{replica.tail()}")
        raise
    finally:
        for replica in replicas:
            if replica.process.poll() is None:
                replica.kill()
