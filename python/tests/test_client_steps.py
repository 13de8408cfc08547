"""What the client does when answers are lost or refused: without a network, and without waiting."""

from __future__ import annotations

import io
import json
from typing import Any, Callable

import numpy as np
import pytest

from tesserae_mesh import Error, Mesh
from tesserae_mesh.client import (
    Busy,
    Conflict,
    InvalidRequest,
    JobCancelled,
    JobFailed,
    NotFound,
    ServiceError,
    TimedOut,
    Unreachable,
    errors,
    exchange,
    results,
    steps,
    upload,
)
from tesserae_mesh.client.events import Reader
from tesserae_mesh.client.exchange import Answer, Broken, Pause, Request
from tesserae_mesh.client.operations import OPERATIONS

ID = "00000000-0000-4000-8000-000000000000"
LOST = Broken(ConnectionResetError("reset"))
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def job(state: str, **members: Any) -> Answer:
    document = {"id": ID, "state": state, "cancel_requested": False, "problem": None, **members}
    return Answer(200, {}, json.dumps(document).encode())


def problem(kind: str, status: int, **headers: str) -> Answer:
    document = {"type": f"/problems/{kind}", "title": kind, "status": status, "detail": f"{kind}!", "instance": "/v1"}
    return Answer(status, headers, json.dumps(document).encode())


