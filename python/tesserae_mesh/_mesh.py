"""Meshes as arrays: every kind of input becomes a `Mesh`.

Nothing is imported but NumPy: objects of other libraries are recognised by their attributes.

| object | attributes |
|---|---|
| ``pyvista.PolyData`` | ``points``, ``faces`` (VTK's padded array) |
| ``trimesh.Trimesh`` | ``vertices``, ``faces`` |
| ``trimesh.Scene`` | ``geometry``, ``graph`` |
| ``open3d.geometry.TriangleMesh`` | ``vertices``, ``triangles`` |
| ``meshio.Mesh`` | ``points``, ``cells`` |

Points that are float32 or float64, contiguous, aligned and in the byte order of the machine are not copied.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Optional, Protocol, Union

import numpy as np

from tesserae_mesh import _native
from tesserae_mesh._errors import Error

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Numbers = NDArray[Any]
    FacesLike = Union[ArrayLike, tuple[ArrayLike, ArrayLike]]


class PolyDataLike(Protocol):
    """An object like ``pyvista.PolyData``."""

    @property
    def points(self) -> Any: ...
    @property
    def faces(self) -> Any: ...


class TrimeshLike(Protocol):
    """An object like ``trimesh.Trimesh``."""

    @property
    def vertices(self) -> Any: ...
    @property
    def faces(self) -> Any: ...


class SceneLike(Protocol):
    """An object like ``trimesh.Scene``."""

    @property
    def geometry(self) -> Any: ...
    @property
    def graph(self) -> Any: ...


class TriangleMeshLike(Protocol):
    """An object like ``open3d.geometry.TriangleMesh``."""

    @property
    def vertices(self) -> Any: ...
    @property
    def triangles(self) -> Any: ...


class MeshioLike(Protocol):
    """An object like ``meshio.Mesh``."""

    @property
    def points(self) -> Any: ...
    @property
    def cells(self) -> Any: ...


class Mesh:
    """Points and polygons as arrays.

    Parameters
    ----------
    points : array_like of shape (N, 3)
        Positions, in any unit of length; finite.
    faces : array_like or tuple
        Polygons: an integer array of shape (F, n), F polygons of n corners; VTK's padded array of one dimension,
        ``[n, i, j, ..., n, ...]``; or a tuple of two arrays, offsets of shape (F + 1,) and corners, as VTK's cell
        arrays have them.

    Attributes
    ----------
    points : ndarray of shape (N, 3)
        Positions, float32 or float64: the array that was given if its layout allows.
    connectivity : ndarray
        Corners as numbers of points: of shape (F, n) if all faces have n corners, else of one dimension.
    offsets : ndarray of shape (F + 1,) or None
        Where the corners of each face begin and end in `connectivity` of one dimension.

    Raises
    ------
    tesserae_mesh.Error
        The arrays are of another shape or type (``"invalid-mesh"``). Whether corners are points, and points finite, is
        checked where the mesh is used.
    """

    __slots__ = ("connectivity", "offsets", "points")

    points: Numbers
    connectivity: Numbers
    offsets: Optional[Numbers]

    def __init__(self, points: ArrayLike, faces: FacesLike) -> None:
        self.points = _points(points)
        self.offsets = None
        if isinstance(faces, tuple) and len(faces) == 2 and np.ndim(faces[0]) == 1 and not _are_faces(faces):
            self.offsets = _integers(faces[0], "offsets")
            self.connectivity = _integers(faces[1], "corners")
            if self.offsets.ndim != 1 or self.connectivity.ndim != 1:
                raise Error("invalid-mesh", f"offsets and corners must have one dimension, not {faces[1]!r:.80}")
            return
        array = _integers(faces, "faces")
        if array.ndim == 1:
            self.connectivity, self.offsets = _unpadded(array)
        elif array.ndim == 2 and array.shape[1] >= 1:
            self.connectivity = array
        else:
            raise Error(
                "invalid-mesh",
                "faces must be an array (F, n), a padded array of one dimension, or a tuple of offsets and corners; "
                f"its shape is {array.shape}",
            )

    @classmethod
    def of(cls, mesh: MeshLike) -> Mesh:
        """Take points and faces out of an object of pyvista, trimesh, Open3D or meshio.

        Raises
        ------
        tesserae_mesh.Error
            The object is none of these, or has cells that are no faces (``"invalid-mesh"``, ``"unsupported-mesh"``).
        """
        if isinstance(mesh, Mesh):
            return mesh
        if hasattr(mesh, "geometry") and hasattr(mesh, "graph"):
            return _of_scene(mesh)
        points: Any = getattr(mesh, "points", None)
        vertices: Any = getattr(mesh, "vertices", None)
        if getattr(mesh, "n_strips", 0):
            raise Error("unsupported-mesh", "triangle strips are not read; call triangulate() first")
        if getattr(mesh, "is_all_triangles", False) and hasattr(mesh, "regular_faces"):
            triangles_of_vtk: Any = mesh
            # the array that VTK has, where `faces` would be a new one
            return cls(points, triangles_of_vtk.regular_faces)
        faces: Any = getattr(mesh, "faces", None)
        if points is not None and faces is not None:
            return cls(points, faces)
        if vertices is not None and faces is not None:
            return cls(vertices, faces)
        triangles: Any = getattr(mesh, "triangles", None)
        if vertices is not None and triangles is not None:
            return cls(np.asarray(vertices), np.asarray(triangles))
        cells: Any = getattr(mesh, "cells", None)
        if points is not None and _is_list(cells):
            blocks: list[Any] = cells
            return _of_blocks(points, blocks)
        raise Error(
            "invalid-mesh",
            "a mesh is points and faces, a file name, or an object of pyvista, trimesh, open3d or meshio, "
            f"not {type(mesh).__name__}",
        )

    @property
    def n_points(self) -> int:
        """Number of points."""
        return int(self.points.shape[0])

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return int(self.connectivity.shape[0] if self.offsets is None else max(self.offsets.shape[0] - 1, 0))

    @property
    def triangles(self) -> Optional[Numbers]:
        """The corners as an array of shape (F, 3), if all faces are triangles; else None."""
        return self.connectivity if self.offsets is None and self.connectivity.shape[1] == 3 else None

    def padded(self) -> NDArray[np.int64]:
        """Return the faces as VTK's padded array: ``[n, i, j, ..., n, ...]``."""
        if self.offsets is None:
            faces, corners = self.connectivity.shape
            padded = np.empty((faces, corners + 1), dtype=np.int64)
            padded[:, 0] = corners
            padded[:, 1:] = self.connectivity
            return np.ravel(padded)
        offsets = self.offsets.astype(np.int64)
        return np.insert(self.connectivity.astype(np.int64), offsets[:-1], np.diff(offsets))

    def __repr__(self) -> str:
        return f"Mesh({self.n_points} points, {self.n_faces} faces)"


