"""`AsyncClient` and `AsyncJob`: the service from coroutines. `Client` and `Job` say what the methods do."""

from __future__ import annotations

import os
import pathlib
from types import TracebackType
from typing import TYPE_CHECKING, Any, AsyncIterator

from tesserae_mesh.client import results, steps
from tesserae_mesh.client.connection import AsyncConnection, Service
from tesserae_mesh.client.events import Event, Reader

if TYPE_CHECKING:
    import httpx
    import numpy as np
    from numpy.typing import NDArray
    from typing_extensions import Self, Unpack

    from tesserae_mesh._hierarchy import Hierarchy
    from tesserae_mesh.client.documents import (
        Boundaries,
        Cluster,
        DeviceDescription,
        Formats,
        Graph,
        HierarchyDocument,
        JobDocument,
        Readiness,
        Report,
        State,
        MeshLimits,
        Version,
        Worker,
        WorkerList,
    )
    from tesserae_mesh.client.exchange import Steps
    from tesserae_mesh.client.options import MeshSource, SubmitOptions


class AsyncClient:
    """A service, spoken to from coroutines; parameters as of `Client`. ``async with`` closes its connections."""

    def __init__(
        self,
        url: str,
        token: str | None = None,
        *,
        patience: float = 60.0,
        timeout: float = 60.0,
        http: httpx.AsyncClient | None = None,
    ) -> None:
        self._connection = AsyncConnection(Service(url, token, timeout, patience), http)
        self._patience = patience

    async def close(self) -> None:
        """Closes the connections."""
        await self._connection.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.close()

    async def submit(self, mesh: MeshSource, **options: Unpack[SubmitOptions]) -> AsyncJob:
        """Uploads a mesh to be clustered."""
        return AsyncJob(self._connection, await self._connection.run(steps.submit(mesh, options, self._patience)))

    async def job(self, id: str) -> AsyncJob:
        """A job by its id."""
        return AsyncJob(self._connection, await self._connection.run(steps.show(id, self._patience)))

    async def jobs(self, state: State | None = None, page: int | None = None) -> AsyncIterator[AsyncJob]:
        """The jobs, newest first."""
        cursor: str | None = None
        while True:
            found = await self._connection.run(steps.page(state, cursor, page, self._patience))
            for document in found["jobs"]:
                yield AsyncJob(self._connection, document)
            cursor = found["next"]
            if cursor is None:
                return

    async def device(self) -> DeviceDescription:
        """What clusters at the service, and how it was chosen."""
        device: DeviceDescription = await self._connection.run(results.info("getDevice", self._patience))
        return device

    async def workers(self) -> list[Worker]:
        """The processes that work on jobs. Needs a token that was made with ``--metrics``."""
        found: WorkerList = await self._connection.run(results.info("listWorkers", self._patience))
        return found["workers"]

    async def formats(self) -> Formats:
        """Formats of meshes and of labels."""
        formats: Formats = await self._connection.run(results.info("getFormats", self._patience))
        return formats

    async def limits(self) -> MeshLimits:
        """The largest upload and the largest mesh that the service takes."""
        limits: MeshLimits = await self._connection.run(results.info("getLimits", self._patience))
        return limits

    async def version(self) -> Version:
        """Name and version of the service."""
        version: Version = await self._connection.run(results.info("getVersion", self._patience))
        return version

    async def is_alive(self) -> bool:
        """Whether the process answers. One attempt."""
        return await self._connection.run(results.answers("getHealth"))

    async def is_ready(self) -> bool:
        """Whether jobs are taken. One attempt."""
        return await self._connection.run(results.answers("getReadiness"))

    async def readiness(self) -> Readiness:
        """That jobs are taken, and what does not work all the same; an error where they are not."""
        readiness: Readiness = await self._connection.run(results.info("getReadiness", 0.0))
        return readiness

    async def metrics(self) -> str:
        """The metrics, as OpenMetrics. Needs a token that may read them, where there are tokens."""
        return await self._connection.run(results.text("getMetrics", self._patience))

    async def openapi(self) -> str:
        """The description of the service, as YAML."""
        return await self._connection.run(results.text("getOpenapi", self._patience))