class Clock:
    """Time that passes in pauses only."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0.0
        monkeypatch.setattr("tesserae_mesh.client.exchange.time.monotonic", lambda: self.now)
        monkeypatch.setattr("tesserae_mesh.client.exchange.random.uniform", lambda low, high: high)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def play(
    task: exchange.Steps[Any], answers: list[Answer | Broken | Callable[[Request], Answer | Broken]], clock: Clock
) -> tuple[Any, list[Request], list[float]]:
    """Result, requests and pauses of steps that get these answers."""
    requests: list[Request] = []
    pauses: list[float] = []
    outcome: Any = None
    left = list(answers)
    while True:
        try:
            effect = task.send(outcome)
        except StopIteration as end:
            assert not left, "not all answers were asked for"
            return end.value, requests, pauses
        if isinstance(effect, Pause):
            clock.now += effect.seconds
            pauses.append(effect.seconds)
            outcome = None
        else:
            requests.append(effect)
            next_ = left.pop(0)
            outcome = next_ if isinstance(next_, (Answer, Broken)) else next_(effect)


def test_a_lost_upload_is_made_again_with_the_same_key(clock: Clock) -> None:
    busy = problem("queue-full", 429, **{"retry-after": "7"})
    result, requests, pauses = play(
        steps.submit(OBJ, {"clusters": 2}, 60.0), [LOST, busy, problem("unavailable", 503), job("queued")], clock
    )
    assert result["id"] == ID
    assert len({request.headers["Idempotency-Key"] for request in requests}) == 1
    assert len(requests) == 4
    assert pauses == [0.2, 7.0, 0.8]


def test_two_uploads_have_two_keys(clock: Clock) -> None:
    keys = set()
    for _ in range(2):
        _, requests, _ = play(steps.submit(OBJ, {}, 60.0), [job("queued")], clock)
        keys.add(requests[0].headers["Idempotency-Key"])
    assert len(keys) == 2


def test_a_mistake_is_not_repeated(clock: Clock) -> None:
    with pytest.raises(InvalidRequest, match="invalid-parameter!") as caught:
        play(steps.submit(OBJ, {}, 60.0), [problem("invalid-parameter", 422)], clock)
    assert caught.value.kind == "invalid-parameter"
    assert caught.value.status == 422
    assert isinstance(caught.value, Error)


def test_patience_ends(clock: Clock) -> None:
    with pytest.raises(Unreachable, match="reset") as caught:
        play(steps.show(ID, 5.0), [LOST] * 100, clock)
    assert caught.value.kind == "unreachable"
    assert 2.0 < clock.now <= 5.0
    with pytest.raises(Busy) as refused:
        play(steps.show(ID, 5.0), [problem("overloaded", 503, **{"retry-after": "30"})], clock)
    assert refused.value.retry_after == 30


def test_a_proxy_without_problem_documents_is_understood(clock: Clock) -> None:
    page = Answer(502, {"content-type": "text/html"}, b"<h1>bad gateway</h1>")
    result, _, pauses = play(steps.show(ID, 60.0), [page, job("running")], clock)
    assert result["state"] == "running"
    assert len(pauses) == 1
    with pytest.raises(NotFound, match="status 404") as caught:
        play(steps.show(ID, 60.0), [Answer(404, {}, b"[]")], clock)
    assert caught.value.kind == "http-404"


def test_every_kind_becomes_its_class() -> None:
    for kind, made in errors.KINDS.items():
        body = problem(kind, 400).body
        error = errors.error_of(400, {}, body, "/v1")
        assert type(error) is made
        assert error.kind == kind
    assert type(errors.error_of(418, {}, problem("teapot", 418).body, "/v1")) is ServiceError


def test_the_problem_of_a_job_that_ended_in_time_is_no_error_of_the_upload(clock: Clock) -> None:
    failed = problem("invalid-mesh", 422, location=f"/v1/jobs/{ID}")
    result, requests, _ = play(steps.submit(OBJ, {"wait": 2.5}, 60.0), [failed, job("failed")], clock)
    assert result["state"] == "failed"
    assert requests[0].headers["Prefer"] == "wait=3"
    assert requests[0].extra_time == 2.5
    assert requests[1].path == f"/v1/jobs/{ID}"


def test_waiting_raises_what_ended_the_job(clock: Clock) -> None:
    result, requests, _ = play(steps.wait(ID, None, 60.0), [job("queued"), job("running"), job("succeeded")], clock)
    assert result["state"] == "succeeded"
    assert len(requests) == 3
    with pytest.raises(JobCancelled):
        play(steps.wait(ID, None, 60.0), [job("cancelled")], clock)
    failed = json.loads(problem("time-limit", 422).body)
    with pytest.raises(JobFailed) as caught:
        play(steps.wait(ID, None, 60.0), [job("failed", problem=failed)], clock)
    assert (caught.value.kind, caught.value.job) == ("time-limit", ID)


def test_waiting_ends_in_time(clock: Clock) -> None:
    with pytest.raises(TimedOut):
        play(steps.wait(ID, 3.0, 60.0), [job("running")] * 1000, clock)
    assert clock.now == pytest.approx(3.0)


def test_a_cancellation_deletes_no_ended_job_and_may_be_repeated(clock: Clock) -> None:
    result, requests, _ = play(steps.cancel(ID, 60.0), [LOST, job("succeeded")], clock)
    assert [request.method for request in requests] == ["DELETE", "DELETE"]
    assert {request.query["cancel"] for request in requests} == {"true"}
    assert result["state"] == "succeeded"


def test_deletion_waits_for_the_end_and_may_be_repeated(clock: Clock) -> None:
    live, gone = Answer(202, {}, job("running").body), Answer(204, {}, b"")
    _, requests, _ = play(steps.delete(ID, 60.0), [live, live, gone], clock)
    assert {request.method for request in requests} == {"DELETE"}
    play(steps.delete(ID, 60.0), [LOST, problem("not-found", 404)], clock)
    with pytest.raises(NotFound):
        play(steps.delete(ID, 60.0), [problem("not-found", 404)], clock)


def test_a_retry_whose_answer_was_lost_is_looked_at(clock: Clock) -> None:
    result, _, _ = play(steps.retry(ID, 60.0), [LOST, problem("conflict", 409), job("queued")], clock)
    assert result["state"] == "queued"
    with pytest.raises(Conflict):
        play(steps.retry(ID, 60.0), [problem("conflict", 409)], clock)


def test_a_download_goes_on_where_it_broke_off(clock: Clock) -> None:
    content = bytes(range(200))
    file = io.BytesIO()

    def half(request: Request) -> Broken:
        assert request.into is file
        file.write(content[:120])
        return Broken(ConnectionResetError(), {"etag": '"a"'})

    def rest(request: Request) -> Answer:
        assert request.headers["range"] == "bytes=120-"
        assert request.headers["if-range"] == '"a"'
        assert request.headers["accept-encoding"] == "identity"
        file.write(content[120:])
        return Answer(206, {}, b"")

    request = results.request(ID, "mesh", "glb", {})
    play(steps.download(request, file, 60.0), [LOST, half, rest], clock)
    assert file.getvalue() == content


def reader(clock: Clock) -> Reader:
    return Reader(ID, 0, 5.0)


class Sent:
    """An event as httpx-sse gives it."""

    def __init__(self, id: int, event: str) -> None:
        self.id, self.event, self.data = str(id), event, "{}"


def test_a_reader_goes_on_after_the_last_event(clock: Clock) -> None:
    events = reader(clock)
    assert "Last-Event-ID" not in events.request().headers
    events.take(Sent(4, "iteration"))  # type: ignore[arg-type]
    events.lost(ConnectionResetError(), True)
    assert not events.has_ended
    assert events.request().headers["Last-Event-ID"] == "4"
    events.take(Sent(5, "end"))  # type: ignore[arg-type]
    events.closed()
    assert events.has_ended


def test_a_reader_goes_on_after_the_end_of_a_job_that_runs_again(clock: Clock) -> None:
    events = reader(clock)
    events.take(Sent(1, "end"))  # type: ignore[arg-type]
    events.take(Sent(2, "state"))  # type: ignore[arg-type]
    events.closed()
    assert not events.has_ended
    events.refused(Answer(204, {}, b""))
    assert events.has_ended


def test_a_reader_of_a_quiet_stream_has_all_its_patience_when_it_is_lost(clock: Clock) -> None:
    events = reader(clock)
    clock.now = 3600.0
    events.lost(ConnectionResetError(), True)
    clock.now += 4.0
    events.lost(ConnectionRefusedError("refused"), False)
    clock.now += 4.0
    with pytest.raises(Unreachable, match="refused"):
        events.lost(ConnectionRefusedError("refused"), False)


def test_a_reader_of_a_job_that_is_gone_stops(clock: Clock) -> None:
    with pytest.raises(NotFound):
        reader(clock).refused(problem("not-found", 404))


def test_arrays_are_sent_bit_by_bit() -> None:
    rng = np.random.default_rng(1)
    for kind, word in ((np.float32, b"float"), (np.float64, b"double")):
        points = rng.normal(size=(5, 3)).astype(kind)
        sent = upload.ply(Mesh(points, np.array([3, 0, 1, 2, 4, 1, 2, 3, 4])))
        header, body = sent.split(b"end_header\n")
        assert b"property " + word + b" x\n" in header
        assert b"element face 2\n" in header
        assert body[: points.nbytes] == points.tobytes()
        assert np.frombuffer(body[points.nbytes :], "<i4").tolist() == [3, 0, 1, 2, 4, 1, 2, 3, 4]


def test_a_gltf_brings_the_buffers_beside_it_and_no_other_files(tmp_path: Any) -> None:
    folder = tmp_path / "mesh"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"secret")
    (folder / "a b.bin").write_bytes(b"inside")
    uris = ["a%20b.bin", "../secret.bin", str(tmp_path / "secret.bin"), "data:;base64,AAAA", "absent.bin"]
    (folder / "m.gltf").write_text(json.dumps({"buffers": [{"uri": uri} for uri in uris]}))
    with upload.form_of(folder / "m.gltf", {}) as form:
        parts = [(name, content) for part, name, content, _ in form.parts if part == "buffer"]
        buffers = [(name, content.read()) for name, content in parts]  # type: ignore[union-attr]
    assert buffers == [("a b.bin", b"inside")]


def test_numbers_of_numpy_are_parameters() -> None:
    options: Any = {"clusters": np.int64(3), "levels": np.array([5, 4]), "seeds": np.array([0])}
    with upload.form_of(OBJ, options) as form:
        parts = {part: content for part, _, content, _ in form.parts}
    assert json.loads(parts["parameters"]) == {"clusters": 3, "levels": [5, 4]}  # type: ignore[arg-type]
    assert json.loads(parts["seeds"]) == [0]  # type: ignore[arg-type]


def test_a_file_that_is_not_there_is_an_error_of_its_kind(clock: Clock) -> None:
    with pytest.raises(Error) as caught:
        play(steps.submit("absent.obj", {}, 60.0), [], clock)
    assert caught.value.kind == "io"


def test_operations_refuse_names_that_they_do_not_have() -> None:
    with pytest.raises(TypeError, match="colour"):
        OPERATIONS["getLabels"].request(ID, query={"colour": 1})
