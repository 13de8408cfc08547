"""Requests and answers without a network, and when a request is made again.

What the client does is written once, as generators that yield *effects*: a `Request`, for which they get an `Answer` or
`Broken`, or a `Pause`. `Client` carries effects out with blocking calls, `AsyncClient` with awaited ones, tests with a
list of answers.
"""

from __future__ import annotations

import json
import random
import time
from dataclasses import dataclass, field
from typing import IO, Any, Generator, Mapping, TypeVar, Union

from tesserae_mesh.client.errors import Busy, ServiceError, Unreachable, error_of


@dataclass(frozen=True)
class Form:
    """A body of the type ``multipart/form-data``: name, file name, content and media type of each part."""

    parts: list[tuple[str, str | None, bytes | IO[bytes], str]]


@dataclass(frozen=True)
class Request:
    """A request; ``path`` is below the address of the service."""

    method: str
    path: str
    query: Mapping[str, str] = field(default_factory=dict[str, str])
    headers: Mapping[str, str] = field(default_factory=dict[str, str])
    form: Form | None = None
    #: Seconds beyond the client's timeout that the service may take before it answers.
    extra_time: float = 0.0
    #: Where the body of a 200 or 206 is written to; the answer has it when left out.
    into: IO[bytes] | None = None


@dataclass(frozen=True)
class Answer:
    """An answer; header names are in lower case."""

    status: int
    headers: Mapping[str, str]
    body: bytes


@dataclass(frozen=True)
class Broken:
    """No answer, or the beginning of one: the connection failed."""

    cause: Exception
    #: Those of the answer that began.
    headers: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True)
class Pause:
    """Nothing for some seconds."""

    seconds: float


Outcome = Union[Answer, Broken, None]
"""What an effect gives: an answer or `Broken` for a request, None for a pause."""

T = TypeVar("T")
Steps = Generator[Union[Request, Pause], Outcome, T]
"""Effects, then a result."""


class Patience:
    """The pauses between attempts, until no attempt has had success for some time.

    A pause doubles from attempt to attempt, from 0.2 s to 10 s, less a random part, so that clients that lost one
    service do not come back together. It is at least as long as ``Retry-After`` says.
    """

    FIRST, LONGEST = 0.2, 10.0

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.succeeded()

    def succeeded(self) -> None:
        """Starts from the beginning."""
        self.attempts = 0
        self.heard()

    def heard(self) -> None:
        """Notes that the service is there."""
        self.since = time.monotonic()

    def pause_after(self, error: Exception) -> float:
        """Seconds to wait before the next attempt; raises the error where there is none."""
        if not isinstance(error, (Busy, Unreachable)):
            raise error
        pause = min(self.FIRST * 2.0**self.attempts, self.LONGEST) * random.uniform(0.5, 1.0)
        if isinstance(error, Busy) and error.retry_after is not None:
            pause = max(pause, error.retry_after)
        if time.monotonic() + pause > self.since + self.seconds:
            raise error
        self.attempts += 1
        return pause


def send(request: Request) -> Steps[Answer | Broken]:
    """One attempt."""
    outcome = yield request
    assert outcome is not None, "a request has an outcome"
    return outcome


def error_in(request: Request, outcome: Answer | Broken) -> ServiceError | Unreachable | None:
    """The error that the outcome of a request stands for, if it does for one.

    A problem with a ``Location`` is that of a job which ended while the request waited for it: the request succeeded.
    """
    if isinstance(outcome, Broken):
        return Unreachable(outcome.cause)
    if outcome.status < 400 or "location" in outcome.headers:
        return None
    return error_of(outcome.status, outcome.headers, outcome.body, request.path)


def exchange(request: Request, patience: float) -> Steps[Answer]:
    """A request that may be made several times, until it has an answer that is no problem."""
    pauses = Patience(patience)
    while True:
        outcome = yield from send(request)
        error = error_in(request, outcome)
        if error is None and isinstance(outcome, Answer):
            return outcome
        assert error is not None, "an outcome without an answer is an error"
        yield Pause(pauses.pause_after(error))


def members(answer: Answer) -> Any:
    """The JSON of an answer."""
    return json.loads(answer.body)