class AsyncJob:
    """A job of a service; attributes and methods as of `Job`."""

    def __init__(self, connection: AsyncConnection, document: JobDocument) -> None:
        self._connection = connection
        self._patience = connection.service.patience
        self.id = document["id"]
        self.document = document

    def __repr__(self) -> str:
        return f"AsyncJob({self.id!r}, {self.state})"

    @property
    def state(self) -> State:
        """What the service last said: ``"queued"``, ``"running"``, ``"succeeded"``, ``"failed"`` or ``"cancelled"``."""
        return self.document["state"]

    async def refresh(self) -> Self:
        """Looks at the job again."""
        return await self._is(steps.show(self.id, self._patience))

    async def wait(self, timeout: float | None = None) -> Self:
        """Waits until the job has succeeded."""
        return await self._is(steps.wait(self.id, timeout, self._patience))

    async def cancel(self) -> Self:
        """Cancels the job, if it has not ended: it ends soon, and stays in the list."""
        return await self._is(steps.cancel(self.id, self._patience))

    async def retry(self) -> Self:
        """Runs a failed job again whose upload is kept (``kind`` of its problem: ``"poison"``, ``"insufficient-storage"``)."""
        return await self._is(steps.retry(self.id, self._patience))

    async def delete(self) -> None:
        """Deletes the job with its results; cancels it before, if it has not ended."""
        await self._connection.run(steps.delete(self.id, self._patience))

    def events(self, after: int = 0) -> AsyncIterator[Event]:
        """What happened to the job so far, then what happens, until its end."""
        return self._connection.events(Reader(self.id, after, self._patience))

    async def labels(self, clusters: int | None = None, *, iteration: int | None = None) -> NDArray[np.uint32]:
        """One cluster number a face, in upload order."""
        query = {"clusters": clusters, "iteration": iteration}
        return await self._connection.run(results.array(self.id, "labels", query, self._patience))

    async def report(self) -> Report:
        """What was read, the energies, every iteration, the timings."""
        return await self._connection.run(results.report(self.id, self._patience))

    async def hierarchy(
        self, min_clusters: int | None = None, max_clusters: int | None = None, clusters: int | None = None
    ) -> HierarchyDocument:
        """The rounds and merges of a hierarchy, between these numbers of clusters; with the nodes of a named cut."""
        query = {"min_clusters": min_clusters, "max_clusters": max_clusters, "clusters": clusters}
        return await self._connection.run(results.hierarchy(self.id, query, self._patience))

    async def tree(self) -> Hierarchy:
        """The hierarchy as a `tesserae_mesh.Hierarchy`, which is cut without the service."""
        return await self._connection.run(results.tree(self.id, self._patience))

    async def linkage(self) -> NDArray[np.float64]:
        """The hierarchy as scipy's linkage matrix, if it is nested and has one root."""
        return await self._connection.run(results.array(self.id, "hierarchy", {}, self._patience))

    async def graph(self, clusters: int | None = None) -> Graph:
        """Which clusters are neighbours, and the length of the curves between them."""
        return await self._connection.run(results.graph(self.id, {"clusters": clusters}, self._patience))

    async def boundaries(self, clusters: int | None = None) -> Boundaries:
        """The curves between clusters, and the points where they meet."""
        return await self._connection.run(results.boundaries(self.id, {"clusters": clusters}, self._patience))

    async def table(self, clusters: int | None = None) -> list[Cluster]:
        """A row a cluster: size, place, shape, neighbours, energy."""
        return await self._connection.run(results.table(self.id, {"clusters": clusters}, self._patience))

    async def remesh_source(
        self, clusters: int | None = None, *, placement: str | None = None
    ) -> dict[str, NDArray[Any]]:
        """What each vertex of the remesh stands for."""
        query = {"clusters": clusters, "placement": placement}
        return await self._connection.run(results.arrays(self.id, "remesh-source", query, self._patience))

    async def output(self, form: str, clusters: int | None = None, **query: str | float | bool) -> bytes:
        """An output as the bytes of its file."""
        name, format = results.named(form)
        options = results.options(clusters, query)
        return await self._connection.run(results.content(self.id, name, format, options, self._patience))

    async def save(
        self,
        path: str | os.PathLike[str],
        form: str | None = None,
        clusters: int | None = None,
        **query: str | float | bool,
    ) -> None:
        """Writes an output to a file, whole or not at all."""
        target = pathlib.Path(path)
        name, format = results.named(form or target.name)
        request = results.request(self.id, name, format, results.options(clusters, query))
        with results.replacing(target) as file:
            await self._connection.run(steps.download(request, file, self._patience))

    async def _is(self, steps: Steps[JobDocument]) -> Self:
        self.document = await self._connection.run(steps)
        return self
