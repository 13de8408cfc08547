"""What is sent of a mesh or of points: a form with its file, its buffers, seeds, weights, edges and parameters.

A mesh in memory is sent as binary PLY, which keeps every position bit by bit and every polygon in its place, so label i
belongs to face i of the arrays.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import pathlib
from typing import IO, TYPE_CHECKING, Any, Generator, Mapping, cast
from urllib.parse import unquote

import numpy as np

from tesserae_mesh._errors import Error, file_error
from tesserae_mesh._mesh import Mesh
from tesserae_mesh.client.exchange import Form
from tesserae_mesh.client.operations import PARAMETERS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tesserae_mesh._mesh import FacesLike, MeshLike
    from tesserae_mesh.client.options import MeshSource, Source, SubmitOptions

BYTES = "application/octet-stream"

_POINTS = (b"\x93NUMPY", b"PK\x03\x04", b"\x89PNG", b"\xff\xd8\xff")
"""First bytes of files with points: arrays, archives of arrays, images."""


@contextlib.contextmanager
def form_of(mesh: MeshSource, options: SubmitOptions) -> Generator[Form, None, None]:
    """The form of an upload; files are open as long as the context lasts.

    Parameters
    ----------
    mesh : file name, bytes, open binary file, URL ``s3://…``, array, or anything that `tesserae_mesh.cluster` takes
        The mesh; points and faces as a pair of arrays. Or an array of items × columns, which are points with
        neighbours. The form has no part for one in a bucket.
    options : SubmitOptions
        Keywords of `Client.submit`.
    """
    left: dict[str, Any] = dict(options)
    file_name: str | None = left.pop("file_name", None)
    buffers: Mapping[str, Source] = left.pop("buffers", None) or {}
    weights, seeds, graph = left.pop("weights", None), left.get("seeds"), left.get("graph")
    for name in ("format", "wait", "idempotency_key"):
        left.pop(name, None)
    with contextlib.ExitStack() as files:
        content: bytes | IO[bytes] | None = None
        if is_in_bucket(mesh):
            pass
        elif isinstance(mesh, (str, os.PathLike)):
            path = pathlib.Path(mesh)
            file_name = file_name or path.name
            buffers = {**_beside(path), **buffers}
            content = files.enter_context(_open(path))
        elif _is_content(mesh):
            content = cast("bytes | IO[bytes]", mesh)
        elif isinstance(mesh, np.ndarray):
            content = _npy(mesh)
            file_name = file_name or "points.npy"
        else:
            content = ply(_in_memory(cast("MeshLike | tuple[ArrayLike, FacesLike]", mesh)))
            file_name = file_name or "mesh.ply"
        # The service tells parts with a file from others by the file name.
        parts: list[tuple[str, str | None, bytes | IO[bytes], str]] = []
        if content is not None:
            part = "points" if _head(content).startswith(_POINTS) else "mesh"
            parts.append((part, file_name or part, content, BYTES))
        for uri, source in buffers.items():
            opened = files.enter_context(_open(source)) if isinstance(source, (str, os.PathLike)) else source
            parts.append(("buffer", uri, opened, BYTES))
        if weights is not None:
            parts.append(("weights", "weights.npy", _npy(_floats(np.asarray(weights))), BYTES))
        if graph is not None and not isinstance(graph, str):
            del left["graph"]
            parts.append(("graph", "graph.npz", _npz(graph), BYTES))
        if seeds is not None and not isinstance(seeds, str):
            del left["seeds"]
            parts.append(("seeds", "seeds.json", json.dumps(np.asarray(seeds).tolist()).encode(), BYTES))
        parts.append(("parameters", None, json.dumps(_members(left)).encode(), "application/json"))
        yield Form(parts)


def _members(left: Mapping[str, Any]) -> dict[str, Any]:
    """The part ``parameters``: what is not None, numpy's numbers and sequences as JSON has them."""
    unknown = sorted(set(left) - set(PARAMETERS))
    if unknown:
        raise TypeError(f"submit has no keyword argument of that name: {unknown[0]}")
    plain: dict[str, Any] = {}
    for name, value in left.items():
        if value is None:
            continue
        plain[name] = value if isinstance(value, (str, int, float)) else np.asarray(value).tolist()
    return plain


def is_in_bucket(mesh: object) -> bool:
    """Whether a mesh is the URL of an object that the service reads by itself."""
    return isinstance(mesh, str) and mesh.startswith("s3://")


def _is_content(mesh: object) -> bool:
    return isinstance(mesh, bytes) or hasattr(mesh, "read")


def _open(path: str | os.PathLike[str]) -> IO[bytes]:
    try:
        return open(path, "rb")
    except OSError as error:
        raise file_error("read", path, error) from error


def _beside(path: pathlib.Path) -> dict[str, pathlib.Path]:
    """The buffers of a glTF that are files in its folder or below, by URI.

    No others: a mesh from elsewhere must not choose what is uploaded.
    """
    if path.suffix.lower() != ".gltf":
        return {}
    try:
        uris = [buffer.get("uri") for buffer in json.loads(path.read_bytes()).get("buffers", [])]
    except (OSError, ValueError, AttributeError, TypeError):
        return {}  # the service says what is wrong with the file
    folder = path.resolve().parent
    found: dict[str, pathlib.Path] = {}
    for uri in uris:
        if isinstance(uri, str) and not uri.startswith("data:"):
            name = unquote(uri)
            file = (folder / name).resolve()
            if folder in file.parents and file.is_file():
                found[name] = file
    return found


def _in_memory(mesh: MeshLike | tuple[ArrayLike, FacesLike]) -> Mesh:
    if not isinstance(mesh, tuple):
        return Mesh.of(mesh)
    if len(mesh) != 2:
        raise Error("invalid-mesh", f"a mesh of arrays must be a pair of points and faces, not {len(mesh)} arrays")
    return Mesh(*mesh)


def ply(mesh: Mesh) -> bytes:
    """A mesh as binary PLY: single or double precision as it is, every face as a list of corners."""
    kind = "float" if mesh.points.dtype == np.float32 else "double"
    padded = mesh.padded()
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {mesh.n_points}",
        *(f"property {kind} {axis}" for axis in "xyz"),
        f"element face {mesh.n_faces}",
        "property list int int vertex_indices",
        "end_header",
        "",
    ]
    if padded.size and (padded.min() < 0 or padded.max() > np.iinfo(np.int32).max):
        raise Error("invalid-mesh", f"a face names a vertex that cannot be: {padded.min()} to {padded.max()}")
    body = mesh.points.astype("<f4" if kind == "float" else "<f8", copy=False).tobytes()
    return b"".join(["\n".join(header).encode(), body, padded.astype("<i4", copy=False).tobytes()])


def _head(content: bytes | IO[bytes]) -> bytes:
    """The first bytes of a file; an open one stays where it is."""
    if isinstance(content, bytes):
        return content[:8]
    place = content.tell()
    head = content.read(8)
    content.seek(place)
    return head


def _floats(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Integers as floats, which is what weights are."""
    return array.astype(np.float64) if array.dtype.kind in "iub" else array


def _npy(array: np.ndarray[Any, Any]) -> bytes:
    """An array as a file."""
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(array), allow_pickle=False)
    return file.getvalue()


def _npz(graph: Any) -> bytes:
    """A sparse matrix as a file."""
    sparse: Any = importlib.import_module("scipy.sparse")
    file = io.BytesIO()
    sparse.save_npz(file, sparse.csr_matrix(graph))
    return file.getvalue()
