"""What `tesserae_mesh.cluster` and `tesserae_mesh.cluster_points` return."""

from __future__ import annotations

import json
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Optional

import numpy as np

from tesserae_mesh import _native
from tesserae_mesh._errors import Error
from tesserae_mesh._hierarchy import Cut, Hierarchy
from tesserae_mesh._items import Items
from tesserae_mesh._mesh import Mesh
from tesserae_mesh._picture import with_picture

if TYPE_CHECKING:
    import pyvista
    import trimesh
    from numpy.typing import ArrayLike, NDArray

Placement = Literal["fit", "surface", "centroid"]

ITERATION = np.dtype(
    [
        ("iteration", "u4"),
        ("phase", "U16"),
        ("round", "i8"),
        ("energy", "f8"),
        ("moves", "u8"),
        ("elapsed_us", "u8"),
    ]
)
"""A row of `Clustering.iterations`."""


SHOWN_OF_A_HIERARCHY = 100
"""Clusters in the picture of a whole hierarchy, where it has no fewer faces and no more roots."""


def outputs() -> dict[str, str]:
    """Return what `Clustering.output` can write: names of files, and what is in them."""
    return dict(_native.forms())


class Remesh(NamedTuple):
    """A triangle mesh with a vertex a cluster, a manifold for any labels."""

    points: NDArray[np.float64]
    """Positions, shape (V, 3), in units of the mesh. Point i is that of cluster i for all clusters; then come those of
    split-off parts of clusters, of the boundary, and of curves between clusters."""
    faces: NDArray[np.uint32]
    """Triangles, shape (T, 3), counter-clockwise seen from outside."""
    clusters: NDArray[np.uint32]
    """The cluster of each point; between two, the lower one."""
    source: dict[str, NDArray[Any]]
    """What each point stands for: ``kind`` (0 cluster, 1 split-off part, 2 boundary, 3 curve), ``face``, ``vertices``
    (three corners of that face) and ``barycentric``. An attribute of the mesh's points is there
    ``(barycentric[:, :, None] * attribute[vertices]).sum(axis=1)``."""
    summary: dict[str, Any]
    """What was checked: numbers of vertices and triangles, Euler number, boundary loops, components."""

    def to_trimesh(self) -> trimesh.Trimesh:
        """Return a ``trimesh.Trimesh``, whose ``vertex_attributes["cluster"]`` are `clusters`.

        Raises
        ------
        tesserae_mesh.Error
            trimesh is not installed (``"unavailable"``).
        """
        try:
            import trimesh
        except ImportError as error:
            raise Error("unavailable", "to_trimesh() needs trimesh: pip install trimesh") from error
        attributes: dict[str, ArrayLike] = {"cluster": self.clusters}
        return trimesh.Trimesh(self.points, self.faces.astype(np.int64), vertex_attributes=attributes, process=False)

    def to_pyvista(self) -> pyvista.PolyData:
        """Return a ``pyvista.PolyData``, whose point data ``cluster`` are `clusters`.

        Raises
        ------
        tesserae_mesh.Error
            pyvista is not installed (``"unavailable"``).
        """
        from tesserae_mesh._plot import polydata

        mesh = polydata(Mesh(self.points, self.faces))
        mesh.point_data["cluster"] = self.clusters
        return mesh

    def __repr__(self) -> str:
        clusters = self.summary["vertices"]["clusters"]
        return f"Remesh({self.points.shape[0]} points, {self.faces.shape[0]} triangles, {clusters} clusters)"

    def _repr_html_(self) -> str:
        return with_picture(repr(self), _native.Geometry(self.points, self.faces, None), None)


