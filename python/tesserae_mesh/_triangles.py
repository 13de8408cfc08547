"""Triangles of a mesh in arrays: subdivision, normals, nearest points. What `tesserae_mesh.pyacvd` is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def nearest_in_triangles(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nearest point of triangle i, of shape (3, 3), to point i.

    It is the foot of the perpendicular if that is inside, else the nearest point of a side.
    """
    a, sides = corners[:, 0], np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
    gram = np.einsum("nij,nkj->nik", sides, sides)
    along = np.einsum("nij,nj->ni", sides, points - a)
    determinant = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    flat = determinant <= 0
    scale = np.where(flat, 1, determinant)
    u = (gram[:, 1, 1] * along[:, 0] - gram[:, 0, 1] * along[:, 1]) / scale
    v = (gram[:, 0, 0] * along[:, 1] - gram[:, 0, 1] * along[:, 0]) / scale
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & ~flat
    best = a + u[:, None] * sides[:, 0] + v[:, None] * sides[:, 1]
    distance = np.where(inside, np.square(best - points).sum(axis=1), np.inf)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        side = corners[:, end] - corners[:, start]
        length = np.square(side).sum(axis=1)
        at = np.einsum("ij,ij->i", points - corners[:, start], side) / np.where(length > 0, length, 1)
        candidate = corners[:, start] + np.clip(at, 0, 1)[:, None] * side
        further = np.square(candidate - points).sum(axis=1)
        nearer = further < distance
        best[nearer], distance[nearer] = candidate[nearer], further[nearer]
    return np.asarray(best)


def quartered(triangles: NDArray[np.int64], points: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The ends of each edge, and four triangles for each; the middle of edge i is point ``points + i``.

    Points and triangles have the order of VTK's linear subdivision, which is pyvista's ``subdivide``.
    """
    sides = np.sort(triangles[:, [[2, 0], [0, 1], [1, 2]]].reshape(-1, 2), axis=1)
    keys, first, edge = np.unique(sides[:, 0] * points + sides[:, 1], return_index=True, return_inverse=True)
    order = np.argsort(first)
    middle = np.empty_like(order)
    middle[order] = points + np.arange(len(order))
    ends = np.stack(np.divmod(keys[order], points), axis=1)
    (a, b, c), (ca, ab, bc) = triangles.T, middle[edge].reshape(-1, 3).T
    return ends, np.stack([a, ab, ca, ab, b, bc, bc, c, ca, ab, bc, ca], axis=1).reshape(-1, 3)


def normals(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Normals of triangles, twice as long as their areas."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return np.asarray(np.cross(b - a, c - a), dtype=np.float64)
