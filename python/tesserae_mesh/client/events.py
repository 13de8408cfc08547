"""The events of a job, and how a reader goes on after its connection was lost.

The service numbers events from 1 without gaps and keeps them, so a reader that names the last one it has seen misses
none and gets none twice, also after a restart of the service.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Mapping, NamedTuple

from tesserae_mesh.client.errors import Unreachable
from tesserae_mesh.client.exchange import Answer, Broken, Patience, Request, error_in
from tesserae_mesh.client.operations import OPERATIONS

if TYPE_CHECKING:
    from httpx_sse import ServerSentEvent


class Event(NamedTuple):
    """Something that happened to a job."""

    id: int
    """Number of the event, from 1 without gaps."""
    kind: str
    """``"state"``, ``"iteration"``, ``"round"`` or ``"end"``."""
    data: Mapping[str, Any]
    """A `documents.StateEvent`, `documents.Iteration`, `documents.Level` or `documents.EndEvent`."""


class Reader:
    """Where a reader of a job's events is, and what it does next. It has no connection of its own.

    Attributes
    ----------
    has_ended : bool
        No event will come any more.
    pause : float
        Seconds to wait before the next request.
    """

    def __init__(self, job: str, after: int, patience: float) -> None:
        self.job = job
        self.after = after
        self.has_ended = False
        self.pause = 0.0
        self._pauses = Patience(patience)
        self._saw_end = False

    def request(self) -> Request:
        """The request for the events that are left."""
        headers = {"Last-Event-ID": self.after or None}
        return OPERATIONS["streamEvents"].request(self.job, headers=headers, accept="text/event-stream")

    def take(self, sent: ServerSentEvent) -> Event | None:
        """An event of the stream; None for what is none."""
        if not sent.id.isdecimal() or not sent.data:
            return None
        self._pauses.succeeded()
        event = Event(int(sent.id), sent.event, json.loads(sent.data))
        self.after = event.id
        # A job that was run again goes on after its end.
        self._saw_end = event.kind == "end"
        return event

    def closed(self) -> None:
        """Notes that the service closed the stream: after the end, or because it stops."""
        self._pauses.heard()
        self.has_ended = self._saw_end
        if not self.has_ended:
            self.pause = self._pauses.pause_after(Unreachable(EOFError("the stream of events ended early")))

    def lost(self, cause: Exception, was_open: bool) -> None:
        """Notes that the connection was lost, or was not made; raises `Unreachable` once patience is over."""
        if was_open:
            self._pauses.heard()
        self.pause = self._pauses.pause_after(Unreachable(cause))

    def refused(self, answer: Answer | Broken) -> None:
        """Notes an answer without a stream: none is left, a pause, or an error, which is raised."""
        error = error_in(self.request(), answer)
        self.has_ended = error is None
        if error is not None:
            self.pause = self._pauses.pause_after(error)
