"""What the client does that takes more than one request.

Each function is a generator of effects (see `exchange`). A request whose answer was lost is made again where that does
no harm: uploads have a key, reading and cancelling change nothing the second time. A repeated ``DELETE`` may find that
the job is gone.
"""

from __future__ import annotations

import math
import time
import uuid
from dataclasses import replace
from typing import IO, TYPE_CHECKING, Mapping, cast

from tesserae_mesh.client.errors import Busy, Conflict, JobCancelled, JobFailed, NotFound, TimedOut
from tesserae_mesh.client.exchange import (
    Answer,
    Broken,
    Patience,
    Pause,
    Request,
    Steps,
    error_in,
    exchange,
    members,
    send,
)
from tesserae_mesh.client.operations import OPERATIONS
from tesserae_mesh.client.upload import form_of, is_in_bucket

if TYPE_CHECKING:
    from tesserae_mesh.client.documents import JobDocument, JobList
    from tesserae_mesh.client.options import MeshSource, SubmitOptions

ENDED = ("succeeded", "failed", "cancelled")


def submit(mesh: MeshSource, options: SubmitOptions, patience: float) -> Steps[JobDocument]:
    """Uploads a mesh."""
    wait = options.get("wait")
    key = options.get("idempotency_key") or str(uuid.uuid4())
    query: dict[str, str | None] = {"format": options.get("format")}
    headers = {"Prefer": None if wait is None else f"wait={math.ceil(wait)}", "Idempotency-Key": key}
    with form_of(mesh, options) as form:
        if is_in_bucket(mesh):
            query["mesh_url"] = cast(str, mesh)
        request = OPERATIONS["createJob"].request(query=query, headers=headers)
        answer = yield from exchange(replace(request, form=form, extra_time=wait or 0.0), patience)
    if answer.status < 400:
        return cast("JobDocument", members(answer))
    return (yield from show(answer.headers["location"].rsplit("/", 1)[-1], patience))


def show(id: str, patience: float) -> Steps[JobDocument]:
    """The job."""
    return cast("JobDocument", members((yield from exchange(OPERATIONS["getJob"].request(id), patience))))


def page(state: str | None, cursor: str | None, limit: int | None, patience: float) -> Steps[JobList]:
    """A page of the list of jobs."""
    request = OPERATIONS["listJobs"].request(query={"state": state, "cursor": cursor, "limit": limit})
    return cast("JobList", members((yield from exchange(request, patience))))


def wait(id: str, timeout: float | None, patience: float) -> Steps[JobDocument]:
    """The job once it has succeeded. It is looked at after each tenth of the time so far, at most 2 s apart."""
    began = time.monotonic()
    while True:
        job = yield from show(id, patience)
        if job["state"] == "succeeded":
            return job
        if job["state"] == "cancelled":
            raise JobCancelled(id)
        if job["state"] == "failed" and job["problem"] is not None:
            raise JobFailed(id, job["problem"])
        passed = time.monotonic() - began
        pause = min(max(passed / 10, 0.02), 2.0)
        if timeout is not None:
            if passed >= timeout:
                raise TimedOut(id, timeout)
            pause = min(pause, timeout - passed)
        yield Pause(pause)


def cancel(id: str, patience: float) -> Steps[JobDocument]:
    """Cancels a job that has not ended."""
    request = OPERATIONS["deleteJob"].request(id, query={"cancel": True})
    return cast("JobDocument", members((yield from exchange(request, patience))))


def delete(id: str, patience: float) -> Steps[None]:
    """Deletes a job, after its end where it has not ended."""
    pauses = Patience(patience)
    request = OPERATIONS["deleteJob"].request(id)
    may_be_done = False
    pause = 0.02
    while True:
        outcome = yield from send(request)
        error = error_in(request, outcome)
        if error is None and isinstance(outcome, Answer):
            if outcome.status != 202:
                return
            # It will be cancelled.
            pauses.succeeded()
            pause = min(2 * pause, 1.0)
            yield Pause(pause)
        elif isinstance(error, NotFound) and may_be_done:
            return
        elif error is not None:
            yield Pause(pauses.pause_after(error))
        may_be_done = may_be_done or not isinstance(error, Busy)


def retry(id: str, patience: float) -> Steps[JobDocument]:
    """Runs a job again that was given up."""
    pauses = Patience(patience)
    request = OPERATIONS["retryJob"].request(id)
    has_tried = False
    while True:
        outcome = yield from send(request)
        error = error_in(request, outcome)
        if error is None and isinstance(outcome, Answer):
            return cast("JobDocument", members(outcome))
        if isinstance(error, Conflict) and has_tried:
            job = yield from show(id, patience)
            if job["state"] != "failed":
                return job
        if error is not None:
            yield Pause(pauses.pause_after(error))
        has_tried = isinstance(outcome, Broken) or has_tried


def download(request: Request, file: IO[bytes], patience: float) -> Steps[None]:
    """Writes an answer to a file, from where an earlier attempt broke off.

    ``If-Range`` makes the service begin again if the result has become another one.
    """
    pauses = Patience(patience)
    etag: str | None = None
    while True:
        headers: Mapping[str, str] = {**request.headers, "accept-encoding": "identity"}
        done = file.tell()
        if done and etag:
            headers = {**headers, "range": f"bytes={done}-", "if-range": etag}
        attempt = replace(request, headers=headers, into=file)
        outcome = yield from send(attempt)
        error = error_in(attempt, outcome)
        if error is None:
            return
        if isinstance(outcome, Broken):
            etag = outcome.headers.get("etag", etag)
            if file.tell() > done:
                pauses.succeeded()
        yield Pause(pauses.pause_after(error))