MeshLike = Union[Mesh, PolyDataLike, TrimeshLike, SceneLike, TriangleMeshLike, MeshioLike]
PathLike = Union[str, "os.PathLike[str]"]


def _points(points: ArrayLike) -> Numbers:
    """The points as float32 or float64, copied only where their layout asks for it."""
    array = _array(points, "points")
    if array.ndim != 2 or array.shape[1] != 3:
        raise Error("invalid-mesh", f"points must be an array of shape (N, 3), not {array.shape}")
    if array.dtype.kind not in "fiu":
        raise Error("invalid-mesh", f"points must be real numbers, not {array.dtype}")
    kind = np.float32 if array.dtype.kind == "f" and array.dtype.itemsize == 4 else np.float64
    return np.require(array, dtype=kind, requirements=["C", "A"])


def _integers(numbers: Any, what: str) -> Numbers:
    """Integers of 4 or 8 bytes in the byte order of the machine."""
    array = _array(numbers, what)
    if array.dtype.kind not in "iu" and array.size:
        raise Error("invalid-mesh", f"{what} must be integers, not {array.dtype}")
    if array.dtype.kind not in "iu" or array.dtype.itemsize < 4:
        return array.astype(np.int64)
    return np.require(array, dtype=f"{array.dtype.kind}{array.dtype.itemsize}", requirements=["A"])


def _array(values: Any, what: str) -> Numbers:
    if np.ma.is_masked(values):
        raise Error("invalid-mesh", f"{what} are a masked array: leave out what is masked, and give the values")
    try:
        return np.asarray(values)
    except (TypeError, ValueError, OverflowError) as error:
        raise Error("invalid-mesh", f"{what} make no array: {error}") from error


def _are_faces(pair: tuple[Any, Any]) -> bool:
    """Whether a tuple of two is two faces as lists of numbers, not offsets and corners."""
    return not isinstance(pair[0], np.ndarray) and not isinstance(pair[1], np.ndarray)


def _unpadded(padded: Numbers) -> tuple[Numbers, Optional[Numbers]]:
    """Connectivity and offsets of VTK's padded array; offsets are None if all faces have as many corners."""
    if padded.size == 0:
        return np.reshape(padded, (0, 3)), None
    corners = int(padded[0])
    if corners > 0 and padded.size % (corners + 1) == 0:
        rows = np.reshape(padded, (-1, corners + 1))
        if bool((rows[:, 0] == corners).all()):
            return rows[:, 1:], None
    return _native.unpad(np.ascontiguousarray(padded, dtype=np.int64))


def _is_list(value: object) -> bool:
    """Whether it is a list, of whatever."""
    return isinstance(value, list)


def _of_scene(scene: Any) -> Mesh:
    """The meshes of a trimesh scene, each at its place; paths and point clouds have no area and are left out."""
    points: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    count = 0
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        part: Any = scene.geometry[name]
        if not hasattr(part, "faces"):
            continue
        corners = np.asarray(part.faces, dtype=np.int64)
        if np.linalg.det(transform[:3, :3]) < 0:  # a mirror turns faces over
            corners = corners[:, ::-1]
        points.append(np.asarray(part.vertices) @ transform[:3, :3].T + transform[:3, 3])
        faces.append(corners + count)
        count += len(points[-1])
    if not faces:
        raise Error("invalid-mesh", "the scene has no meshes")
    return Mesh(np.concatenate(points), np.concatenate(faces))


def _of_blocks(points: Any, blocks: list[Any]) -> Mesh:
    """The faces of meshio's blocks of cells, in their order. Points and lines have no area and are left out."""
    left_out = ("vertex", "line")
    faces: list[Numbers] = []
    for block in blocks:
        kind: str = block.type
        data: Any = block.data
        if kind.startswith(left_out):
            continue
        if kind not in ("triangle", "quad", "polygon"):
            raise Error("unsupported-mesh", f"cells must be triangles, quads or polygons, not {kind}")
        # ragged polygons are a list of arrays
        rows: list[Any] = data if _is_list(data) else [data]
        faces.extend(np.asarray(face) for face in rows)
    arrays = [np.atleast_2d(array) for array in faces]
    if len(arrays) == 1:
        return Mesh(points, arrays[0])
    counts = [np.full(array.shape[0], array.shape[1], dtype=np.int64) for array in arrays]
    lengths = np.concatenate(counts) if counts else np.zeros(0, dtype=np.int64)
    corners = np.concatenate([np.ravel(array) for array in arrays]) if arrays else np.zeros(0, dtype=np.int64)
    return Mesh(points, (np.concatenate([[0], np.cumsum(lengths)]), corners))
