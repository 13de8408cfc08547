"""Stands in for pyacvd: ``from tesserae_mesh.pyacvd import Clustering``, or ``from tesserae_mesh import pyacvd``.

As in pyacvd, clusters are of the points of a triangle mesh, and the energy is the sum over points of area times squared
distance to the mean of the cluster, which is weighted by area. The area of a point is a third of that of the triangles
around it: pyacvd's weight up to the factor. Points are neighbours where they share an edge. One thing is not as there:
points at one position are one point with one label, so a seam of a texture is no boundary. ``docs/python-http.md``
lists every difference. Modules have the names that they have there.
"""

from __future__ import annotations

from tesserae_mesh.pyacvd._accessor import ACVDAccessor, register_accessor
from tesserae_mesh.pyacvd.clustering import Clustering

__all__ = ["ACVDAccessor", "Clustering", "register_accessor"]

register_accessor()
