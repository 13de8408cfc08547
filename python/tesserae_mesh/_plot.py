"""Pictures of clusterings, by pyvista."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tesserae_mesh._errors import Error

if TYPE_CHECKING:
    import pyvista
    from numpy.typing import NDArray

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
    return mesh.plot(scalars=colours(clustering.clusters)[clustering.labels], rgb=True, **options)


def polydata(mesh: Mesh) -> pyvista.PolyData:
    """A mesh as pyvista's."""
    try:
        import pyvista
    except ImportError as error:
        raise Error("unavailable", "pictures need pyvista: pip install tesserae-mesh[plot]") from error
    return pyvista.PolyData(mesh.points, mesh.padded())


def colours(clusters: int) -> NDArray[np.uint8]:
    """The colour of each cluster in outputs: hue frac(0.61803398875 i), three saturations, four values."""
    i = np.arange(clusters)
    hue = 6 * (0.61803398875 * i % 1.0)
    saturation = np.array([0.75, 0.5, 0.9])[i % 3]
    value = np.array([0.95, 0.75, 0.85, 0.65])[i % 4]
    # https://en.wikipedia.org/wiki/HSL_and_HSV, HSV to RGB alternative
    turn = (np.array([5, 3, 1]) + hue[:, None]) % 6
    rgb = value[:, None] * (1 - saturation[:, None] * np.clip(np.minimum(turn, 4 - turn), 0, 1))
    return np.asarray(np.rint(255 * rgb), dtype=np.uint8)
