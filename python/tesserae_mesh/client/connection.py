"""Carrying out effects with httpx: once with blocking calls, once with awaited ones.

Nothing is decided here: `exchange` says when a request is made again, `events` when a stream is opened again.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, AsyncIterator, Iterator, TypeVar, Union

import httpx
from httpx_sse import EventSource

from tesserae_mesh._errors import Error
from tesserae_mesh.client.exchange import Answer, Broken, Outcome, Pause, Request, Steps

if TYPE_CHECKING:
    from tesserae_mesh.client.events import Event, Reader

T = TypeVar("T")


@dataclass(frozen=True)
class Service:
    """Where a service is, and how it is spoken to."""

    url: str
    token: str | None
    #: Seconds without a byte after which a connection counts as lost.
    timeout: float
    #: Seconds that a call goes on trying.
    patience: float

    def __post_init__(self) -> None:
        if not self.url.startswith(("http://", "https://")):
            raise Error("invalid-parameter", f"url must begin with http:// or https://, not {self.url!r}")

    def build(self, http: Union[httpx.Client, httpx.AsyncClient], request: Request) -> httpx.Request:
        """A request as httpx sends it."""
        headers = dict(request.headers)
        if self.token is not None:
            headers["authorization"] = f"Bearer {self.token}"
        parts = request.form.parts if request.form is not None else []
        return http.build_request(
            request.method,
            self.url.rstrip("/") + request.path,
            params=dict(request.query),
            headers=headers,
            files=[(name, (file_name, content, kind)) for name, file_name, content, kind in parts] or None,
            timeout=httpx.Timeout(self.timeout, read=self.timeout + request.extra_time),
        )


class Connection:
    """The connections of a `Client`."""

    def __init__(self, service: Service, http: httpx.Client | None) -> None:
        self.service = service
        self._is_owned = http is None
        self._http = http or httpx.Client()

    def close(self) -> None:
        """Closes what was opened here."""
        if self._is_owned:
            self._http.close()

    def run(self, steps: Steps[T]) -> T:
        """Carries out effects until there is a result."""
        outcome: Outcome = None
        try:
            while True:
                effect = steps.send(outcome)
                if isinstance(effect, Pause):
                    time.sleep(effect.seconds)
                    outcome = None
                else:
                    outcome = self._attempt(effect)
        except StopIteration as end:
            result: T = end.value
            return result
        finally:
            steps.close()

    def _attempt(self, request: Request) -> Answer | Broken:
        headers: dict[str, str] = {}
        try:
            response = self._http.send(self.service.build(self._http, request), stream=True)
            try:
                headers = _headers(response)
                if request.into is None or not _begins(response):
                    return Answer(response.status_code, headers, response.read())
                _rewind(response, request)
                for chunk in response.iter_bytes():
                    request.into.write(chunk)
                return Answer(response.status_code, headers, b"")
            finally:
                response.close()
        except httpx.TransportError as error:
            return Broken(error, headers)

    def events(self, reader: Reader) -> Iterator[Event]:
        """The events of a reader, over as many connections as it takes."""
        while not reader.has_ended:
            is_open = False
            try:
                response = self._http.send(self.service.build(self._http, reader.request()), stream=True)
                try:
                    is_open = response.status_code == 200
                    if is_open:
                        for sent in EventSource(response).iter_sse():
                            event = reader.take(sent)
                            if event is not None:
                                yield event
                        reader.closed()
                    else:
                        reader.refused(Answer(response.status_code, _headers(response), response.read()))
                finally:
                    response.close()
            except httpx.TransportError as error:
                reader.lost(error, is_open)
            if not reader.has_ended:
                time.sleep(reader.pause)


class AsyncConnection:
    """The connections of an `AsyncClient`."""

    def __init__(self, service: Service, http: httpx.AsyncClient | None) -> None:
        self.service = service
        self._is_owned = http is None
        self._http = http or httpx.AsyncClient()

    async def close(self) -> None:
        """Closes what was opened here."""
        if self._is_owned:
            await self._http.aclose()

    async def run(self, steps: Steps[T]) -> T:
        """Carries out effects until there is a result."""
        outcome: Outcome = None
        try:
            while True:
                effect = steps.send(outcome)
                if isinstance(effect, Pause):
                    await asyncio.sleep(effect.seconds)
                    outcome = None
                else:
                    outcome = await self._attempt(effect)
        except StopIteration as end:
            result: T = end.value
            return result
        finally:
            steps.close()

    async def _attempt(self, request: Request) -> Answer | Broken:
        headers: dict[str, str] = {}
        try:
            response = await self._http.send(self.service.build(self._http, request), stream=True)
            try:
                headers = _headers(response)
                if request.into is None or not _begins(response):
                    return Answer(response.status_code, headers, await response.aread())
                _rewind(response, request)
                async for chunk in response.aiter_bytes():
                    request.into.write(chunk)
                return Answer(response.status_code, headers, b"")
            finally:
                await response.aclose()
        except httpx.TransportError as error:
            return Broken(error, headers)

    async def events(self, reader: Reader) -> AsyncIterator[Event]:
        """The events of a reader, over as many connections as it takes."""
        while not reader.has_ended:
            is_open = False
            try:
                response = await self._http.send(self.service.build(self._http, reader.request()), stream=True)
                try:
                    is_open = response.status_code == 200
                    if is_open:
                        async for sent in EventSource(response).aiter_sse():
                            event = reader.take(sent)
                            if event is not None:
                                yield event
                        reader.closed()
                    else:
                        reader.refused(Answer(response.status_code, _headers(response), await response.aread()))
                finally:
                    await response.aclose()
            except httpx.TransportError as error:
                reader.lost(error, is_open)
            if not reader.has_ended:
                await asyncio.sleep(reader.pause)


def _headers(response: httpx.Response) -> dict[str, str]:
    """Headers by name, in lower case."""
    return {name.lower(): value for name, value in response.headers.items()}


def _begins(response: httpx.Response) -> bool:
    """Whether the body is a result, or a part of one."""
    return response.status_code in (200, 206)


def _rewind(response: httpx.Response, request: Request) -> None:
    """Empties the file where the answer is the whole result, not the part that was asked for."""
    if request.into is not None and response.status_code == 200:
        request.into.seek(0)
        request.into.truncate()
