"""Clusters of the points of a triangle mesh, and the mesh that is made of them."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Optional, cast

import numpy as np
import pyvista

from tesserae_mesh._cluster import cluster_vertices
from tesserae_mesh._mesh import Mesh
from tesserae_mesh._triangles import nearest_in_triangles, normals, quartered

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from tesserae_mesh._cluster import Quality

__all__ = ["Clustering"]


class Clustering:
    """Uniform clusters of the points of a mesh.

    Parameters
    ----------
    mesh : pyvista.PolyData
        The mesh. `subdivide` changes it, as in pyacvd, unless it has faces that are no triangles.
    weights : array_like, optional
        A number above 0 for each point; clusters are smaller where it is larger.

    Attributes
    ----------
    mesh : pyvista.PolyData
        The triangles that are clustered.
    clusters : ndarray of int32 or None
        The cluster of each point, -1 for points without a triangle.
    nclus : int or None
        Number of clusters.
    remesh : pyvista.PolyData
        What `create_mesh` made last.
    """

    remesh: pyvista.PolyData

    def __init__(self, mesh: pyvista.PolyData, weights: Optional[ArrayLike] = None) -> None:
        self.mesh = mesh if mesh.is_all_triangles else triangulated(mesh)
        self._weights = None if weights is None else np.asarray(weights, dtype=np.float64)
        if self._weights is not None and self._weights.shape != (self.mesh.n_points,):
            raise ValueError(f"weights must be one for each of the {self.mesh.n_points} points: {self._weights.shape}")
        self.clusters: Optional[NDArray[np.int32]] = None
        self.nclus: Optional[int] = None

    @property
    def area(self) -> NDArray[np.float64]:
        """The area of the triangles around each point, at least 1e-10."""
        triangles = _triangles(self.mesh)
        areas = np.linalg.norm(normals(_points(self.mesh), triangles), axis=1) / 2
        return np.maximum(_sums(triangles.ravel(), np.repeat(areas, 3), self.mesh.n_points), 1e-10)

    @property
    def wcent(self) -> NDArray[np.float64]:
        """The points times their `area`."""
        return _points(self.mesh) * self.area[:, None]

    def cluster(
        self,
        nclus: int,
        maxiter: Optional[int] = None,
        debug: bool = False,
        iso_try: Optional[int] = None,
        init_only: bool = False,
    ) -> NDArray[np.int32]:
        """Cluster the points.

        Parameters
        ----------
        nclus : int
            Number of clusters; one for each position of points, where there are fewer.
        maxiter : int, optional
            At most this many iterations, and no moves of whole clusters. When left out, until no move lowers the
            energy.
        debug : bool
            Means nothing here.
        iso_try : int, optional
            0 leaves clusters in pieces. Other numbers mean nothing here: clusters are connected.
        init_only : bool
            Stop after the initial growth.
        """
        if debug:
            warnings.warn("debug means nothing here; progress is a parameter of tesserae_mesh.cluster", stacklevel=2)
        if iso_try:
            warnings.warn("iso_try means nothing here: clusters are connected", stacklevel=2)
        return self._cluster(nclus, "default", 0 if init_only else maxiter, iso_try == 0)

    def fast_cluster(self, nclus: int) -> NDArray[np.int32]:
        """Cluster the points in less time, into clusters that are less uniform: quality ``"fast"``."""
        return self._cluster(nclus, "fast", None, False)

    def _cluster(
        self, nclus: int, quality: Quality, max_iterations: Optional[int], allow_disconnected: bool
    ) -> NDArray[np.int32]:
        # as they are stored: points in single precision are not copied
        mesh = Mesh(np.asarray(self.mesh.points), _triangles(self.mesh))
        self.clusters, self.nclus = cluster_vertices(
            mesh,
            nclus,
            self._weights,
            quality=quality,
            max_iterations=max_iterations,
            allow_disconnected=allow_disconnected,
        )
        return self.clusters

    def subdivide(self, nsub: int, weights: Optional[ArrayLike] = None) -> None:
        """Cut every triangle into four, `nsub` times, and merge points at one position. Changes `mesh` in place.

        Parameters
        ----------
        nsub : int
            Number of times.
        weights : array_like, optional
            A number above 0 for each point of the finer mesh, or for each that ``mesh.subdivide(nsub)`` of pyvista has,
            which merges none; both are in the same order. When left out, those of the coarser mesh are interpolated.
        """
        points, triangles = _points(self.mesh), _triangles(self.mesh)
        finer_weights = self._weights
        for _ in range(nsub):
            ends, triangles = quartered(triangles, len(points))
            points = np.concatenate([points, points[ends].mean(axis=1)])
            if finer_weights is not None:
                finer_weights = np.concatenate([finer_weights, finer_weights[ends].mean(axis=1)])
        finer = _polydata(points, triangles)
        finer.point_data["number"] = np.arange(len(points))
        merged: Any = finer.clean()  # pyright: ignore[reportUnknownMemberType]
        # its points are in the order in which triangles use them
        numbers = np.asarray(merged.point_data["number"])
        order = np.argsort(numbers)
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        numbers = numbers[order]
        if weights is not None:
            finer_weights = np.asarray(weights, dtype=np.float64)
            if finer_weights.shape == numbers.shape:
                numbers = np.arange(len(numbers))
            elif finer_weights.shape != (len(points),):
                raise ValueError(
                    f"weights must be one for each of the {self.mesh.n_points} points, or for each of the "
                    f"{len(numbers)} after the subdivision: {finer_weights.shape}"
                )
        self._weights = None if finer_weights is None else finer_weights[numbers]
        self.mesh.copy_from(_polydata(_points(merged)[order], place[_triangles(merged)]))
        self.clusters = self.nclus = None

    def plot(self, random_color: bool = True, **kwargs: Any) -> Any:
        """Show the clusters.

        Parameters
        ----------
        random_color : bool
            Colours in no order; otherwise in that of the clusters.
        **kwargs
            Of `pyvista.plot`, such as ``off_screen`` and ``screenshot``.

        Returns
        -------
        What `pyvista.plot` returns.
        """
        mesh: Any = self.mesh
        if self.clusters is None or self.nclus is None:
            warnings.warn("there are no clusters to plot; call cluster() first", stacklevel=2)
            return mesh.plot(**kwargs)
        order = np.linspace(0, 1, self.nclus)
        if random_color:
            order = np.random.default_rng(0).permutation(order)
        colours = np.append(order, -0.25)[self.clusters]
        kwargs.setdefault("show_scalar_bar", False)
        return mesh.plot(scalars=colours, rng=[-0.25 if np.any(colours < 0) else 0, 1], **kwargs)

    def create_mesh(self, moveclus: bool = True, flipnorm: bool = True, clean: bool = True) -> pyvista.PolyData:
        """Make a mesh with a point a cluster, and a triangle for three clusters that meet in a triangle.

        Such a mesh has as many points as there are clusters and may have holes where a cluster is not a disk;
        `tesserae_mesh.Clustering.remesh` is always a manifold and has a few more points.

        Parameters
        ----------
        moveclus : bool
            Move each point from the mean of its cluster's points to the surface: to the nearest point of the triangles
            around that point of the cluster which is nearest to the mean.
        flipnorm : bool
            Turn triangles over that lie against the mean normal of their clusters. Others keep the orientation of the
            triangle that they come from.
        clean : bool
            Leave out points of clusters without a triangle.
        """
        clusters, _ = self._labels()
        points, triangles = self.cluster_centroid, _triangles(self.mesh)
        if moveclus:
            points = self._on_surface(points, clusters, triangles)
        met = clusters[triangles].astype(np.int64)
        a, b, c = met.T
        met = met[(a >= 0) & (b >= 0) & (c >= 0) & (a != b) & (b != c) & (c != a)]
        met = met[np.unique(np.sort(met, axis=1), axis=0, return_index=True)[1]]
        if flipnorm:
            against = np.einsum("ij,ij->i", normals(points, met), self.cluster_norm[met].sum(axis=1)) < 0
            met[against] = met[against, ::-1]
        if clean:
            left, numbers = np.unique(met, return_inverse=True)
            points, met = points[left], numbers.reshape(-1, 3)
        self.remesh = _polydata(points, met)
        return self.remesh

    @property
    def cluster_norm(self) -> NDArray[np.float64]:
        """The mean normal of each cluster, of length 1: of its points, whose normals are means of their triangles'."""
        triangles = _triangles(self.mesh)
        axes = _of_length_1(normals(_points(self.mesh), triangles)).T
        around = [_sums(triangles.ravel(), np.repeat(axis, 3), self.mesh.n_points) for axis in axes]
        return _of_length_1(self._sum(_of_length_1(np.stack(around, axis=1)) * self.area[:, None]))

    @property
    def cluster_centroid(self) -> NDArray[np.float64]:
        """The mean of each cluster's points, weighted by `area`."""
        return self._sum(self.wcent) / self._sum(self.area[:, None])

    def _labels(self) -> tuple[NDArray[np.int32], int]:
        if self.clusters is None or self.nclus is None:
            raise RuntimeError("there are no clusters yet; call cluster() first")
        return self.clusters, self.nclus

    def _sum(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The sum of a row a point over the points of each cluster."""
        clusters, nclus = self._labels()
        inside = clusters >= 0
        return np.stack([_sums(clusters[inside], axis[inside], nclus) for axis in values.T], axis=1)

    def _on_surface(
        self, means: NDArray[np.float64], clusters: NDArray[np.int32], triangles: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """For each cluster the nearest point of the triangles around its point that is nearest to its mean."""
        points = _points(self.mesh)
        members = np.flatnonzero(clusters >= 0)
        distance = np.square(points[members] - means[clusters[members]]).sum(axis=1)
        order = members[np.lexsort((distance, clusters[members]))]
        firsts = order[np.unique(clusters[order], return_index=True)[1]]
        owner = np.full(len(points), -1)
        owner[firsts] = clusters[firsts]
        face, corner = np.nonzero(owner[triangles] >= 0)
        cluster = owner[triangles[face, corner]]
        nearest = nearest_in_triangles(means[cluster], points[triangles[face]])
        distance = np.square(nearest - means[cluster]).sum(axis=1)
        order = np.lexsort((distance, cluster))
        found, at = np.unique(cluster[order], return_index=True)
        moved: NDArray[np.float64] = means.copy()
        moved[found] = nearest[order[at]]
        return moved


def triangulated(mesh: pyvista.PolyData) -> pyvista.PolyData:
    """A copy whose faces are triangles."""
    return cast("pyvista.PolyData", mesh.triangulate())


def _points(mesh: pyvista.PolyData) -> NDArray[np.float64]:
    return np.asarray(mesh.points, dtype=np.float64)


def _triangles(mesh: pyvista.PolyData) -> NDArray[np.int64]:
    # pyvista names no type of numbers. It is the array that VTK has; `faces` would be a new one
    faces: Any = mesh.regular_faces  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
    return np.asarray(faces, dtype=np.int64).reshape(-1, 3)


def _sums(
    owners: NDArray[np.integer[Any]], values: NDArray[np.floating[Any]], count: int
) -> NDArray[np.float64]:
    """The sum of the values of each owner."""
    return np.asarray(np.bincount(owners, values, count), dtype=np.float64)


def _of_length_1(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths = np.sqrt(np.square(vectors).sum(axis=1, keepdims=True))
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1))


def _polydata(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> pyvista.PolyData:
    return pyvista.PolyData(points, np.insert(triangles, 0, 3, axis=1).ravel())
