"""`Client` and `Job`: the service with blocking calls."""

from __future__ import annotations

import os
import pathlib
from types import TracebackType
from typing import TYPE_CHECKING, Any, Iterator

from tesserae_mesh.client import results, steps
from tesserae_mesh.client.connection import Connection, Service
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


class Client:
    """A service, spoken to with blocking calls. It may be used by several threads.

    Parameters
    ----------
    url : str
        Address of the service, such as ``"http://127.0.0.1:8080"``.
    token : str, optional
        A token, where the service needs one.
    patience : float
        Seconds that a call goes on trying while the service cannot be reached, restarts or is busy.
    timeout : float
        Seconds without a byte after which a connection counts as lost. The service sends a byte of a quiet stream
        of events every 15 s.
    http : httpx.Client, optional
        The connections to use, for certificates and proxies. The caller closes it.

    Examples
    --------
    >>> with tesserae_mesh.Client("http://127.0.0.1:8080") as client:       # doctest: +SKIP
    ...     job = client.submit("horse.obj", clusters=2000)
    ...     for event in job.events():
    ...         print(event.kind, event.data)
    ...     labels = job.wait().labels()
    """

    def __init__(
        self,
        url: str,
        token: str | None = None,
        *,
        patience: float = 60.0,
        timeout: float = 60.0,
        http: httpx.Client | None = None,
    ) -> None:
        self._connection = Connection(Service(url, token, timeout, patience), http)
        self._patience = patience

    def close(self) -> None:
        """Closes the connections."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def submit(self, mesh: MeshSource, **options: Unpack[SubmitOptions]) -> Job:
        """Uploads a mesh to be clustered.

        Parameters
        ----------
        mesh : file name, bytes, open binary file, pair of arrays, mesh, or URL
            A file in a format that `formats` lists; points and faces as a tuple; a `tesserae_mesh.Mesh` or an object of
            pyvista, trimesh, open3d or meshio; the URL ``s3://…`` of an object that the service may read. Or points with
            neighbours: an image, a ``.npy`` or ``.npz`` file, or an array of items × columns.
        **options
            What to do, by the names of `tesserae_mesh.cluster`, and what `SubmitOptions` adds: ``outputs``,
            ``keep_mesh``, ``priority``, ``webhook``, ``buffers``, ``format``, ``file_name``, ``wait``
            and ``idempotency_key``.

        Raises
        ------
        tesserae_mesh.client.ServiceError
            The service refused the mesh or a parameter.

        Notes
        -----
        An upload whose answer was lost is made again with the same ``Idempotency-Key``, so there is one job.
        """
        return Job(self._connection, self._connection.run(steps.submit(mesh, options, self._patience)))

    def job(self, id: str) -> Job:
        """A job by its id."""
        return Job(self._connection, self._connection.run(steps.show(id, self._patience)))

    def jobs(self, state: State | None = None, page: int | None = None) -> Iterator[Job]:
        """The jobs, newest first.

        Parameters
        ----------
        state : str, optional
            Only jobs in this state.
        page : int, optional
            Jobs a request.
        """
        cursor: str | None = None
        while True:
            found = self._connection.run(steps.page(state, cursor, page, self._patience))
            for document in found["jobs"]:
                yield Job(self._connection, document)
            cursor = found["next"]
            if cursor is None:
                return

    def device(self) -> DeviceDescription:
        """What clusters at the service, and how it was chosen."""
        device: DeviceDescription = self._connection.run(results.info("getDevice", self._patience))
        return device

    def workers(self) -> list[Worker]:
        """The processes that work on jobs. Needs a token that was made with ``--metrics``."""
        found: WorkerList = self._connection.run(results.info("listWorkers", self._patience))
        return found["workers"]

    def formats(self) -> Formats:
        """Formats of meshes and of labels."""
        formats: Formats = self._connection.run(results.info("getFormats", self._patience))
        return formats

    def limits(self) -> MeshLimits:
        """The largest upload and the largest mesh that the service takes."""
        limits: MeshLimits = self._connection.run(results.info("getLimits", self._patience))
        return limits

    def version(self) -> Version:
        """Name and version of the service."""
        version: Version = self._connection.run(results.info("getVersion", self._patience))
        return version

    def is_alive(self) -> bool:
        """Whether the process answers. One attempt."""
        return self._connection.run(results.answers("getHealth"))

    def is_ready(self) -> bool:
        """Whether jobs are taken. One attempt."""
        return self._connection.run(results.answers("getReadiness"))

    def readiness(self) -> Readiness:
        """That jobs are taken, and what does not work all the same; an error where they are not."""
        readiness: Readiness = self._connection.run(results.info("getReadiness", 0.0))
        return readiness

    def metrics(self) -> str:
        """The metrics, as OpenMetrics. Needs a token that may read them, where there are tokens."""
        return self._connection.run(results.text("getMetrics", self._patience))

    def openapi(self) -> str:
        """The description of the service, as YAML."""
        return self._connection.run(results.text("getOpenapi", self._patience))


class Job:
    """A job of a service.

    Attributes
    ----------
    id : str
        Its name.
    document : JobDocument
        What the service last said about it: state, progress, parameters, ...
    """

    def __init__(self, connection: Connection, document: JobDocument) -> None:
        self._connection = connection
        self._patience = connection.service.patience
        self.id = document["id"]
        self.document = document

    def __repr__(self) -> str:
        return f"Job({self.id!r}, {self.state})"

    @property
    def state(self) -> State:
        """What the service last said: ``"queued"``, ``"running"``, ``"succeeded"``, ``"failed"`` or ``"cancelled"``."""
        return self.document["state"]

    def refresh(self) -> Self:
        """Looks at the job again."""
        return self._is(steps.show(self.id, self._patience))

    def wait(self, timeout: float | None = None) -> Self:
        """Waits until the job has succeeded.

        Parameters
        ----------
        timeout : float, optional
            Seconds to wait; as long as it takes when left out.

        Raises
        ------
        JobFailed, JobCancelled
            The job ended in another way.
        TimedOut
            It did not end in time, and goes on.
        """
        return self._is(steps.wait(self.id, timeout, self._patience))

    def cancel(self) -> Self:
        """Cancels the job, if it has not ended: it ends soon, and stays in the list."""
        return self._is(steps.cancel(self.id, self._patience))

    def retry(self) -> Self:
        """Runs a failed job again whose upload is kept (``kind`` of its problem: ``"poison"``, ``"insufficient-storage"``)."""
        return self._is(steps.retry(self.id, self._patience))

    def delete(self) -> None:
        """Deletes the job with its results; cancels it before, if it has not ended."""
        self._connection.run(steps.delete(self.id, self._patience))

    def events(self, after: int = 0) -> Iterator[Event]:
        """What happened to the job so far, then what happens, until its end.

        A lost connection, also to a service that restarts, is made again, and the events go on after the last one.

        Parameters
        ----------
        after : int
            Number of the last event that is known.
        """
        return self._connection.events(Reader(self.id, after, self._patience))

    def labels(self, clusters: int | None = None, *, iteration: int | None = None) -> NDArray[np.uint32]:
        """One cluster number a face, in upload order.

        Parameters
        ----------
        clusters : int, optional
            Cut a hierarchy at this number of clusters.
        iteration : int, optional
            The labels after this iteration, where ``snapshots`` keeps them.
        """
        query = {"clusters": clusters, "iteration": iteration}
        return self._connection.run(results.array(self.id, "labels", query, self._patience))

    def report(self) -> Report:
        """What was read, the energies, every iteration, the timings."""
        return self._connection.run(results.report(self.id, self._patience))

    def hierarchy(
        self, min_clusters: int | None = None, max_clusters: int | None = None, clusters: int | None = None
    ) -> HierarchyDocument:
        """The rounds and merges of a hierarchy, between these numbers of clusters; with the nodes of a named cut."""
        query = {"min_clusters": min_clusters, "max_clusters": max_clusters, "clusters": clusters}
        return self._connection.run(results.hierarchy(self.id, query, self._patience))

    def tree(self) -> Hierarchy:
        """The hierarchy as a `tesserae_mesh.Hierarchy`, which is cut without the service."""
        return self._connection.run(results.tree(self.id, self._patience))

    def linkage(self) -> NDArray[np.float64]:
        """The hierarchy as scipy's linkage matrix, if it is nested and has one root."""
        return self._connection.run(results.array(self.id, "hierarchy", {}, self._patience))

    def graph(self, clusters: int | None = None) -> Graph:
        """Which clusters are neighbours, and the length of the curves between them."""
        return self._connection.run(results.graph(self.id, {"clusters": clusters}, self._patience))

    def boundaries(self, clusters: int | None = None) -> Boundaries:
        """The curves between clusters, and the points where they meet."""
        return self._connection.run(results.boundaries(self.id, {"clusters": clusters}, self._patience))

    def table(self, clusters: int | None = None) -> list[Cluster]:
        """A row a cluster: size, place, shape, neighbours, energy."""
        return self._connection.run(results.table(self.id, {"clusters": clusters}, self._patience))

    def remesh_source(self, clusters: int | None = None, *, placement: str | None = None) -> dict[str, NDArray[Any]]:
        """What each vertex of the remesh stands for."""
        query = {"clusters": clusters, "placement": placement}
        return self._connection.run(results.arrays(self.id, "remesh-source", query, self._patience))

    def output(self, form: str, clusters: int | None = None, **query: str | float | bool) -> bytes:
        """An output as the bytes of its file.

        Parameters
        ----------
        form : str
            Output and format: ``"labels.npy"``, ``"mesh.glb"``, ``"submeshes.stl.zip"``, ``"remesh.ply"``, ...; until
            the job has ended also ``"upload"``, the mesh as it was uploaded.
        clusters : int, optional
            Cut a hierarchy at this number of clusters.
        **query
            Parameters of the output: ``placement`` of a remesh, ``colours`` and ``ply_vertex_colours`` of a mesh,
            ``force`` of submeshes, ``iteration`` of labels, ``buffer`` of an upload.
        """
        name, format = results.named(form)
        options = results.options(clusters, query)
        return self._connection.run(results.content(self.id, name, format, options, self._patience))

    def save(
        self,
        path: str | os.PathLike[str],
        form: str | None = None,
        clusters: int | None = None,
        **query: str | float | bool,
    ) -> None:
        """Writes an output to a file, whole or not at all.

        A download that breaks off goes on where it was. The answer is not held in memory.

        Parameters
        ----------
        path : str or path
            Where to. Its name says what, unless ``form`` does.
        form, clusters, **query
            As of `output`.
        """
        target = pathlib.Path(path)
        name, format = results.named(form or target.name)
        request = results.request(self.id, name, format, results.options(clusters, query))
        with results.replacing(target) as file:
            self._connection.run(steps.download(request, file, self._patience))

    def _is(self, steps: Steps[JobDocument]) -> Self:
        self.document = self._connection.run(steps)
        return self
