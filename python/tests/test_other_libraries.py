"""Meshes as objects of other libraries, of those that are installed: their labels are those of the arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import read_obj

import tesserae_mesh

Sample = Callable[[str, int], Path]
Make = Callable[[Any, Any], Any]


def of_pyvista(points: Any, faces: Any) -> Any:
    pyvista = pytest.importorskip("pyvista")
    return pyvista.PolyData(points, np.insert(faces, 0, faces.shape[1], axis=1).ravel())


def of_trimesh(points: Any, faces: Any) -> Any:
    return pytest.importorskip("trimesh").Trimesh(points, faces, process=False)


def of_open3d(points: Any, faces: Any) -> Any:
    open3d = pytest.importorskip("open3d")
    return open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(points), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )


def of_meshio(points: Any, faces: Any) -> Any:
    kind = {3: "triangle", 4: "quad"}[faces.shape[1]]
    half = len(faces) // 2
    cells = [(kind, faces[:half]), ("vertex", np.array([[0]])), (kind, faces[half:])]
    return pytest.importorskip("meshio").Mesh(points, cells)


@pytest.mark.parametrize("make", [of_pyvista, of_trimesh, of_open3d, of_meshio])
def test_triangles_of_an_object_have_the_labels_of_their_arrays(make: Make, sample: Sample) -> None:
    points, rows = read_obj(sample("knot", 2000))
    faces = np.array(rows)
    mesh = make(points, faces)
    clustering = tesserae_mesh.cluster(mesh, clusters=30)
    assert np.array_equal(clustering.labels, tesserae_mesh.cluster(points, faces, 30).labels)
    # outputs that are made of the mesh take the object's, too
    assert clustering.remesh("centroid").points.shape[1] == 3


@pytest.mark.parametrize("make", [of_pyvista, of_meshio])
def test_quads_of_an_object_have_the_labels_of_their_arrays(make: Make) -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    points = np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1).reshape(-1, 3)
    corner = (np.arange(19)[:, None] * 20 + np.arange(19)).reshape(-1)
    faces = np.stack([corner, corner + 1, corner + 21, corner + 20], axis=1)
    labels = tesserae_mesh.cluster(make(points, faces), clusters=20).labels
    assert np.array_equal(labels, tesserae_mesh.cluster(points, faces, 20).labels)


def test_triangles_of_pyvista_are_those_of_vtk_without_a_copy() -> None:
    pyvista = pytest.importorskip("pyvista")
    sphere = pyvista.Sphere()
    mesh = tesserae_mesh.Mesh.of(sphere)
    assert mesh.points.dtype == np.float32 and np.shares_memory(mesh.points, sphere.points)
    assert mesh.connectivity.shape == (sphere.n_cells, 3) and np.shares_memory(mesh.connectivity, sphere.regular_faces)


def test_polygons_of_pyvista_are_mixed() -> None:
    pyvista = pytest.importorskip("pyvista")
    mesh = pyvista.PolyData(np.eye(5, 3), [3, 0, 1, 2, 4, 0, 1, 3, 4])
    assert tesserae_mesh.Mesh.of(mesh).n_faces == 2
    strips = pyvista.Sphere().strip()
    with pytest.raises(tesserae_mesh.Error) as caught:
        tesserae_mesh.cluster(strips, clusters=5)
    assert caught.value.kind == "unsupported-mesh"
