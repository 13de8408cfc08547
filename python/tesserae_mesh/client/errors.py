"""What can go wrong between a client and a service.

Every error is a `tesserae_mesh.Error` with a ``kind``. That of an answer is the last part of its problem's ``type``
(RFC 9457), such as ``"invalid-parameter"``. The class says what a caller can do about it.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Mapping, cast

from tesserae_mesh._errors import Error

if TYPE_CHECKING:
    from tesserae_mesh.client.documents import Problem


class ServiceError(Error):
    """The service answered with a problem.

    Attributes
    ----------
    problem : Problem
        The whole answer.
    status : int
        HTTP status.
    retry_after : float or None
        Seconds after which the service suggests to try again.
    """

    def __init__(self, problem: Problem, retry_after: float | None = None) -> None:
        super().__init__(kind_of(problem), problem["detail"])
        self.problem = problem
        self.retry_after = retry_after

    @property
    def status(self) -> int:
        """HTTP status of the problem."""
        return self.problem["status"]


class InvalidRequest(ServiceError):
    """The request, a parameter or the mesh has to be another one."""


class Unauthorized(ServiceError):
    """The token is missing or unknown, or does not permit this."""


class NotFound(ServiceError):
    """There is no such job, or it does not have this result."""


class Conflict(ServiceError):
    """The state of the job does not allow this."""


class Busy(ServiceError):
    """The same request may succeed later; the client has tried again for as long as its ``patience``."""


class JobFailed(ServiceError):
    """The job failed; ``kind`` and ``problem`` are those of the job."""

    def __init__(self, job: str, problem: Problem) -> None:
        super().__init__(problem)
        self.job = job


class JobCancelled(Error):
    """The job was cancelled before it ended."""

    def __init__(self, job: str) -> None:
        super().__init__("cancelled", f"the job was cancelled before it ended: {job}")
        self.job = job


class Unreachable(Error, ConnectionError):
    """No answer came for as long as the client's ``patience``."""

    def __init__(self, cause: Exception) -> None:
        super().__init__("unreachable", f"the service cannot be reached: {cause or type(cause).__name__}")


class TimedOut(Error, TimeoutError):
    """The job did not end within the ``timeout`` of `Job.wait`. It goes on."""

    def __init__(self, job: str, seconds: float) -> None:
        super().__init__("timed-out", f"the job did not end within {seconds:g} s, and goes on: {job}")


KINDS: Mapping[str, type[ServiceError]] = {
    **dict.fromkeys(
        [
            "bad-request",
            "invalid-parameter",
            "invalid-mesh",
            "unsupported-mesh",
            "unsupported-media-type",
            "too-large",
            "uri-too-long",
            "method-not-allowed",
            "not-implemented",
            "range-not-satisfiable",
            "not-acceptable",
            "key-reused",
            "device-unsuitable",
            "misdirected",
        ],
        InvalidRequest,
    ),
    **dict.fromkeys(["unauthorized", "forbidden", "foreign-origin"], Unauthorized),
    **dict.fromkeys(["not-found", "mesh-not-kept"], NotFound),
    "conflict": Conflict,
    **dict.fromkeys(
        [
            "timeout",
            "rate-limited",
            "overloaded",
            "queue-full",
            "insufficient-storage",
            "unavailable",
            "device-lost",
            "device-wrong",
            "io",
        ],
        Busy,
    ),
    **dict.fromkeys(["time-limit", "poison", "cancelled", "damaged", "internal"], ServiceError),
}
"""The class for each kind that a service has."""


def kind_of(problem: Problem) -> str:
    """Last part of the type of a problem."""
    return problem["type"].rsplit("/", 1)[-1]


def error_of(status: int, headers: Mapping[str, str], body: bytes, path: str) -> ServiceError:
    """The error that an answer stands for.

    A proxy's answer has no problem in it: its status decides.
    """
    retry_after = headers.get("retry-after", "")
    seconds = float(retry_after) if retry_after.isdecimal() else None
    problem = _problem(body)
    if problem is not None:
        return KINDS.get(kind_of(problem), ServiceError)(problem, seconds)
    text = body[:200].decode("utf-8", "replace").strip()
    detail = f"an answer without a problem document, status {status}: {text!r}"
    unknown: Problem = {
        "type": f"/problems/http-{status}",
        "title": "No problem document",
        "status": status,
        "detail": detail,
        "instance": path,
    }
    by_status: Mapping[int, type[ServiceError]] = {401: Unauthorized, 403: Unauthorized, 404: NotFound, 409: Conflict}
    kind = Busy if status in (408, 429, 502, 503, 504) else by_status.get(status, ServiceError)
    return kind(unknown, seconds)


def _problem(body: bytes) -> Problem | None:
    try:
        document: Any = json.loads(body)
    except ValueError:
        return None
    required = {"type": str, "title": str, "status": int, "detail": str, "instance": str}
    if not isinstance(document, dict):
        return None
    members = cast("dict[str, Any]", document)
    if not all(isinstance(members.get(name), kind) for name, kind in required.items()):
        return None
    return cast("Problem", members)
