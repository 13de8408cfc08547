"""``mesh.acvd`` on every ``pyvista.PolyData``."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Optional

import numpy as np
import pyvista

from tesserae_mesh.pyacvd.clustering import Clustering, triangulated

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["ACVDAccessor"]


class ACVDAccessor:
    """``mesh.acvd`` as pyacvd registers it, by this module's `Clustering`. The mesh is not changed.

    Parameters
    ----------
    mesh : pyvista.PolyData
        The mesh.
    """

    def __init__(self, mesh: pyvista.PolyData) -> None:
        self._mesh = mesh

    def clustering(self, weights: Optional[ArrayLike] = None, *, subdivide: int = 0) -> Clustering:
        """A `Clustering` of a copy of the mesh, whose triangles were cut into four `subdivide` times.

        `weights` are of the points of the mesh, or of those of the finer one, as of `Clustering.subdivide`.
        """
        mesh = triangulated(self._mesh)
        if not subdivide or weights is None or np.shape(weights) == (mesh.n_points,):
            made, weights = Clustering(mesh, weights), None
        else:
            made = Clustering(mesh)
        if subdivide:
            made.subdivide(subdivide, weights)
        return made

    def cluster_ids(
        self,
        n_clusters: int,
        *,
        subdivide: int = 0,
        weights: Optional[ArrayLike] = None,
        maxiter: Optional[int] = None,
        iso_try: Optional[int] = None,
        fast: bool = False,
    ) -> NDArray[np.int32]:
        """The cluster of each point; parameters as of `Clustering.cluster` and `clustering`."""
        made = self.clustering(weights, subdivide=subdivide)
        return made.fast_cluster(n_clusters) if fast else made.cluster(n_clusters, maxiter=maxiter, iso_try=iso_try)

    def remesh(
        self,
        n_clusters: int,
        *,
        subdivide: int = 0,
        weights: Optional[ArrayLike] = None,
        maxiter: Optional[int] = None,
        iso_try: Optional[int] = None,
        fast: bool = False,
        moveclus: bool = True,
        flipnorm: bool = True,
        clean: bool = True,
    ) -> pyvista.PolyData:
        """A mesh with a point a cluster; parameters as of `cluster_ids` and `Clustering.create_mesh`."""
        made = self.clustering(weights, subdivide=subdivide)
        if fast:
            made.fast_cluster(n_clusters)
        else:
            made.cluster(n_clusters, maxiter=maxiter, iso_try=iso_try)
        return made.create_mesh(moveclus=moveclus, flipnorm=flipnorm, clean=clean)

    def subdivide(self, nsub: int) -> pyvista.PolyData:
        """The mesh with every triangle in four, `nsub` times."""
        return self.clustering(subdivide=nsub).mesh


def register_accessor() -> None:
    """Make ``mesh.acvd`` an `ACVDAccessor`.

    The import of this module does so. A later import of pyacvd makes it pyacvd's.
    """
    if hasattr(pyvista, "register_dataset_accessor"):
        with warnings.catch_warnings():
            # that it takes the place of pyacvd's
            warnings.simplefilter("ignore", UserWarning)
            pyvista.register_dataset_accessor("acvd", pyvista.PolyData)(ACVDAccessor)
