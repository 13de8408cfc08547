"""Clusters the faces of polygon meshes, and points with neighbours, fast and reproducibly.

>>> import tesserae_mesh
>>> clustering = tesserae_mesh.cluster(points, faces, clusters=1000)  # doctest: +SKIP
>>> clustering.labels                                                 # doctest: +SKIP
array([  0,   0, 731, ...], dtype=uint32)

`cluster_points` clusters rows of coordinates over a graph, `superpixels` the pixels of an image, and
`tesserae_mesh.sklearn` has an estimator.

Labels depend on the input and the parameters only: not on threads, machine or device. They equal those of the command
line (``python -m tesserae_mesh cluster``) for the same input and parameters.

Nothing but the standard library is imported until a name of this module is first used, so that ``import
tesserae_mesh`` and the command line start at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tesserae_mesh._cluster import cluster as cluster
    from tesserae_mesh._clustering import Clustering as Clustering
    from tesserae_mesh._clustering import Remesh as Remesh
    from tesserae_mesh._clustering import outputs as outputs
    from tesserae_mesh._errors import ClusteringWarning as ClusteringWarning
    from tesserae_mesh._errors import Error as Error
    from tesserae_mesh._hierarchy import Cut as Cut
    from tesserae_mesh._hierarchy import Hierarchy as Hierarchy
    from tesserae_mesh._mesh import Mesh as Mesh
    from tesserae_mesh._native import __version__ as __version__
    from tesserae_mesh._points import cluster_points as cluster_points
    from tesserae_mesh._points import superpixels as superpixels
    from tesserae_mesh._rows import Iteration as Iteration
    from tesserae_mesh._rows import Level as Level
    from tesserae_mesh.client import AsyncClient as AsyncClient
    from tesserae_mesh.client import Client as Client

_MODULES = {
    "AsyncClient": "client",
    "Client": "client",
    "Clustering": "_clustering",
    "ClusteringWarning": "_errors",
    "Cut": "_hierarchy",
    "Error": "_errors",
    "Hierarchy": "_hierarchy",
    "Iteration": "_rows",
    "Level": "_rows",
    "Mesh": "_mesh",
    "Remesh": "_clustering",
    "__version__": "_native",
    "cluster": "_cluster",
    "cluster_points": "_points",
    "outputs": "_clustering",
    "superpixels": "_points",
}

__all__ = [
    "AsyncClient",
    "Client",
    "Clustering",
    "ClusteringWarning",
    "Cut",
    "Error",
    "Hierarchy",
    "Iteration",
    "Level",
    "Mesh",
    "Remesh",
    "__version__",
    "cluster",
    "cluster_points",
    "outputs",
    "superpixels",
]


def __getattr__(name: str) -> object:
    module = _MODULES.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        value: object = getattr(import_module(f"{__name__}.{module}"), name)
    except ModuleNotFoundError as error:
        if module != "client":
            raise
        raise ModuleNotFoundError(f"{name} needs {error.name}: pip install httpx httpx-sse", name=error.name) from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
