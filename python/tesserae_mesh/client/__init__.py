"""The HTTP service from Python: `Client` with blocking calls, `AsyncClient` with awaited ones.

Requests, retries and the reading of events are written once, without a network (`exchange`, `steps`, `events`), and
carried out by `connection`, the only module that speaks to httpx. It needs httpx and httpx-sse, the extra ``client``.
"""

from __future__ import annotations

from tesserae_mesh.client.asynchronous import AsyncClient, AsyncJob
from tesserae_mesh.client.errors import (
    Busy,
    Conflict,
    InvalidRequest,
    JobCancelled,
    JobFailed,
    NotFound,
    ServiceError,
    TimedOut,
    Unauthorized,
    Unreachable,
)
from tesserae_mesh.client.events import Event
from tesserae_mesh.client.options import SubmitOptions
from tesserae_mesh.client.sync import Client, Job

__all__ = [
    "AsyncClient",
    "AsyncJob",
    "Busy",
    "Client",
    "Conflict",
    "Event",
    "InvalidRequest",
    "Job",
    "JobCancelled",
    "JobFailed",
    "NotFound",
    "ServiceError",
    "SubmitOptions",
    "TimedOut",
    "Unauthorized",
    "Unreachable",
]
