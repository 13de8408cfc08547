"""Pictures of clusterings, by pyvista."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tesserae_mesh import _native
from tesserae_mesh._errors import Error

if TYPE_CHECKING:
    import pyvista

    from tesserae_mesh._clustering import Clustering
    from tesserae_mesh._mesh import Mesh


def plot(clustering: Clustering, **options: Any) -> Any:
    """Show the clusters in the colours that outputs have.

    Parameters
    ----------
    clustering : Clustering
        What to show.
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
    mesh: Any = polydata(clustering.mesh)
    return mesh.plot(scalars=_native.colours(clustering.clusters)[clustering.labels], rgb=True, **options)


def polydata(mesh: Mesh) -> pyvista.PolyData:
    """A mesh as pyvista's."""
    try:
        import pyvista
    except ImportError as error:
        raise Error("unavailable", "this needs pyvista: pip install pyvista") from error
    return pyvista.PolyData(mesh.points, mesh.padded())