class Clustering:
    """The clusters of a mesh, or of points with neighbours.

    Not made by hand: `tesserae_mesh.cluster` and `tesserae_mesh.cluster_points` return one. That of points has no
    `mesh` and what is made of one: `remesh`, `plot` and some outputs.

    Attributes
    ----------
    labels : ndarray of uint32, shape (F,)
        The cluster of each face, 0 to ``clusters - 1``, numbered by the first face that carries them; those of listed
        seeds have the numbers of the seeds. Of points: int32, in the shape of the items, -1 where a mask
        leaves one out.
    clusters : int
        Number of clusters.
    energy : float
        Sum over faces of area x squared distance between the face's centroid and its cluster's (centroidal Voronoi
        diagram): area x length**2, in units of the mesh. Of points: weight x squared distance between the item and
        the mean of its cluster. With energy l21, of unit normals: area. NaN where it overflows.
    hexagon_ratio : float or None
        Energy over that of a flat tiling by regular hexagons; None where that is no measure, as with weights.
    """

    def __init__(
        self,
        outcome: _native.Outcome,
        mesh: Optional[Mesh],
        cut: Optional[Cut] = None,
        items: Optional[Items] = None,
    ) -> None:
        self._outcome = outcome
        self._mesh = mesh
        self._items = items
        self._cut = cut
        self.clusters: int = outcome.clusters if cut is None else cut.clusters
        energy = outcome.energy if cut is None else cut.energy
        self.energy: float = float("nan") if energy is None else energy
        self.hexagon_ratio: Optional[float] = outcome.hexagon_ratio if cut is None else None

    @cached_property
    def _labels(self) -> Optional[NDArray[Any]]:
        if self._cut is not None:
            return self._cut.labels
        labels = self._outcome.labels()
        return labels if labels is None or self._items is None else self._items.placed(labels)

    @property
    def labels(self) -> NDArray[Any]:
        """The cluster of each face or item.

        Raises
        ------
        tesserae_mesh.Error
            The clustering is a whole hierarchy, which has labels at every number of clusters: take `cut`
            (``"conflict"``).
        """
        if self._labels is None:
            raise Error("conflict", "a whole hierarchy has labels at every number of clusters: take them with cut(k)")
        return self._labels

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh: the arrays that were given, or those that were read from the file.

        Raises
        ------
        tesserae_mesh.Error
            The clustering is one of points (``"conflict"``).
        """
        if self._mesh is not None:
            return self._mesh
        geometry = self._geometry
        offsets, connectivity = geometry.offsets(), geometry.connectivity()
        faces = np.reshape(connectivity, (-1, 3)) if offsets is None else (offsets, connectivity)
        return Mesh(geometry.points(), faces)

    @cached_property
    def report(self) -> dict[str, Any]:
        """Everything that is known about the run, as ``--report`` writes it: input, parameters, energies, times.

        ``docs/results.md`` describes its members; ``input.format`` is None for arrays.
        """
        report: dict[str, Any] = json.loads(self._outcome.report())
        return report

    @cached_property
    def iterations(self) -> NDArray[np.void]:
        """One row an iteration: ``iteration``, ``phase``, ``round``, ``energy``, ``moves``, ``elapsed_us``.

        `round` is -1 for flat clusterings; `energy` is area x length**2, in units of the mesh, and NaN where it
        overflows.
        """
        rows = self.report["iterations"]
        missing = {"round": -1, "energy": float("nan")}
        columns = ITERATION.names or ()
        table = [tuple(missing.get(name) if row[name] is None else row[name] for name in columns) for row in rows]
        return np.array(table, dtype=ITERATION)

    @cached_property
    def snapshots(self) -> dict[int, NDArray[Any]]:
        """The labels at the iterations that `snapshots` asked for."""
        snapshots = dict(self._outcome.snapshots())
        if self._items is None:
            return snapshots
        return {iteration: self._items.placed(labels) for iteration, labels in snapshots.items()}

    @cached_property
    def sizes(self) -> NDArray[np.int64]:
        """Number of faces or items of each cluster."""
        labels = self.labels if self._items is None else self.labels[self.labels >= 0]
        return np.bincount(labels, minlength=self.clusters).astype(np.int64, copy=False)

    @cached_property
    def table(self) -> list[dict[str, Any]]:
        """A row a cluster, as ``--clusters-table`` writes it: size, area, place, shape, neighbours, energy; of points
        items, weight, energy, neighbours, component, mean."""
        rows: list[dict[str, Any]] = json.loads(self.output("clusters.json"))["clusters"]
        return rows

    @cached_property
    def centroids(self) -> NDArray[np.float64]:
        """Mean of each cluster, shape (clusters, d): of its faces' centroids, weighted by area, or of its items."""
        if self._items is not None:
            return np.array([row["mean"] for row in self.table], dtype=np.float64)
        missing = [float("nan")] * 3
        rows = [row["centroid"] or missing for row in self.table]
        return np.reshape(np.array(rows, dtype=np.float64), (-1, 3))

    @cached_property
    def hierarchy(self) -> Hierarchy:
        """The hierarchy, of the algorithms pml, ml and hr.

        Raises
        ------
        tesserae_mesh.Error
            The clustering is flat (``"conflict"``).
        """
        tree = self._outcome.tree()
        if tree is None:
            raise Error("conflict", 'a flat clustering has no hierarchy; take algorithm="pml", "ml" or "hr"')
        return Hierarchy(tree, self._items)

    def cut(self, clusters: int) -> Clustering:
        """Return the clustering of the same mesh or points at another number of clusters, taken from the hierarchy.

        Raises
        ------
        tesserae_mesh.Error
            The clustering is flat (``"conflict"``), or its hierarchy has no such cut (``"invalid-parameter"``).
        """
        return Clustering(self._outcome, self._mesh, self.hierarchy.cut(clusters), self._items)

    def remesh(self, placement: Placement = "fit") -> Remesh:
        """Make a triangle mesh with a vertex a cluster.

        Parameters
        ----------
        placement : {"fit", "surface", "centroid"}
            Where a cluster's vertex stands: at the least squared distance to the surface, at the point of the surface
            nearest to the cluster's centroid, or at the centroid.
        """
        points, faces, clusters, source, summary = self._geometry.remesh(self.labels, self.clusters, placement)
        return Remesh(points, faces, clusters, source, json.loads(summary))

    def output(
        self,
        form: str,
        *,
        placement: Placement = "fit",
        ply_vertex_colours: bool = False,
        force: bool = False,
    ) -> bytes:
        """Return an output of the command line as the bytes of its file.

        Parameters
        ----------
        form : str
            ``"labels.npy"``, ``"mesh.ply"``, ``"submeshes.zip"``, ``"graph.npz"``, ``"boundaries.json"``,
            ``"remesh.obj"``, ...: `tesserae_mesh.outputs` lists them.
        placement : {"fit", "surface", "centroid"}
            Where the vertices of a remesh are placed.
        ply_vertex_colours : bool
            Colour the vertices of a PLY in place of its faces, for readers that know no colours of faces.
        force : bool
            Write submeshes as GLB although they are more than readers load within seconds.

        Raises
        ------
        tesserae_mesh.Error
            There is no such output, or not of this clustering (``"not-found"``, ``"conflict"``).
        """
        cut = None if self._cut is None else (self._cut.labels.reshape(-1).view(np.uint32), self._cut.clusters)
        geometry = self._geometry if self._items is None else None
        return self._outcome.encode(form, geometry, cut, placement, ply_vertex_colours, force)

    @cached_property
    def _geometry(self) -> _native.Geometry:
        if self._items is not None:
            raise Error("conflict", "points have no mesh, of which this is made: cluster() takes meshes")
        if self._mesh is not None:
            return _native.Geometry(self._mesh.points, self._mesh.connectivity, self._mesh.offsets)
        geometry = self._outcome.geometry()
        if geometry is None:
            raise Error("mesh-not-kept", "the mesh of this clustering was not kept")
        return geometry

    def plot(self, **options: Any) -> Any:
        """Show the clusters by pyvista, in the colours that outputs have.

        Parameters
        ----------
        **options
            Of `pyvista.plot`, such as ``off_screen=True``, ``screenshot="clusters.png"`` and ``show_edges=True``.

        Returns
        -------
        What `pyvista.plot` returns.

        Raises
        ------
        tesserae_mesh.Error
            pyvista is not installed (``"unavailable"``).
        """
        from tesserae_mesh._plot import polydata

        mesh: Any = polydata(self.mesh)
        return mesh.plot(scalars=_native.colours(self.clusters)[self.labels], rgb=True, **options)

    def __repr__(self) -> str:
        read = self.report["input"]
        what = f"{read['faces']} faces" if self._items is None else f"{read['items'] - read['masked']} items"
        return f"Clustering({what}, {self.clusters} clusters, energy {self.energy:.6g})"

    def _repr_html_(self) -> str:
        if self._items is not None:
            return f"<pre>{self!r}</pre>"
        if self._labels is not None:
            return with_picture(repr(self), self._geometry, self._labels)
        cut = self.hierarchy.cut(max(self.clusters, min(SHOWN_OF_A_HIERARCHY, self._outcome.faces)))
        return with_picture(f"{self!r}, cut at {cut.clusters}", self._geometry, cut.labels)
