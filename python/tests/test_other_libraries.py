"""Meshes as objects of other libraries, of those that are installed: their labels are those of the arrays."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import read_obj, real_meshes

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


def scene_of_parts() -> Any:
    """A tree of nodes: a box twice, once mirrored, below a node that turns, a path, and a ball."""
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    turned = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.2, 0, 0])
    scene.graph.update(frame_to="turned", matrix=turned)
    scene.add_geometry(trimesh.creation.box(), geom_name="box", node_name="a", parent_node_name="turned")
    mirror = np.diag([-1.0, 2, 1, 1])
    mirror[:3, 3] = [4, 0, 1]
    scene.graph.update(frame_to="b", frame_from="turned", matrix=mirror, geometry="box")
    scene.add_geometry(trimesh.load_path(np.array([[0.0, 0, 0], [9, 9, 9]])))
    scene.add_geometry(trimesh.creation.icosphere(subdivisions=3), transform=np.diag([0.5, 0.5, 0.5, 1]))
    return scene


def test_a_scene_is_one_mesh_with_everything_at_its_place() -> None:
    scene = scene_of_parts()
    joined = scene.to_mesh()
    mesh = tesserae_mesh.Mesh.of(scene)
    assert np.allclose(mesh.points, joined.vertices) and np.array_equal(mesh.connectivity, joined.faces)
    assert not np.allclose(mesh.points, np.concatenate([part.vertices for part in scene.dump()[:2]] * 2)[0])
    clustering = tesserae_mesh.cluster(scene, 30)
    assert np.array_equal(clustering.labels, tesserae_mesh.cluster(mesh.points, mesh.connectivity, 30).labels)
    with pytest.raises(tesserae_mesh.Error, match="the scene has no meshes"):
        tesserae_mesh.cluster(type(scene)(), 3)


@pytest.mark.parametrize("path", list(real_meshes(".glb", ".gltf")), ids=lambda path: str(path.name))
def test_scenes_of_real_files_are_what_trimesh_joins(path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    try:
        scene = trimesh.load_scene(path)
    except Exception as error:  # of any kind: what trimesh does not read is no input of ours
        pytest.skip(f"trimesh does not read it: {error!r:.80}")
    if not any(hasattr(part, "faces") for part in scene.geometry.values()):
        pytest.skip("no meshes")
    joined = scene.to_mesh()
    mesh = tesserae_mesh.Mesh.of(scene)
    assert np.array_equal(mesh.connectivity, joined.faces)
    assert np.allclose(mesh.points, joined.vertices, atol=1e-9 * np.abs(joined.vertices).max())


def test_a_remesh_becomes_an_object_of_trimesh_and_pyvista(sample: Sample) -> None:
    pytest.importorskip("trimesh")
    pytest.importorskip("pyvista")
    remesh = tesserae_mesh.cluster(sample("knot", 3000), 300).remesh()
    mesh = remesh.to_trimesh()
    assert mesh.is_watertight and mesh.volume > 0
    assert np.array_equal(mesh.vertices, remesh.points) and np.array_equal(mesh.faces, remesh.faces)
    assert np.array_equal(mesh.vertex_attributes["cluster"], remesh.clusters)
    data = remesh.to_pyvista()
    assert data.is_manifold and np.array_equal(data.points, remesh.points)
    assert np.array_equal(data.regular_faces, remesh.faces)
    assert np.array_equal(data.point_data["cluster"], remesh.clusters)


@pytest.mark.parametrize("name", ["trimesh", "pyvista"])
def test_a_library_that_is_not_installed_is_named(sample: Sample, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    remesh = tesserae_mesh.cluster(sample("knot", 500), 50).remesh()
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(tesserae_mesh.Error, match=f"needs {name}: pip install") as caught:
        getattr(remesh, f"to_{name}")()
    assert caught.value.kind == "unavailable"


def test_a_client_without_its_libraries_says_what_it_needs() -> None:
    code = "import sys; sys.modules['httpx'] = None; import tesserae_mesh; tesserae_mesh.Client"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1 and "Client needs httpx: pip install httpx httpx-sse" in done.stderr, done.stderr


def test_polygons_of_pyvista_are_mixed() -> None:
    pyvista = pytest.importorskip("pyvista")
    mesh = pyvista.PolyData(np.eye(5, 3), [3, 0, 1, 2, 4, 0, 1, 3, 4])
    assert tesserae_mesh.Mesh.of(mesh).n_faces == 2
    strips = pyvista.Sphere().strip()
    with pytest.raises(tesserae_mesh.Error) as caught:
        tesserae_mesh.cluster(strips, clusters=5)
    assert caught.value.kind == "unsupported-mesh"
