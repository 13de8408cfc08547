"""What a job gave: which request gets it, and what is made of the answer."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pathlib
import uuid
from typing import IO, TYPE_CHECKING, Any, Generator, Mapping, Union, cast

import numpy as np

from tesserae_mesh._errors import Error, file_error
from tesserae_mesh.client.exchange import Request, Steps, error_in, exchange, members, send
from tesserae_mesh.client.operations import OPERATIONS, Operation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tesserae_mesh._hierarchy import Hierarchy
    from tesserae_mesh.client.documents import Boundaries, Cluster, ClusterTable, Graph, HierarchyDocument, Report

Query = Mapping[str, Union[str, float, None]]


def operation(name: str) -> Operation:
    """The operation that gets the output of this name, such as ``"remesh"``."""
    path = f"/v1/jobs/{{id}}/{name}"
    for row in OPERATIONS.values():
        if row.path == path and row.method == "GET" and row.id != "streamEvents":
            return row
    raise Error("not-found", f"there is no output of this name: {name!r}")


def request(job: str, name: str, format: str | None, query: Query) -> Request:
    """The request for an output in a format; in its first one for None."""
    row = operation(name)
    chosen = {"format": format} if "format" in row.query else {}
    return row.request(job, {**query, **chosen}, accept="*/*")


def named(file_name: str) -> tuple[str, str | None]:
    """Output and format of a file by its name: ``submeshes.stl.zip`` is ``stl.zip`` of ``submeshes``."""
    name, _, format = file_name.partition(".")
    return name, format or None


def options(clusters: int | None, query: Query) -> Query:
    """Parameters of an output; ``clusters`` where it is given, as not every output has it."""
    return query if clusters is None else {**query, "clusters": clusters}


@contextlib.contextmanager
def replacing(target: pathlib.Path) -> Generator[IO[bytes], None, None]:
    """A file that takes the place of ``target`` once it is whole."""
    beside = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
    try:
        file = open(beside, "xb")
    except OSError as error:
        raise file_error("write", target, error) from error
    try:
        with file:
            yield file
        os.replace(beside, target)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def content(job: str, name: str, format: str | None, query: Query, patience: float) -> Steps[bytes]:
    """An output as the bytes of its file."""
    return (yield from exchange(request(job, name, format, query), patience)).body


def document(job: str, name: str, query: Query, patience: float) -> Steps[Any]:
    """An output as JSON."""
    return json.loads((yield from content(job, name, "json", query, patience)))


def report(job: str, patience: float) -> Steps[Report]:
    """What was read, the energies, every iteration, the timings."""
    return cast("Report", (yield from document(job, "report", {}, patience)))


def hierarchy(job: str, query: Query, patience: float) -> Steps[HierarchyDocument]:
    """Rounds and merges."""
    return cast("HierarchyDocument", (yield from document(job, "hierarchy", query, patience)))


def tree(job: str, patience: float) -> Steps[Hierarchy]:
    """The hierarchy with its methods."""
    # It needs the library; nothing else of the client does.
    from tesserae_mesh._hierarchy import Hierarchy

    return Hierarchy.load((yield from content(job, "hierarchy", "tsr", {}, patience)))


def graph(job: str, query: Query, patience: float) -> Steps[Graph]:
    """Which clusters are neighbours."""
    return cast("Graph", (yield from document(job, "graph", query, patience)))


def boundaries(job: str, query: Query, patience: float) -> Steps[Boundaries]:
    """The curves between clusters."""
    return cast("Boundaries", (yield from document(job, "boundaries", query, patience)))


def table(job: str, query: Query, patience: float) -> Steps[list[Cluster]]:
    """A row a cluster."""
    document_ = yield from document(job, "clusters", query, patience)
    return cast("ClusterTable", document_)["clusters"]


def info(id: str, patience: float) -> Steps[Any]:
    """What the service says about itself, as JSON."""
    return members((yield from exchange(OPERATIONS[id].request(), patience)))


def answers(id: str) -> Steps[bool]:
    """Whether one attempt gets an answer that is no problem."""
    request = OPERATIONS[id].request()
    return error_in(request, (yield from send(request))) is None


def text(id: str, patience: float) -> Steps[str]:
    """What the service says about itself, as text."""
    return (yield from exchange(OPERATIONS[id].request(accept="*/*"), patience)).body.decode()


def array(job: str, name: str, query: Query, patience: float) -> Steps[NDArray[Any]]:
    """An output that is an array."""
    body = yield from content(job, name, "npy", query, patience)
    return cast("NDArray[Any]", np.load(io.BytesIO(body), allow_pickle=False))


def arrays(job: str, name: str, query: Query, patience: float) -> Steps[dict[str, NDArray[Any]]]:
    """An output that is several arrays."""
    body = yield from content(job, name, "npz", query, patience)
    with np.load(io.BytesIO(body), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
