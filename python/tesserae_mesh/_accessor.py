"""``mesh.tesserae`` on every ``pyvista.PolyData``.

pyvista 0.48 and later finds it by the entry point of the package, without an import of ours; ``import
tesserae_mesh._accessor`` registers it, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pyvista

from tesserae_mesh._cluster import cluster

if TYPE_CHECKING:
    from tesserae_mesh._clustering import Clustering, Placement


class TesseraeAccessor:
    """Clusters and remeshes of a mesh. The mesh is not changed.

    Parameters
    ----------
    mesh : pyvista.PolyData
        The mesh; its polygons may have any number of corners.

    Examples
    --------
    >>> import pyvista
    >>> mesh = pyvista.Sphere()                            # doctest: +SKIP
    >>> mesh.cell_data["cluster"] = mesh.tesserae.cluster(100).labels  # doctest: +SKIP
    >>> mesh.tesserae.remesh(100).plot(show_edges=True)    # doctest: +SKIP
    """

    def __init__(self, mesh: pyvista.PolyData) -> None:
        self._mesh = mesh

    def cluster(self, clusters: int = 1000, **parameters: Any) -> Clustering:
        """Cluster the cells; `tesserae_mesh.cluster` describes the parameters."""
        return cluster(self._mesh, clusters=clusters, **parameters)

    def remesh(self, clusters: int = 1000, *, placement: Placement = "fit", **parameters: Any) -> pyvista.PolyData:
        """Make a manifold triangle mesh with a point a cluster; its point data ``cluster`` says which.

        Parameters
        ----------
        clusters : int
            Number of clusters. There are a few more points where the topology and the boundary need them.
        placement : {"fit", "surface", "centroid"}
            Where points are placed: see `tesserae_mesh.Clustering.remesh`.
        **parameters
            Of `tesserae_mesh.cluster`.
        """
        return self.cluster(clusters, **parameters).remesh(placement).to_pyvista()

    def plot(self, clusters: int = 1000, **options: Any) -> Any:
        """Cluster the cells and show the clusters; options of `pyvista.plot`."""
        return self.cluster(clusters).plot(**options)


if hasattr(pyvista, "register_dataset_accessor"):
    pyvista.register_dataset_accessor("tesserae", pyvista.PolyData)(TesseraeAccessor)
