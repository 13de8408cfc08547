"""Meshes for pyvista."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tesserae_mesh._errors import Error

if TYPE_CHECKING:
    import pyvista

    from tesserae_mesh._mesh import Mesh


def polydata(mesh: Mesh) -> pyvista.PolyData:
    """A mesh as pyvista's."""
    try:
        import pyvista
    except ImportError as error:
        raise Error("unavailable", "this needs pyvista: pip install pyvista") from error
    return pyvista.PolyData(mesh.points, mesh.padded())
