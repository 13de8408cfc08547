"""The stand-in for pyacvd: its README, its meanings, and pyacvd itself beside it where that is installed."""

from __future__ import annotations

import pathlib
import warnings
from typing import Any

import numpy as np
import pytest

pyvista = pytest.importorskip("pyvista")

import tesserae_mesh  # noqa: E402
from tesserae_mesh import pyacvd  # noqa: E402
from tesserae_mesh._triangles import nearest_in_triangles, normals  # noqa: E402
from tesserae_mesh.pyacvd import Clustering  # noqa: E402

Array = np.ndarray[Any, Any]


@pytest.fixture(autouse=True)
def off_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)


def triangles(mesh: Any) -> Array:
    return np.asarray(mesh.faces).reshape(-1, 4)[:, 1:]


def uneven(resolution: int = 40) -> Any:
    """A closed surface whose triangles are of very different sizes."""
    mesh = pyvista.Sphere(theta_resolution=resolution, phi_resolution=resolution)
    mesh.points = mesh.points * [1.0, 1.0, 2.5]
    return mesh


def energy(mesh: Any, labels: Array) -> float:
    """What pyacvd minimises: points weighted by the area around them, squared distance to the mean of the cluster."""
    points = np.asarray(mesh.points, dtype=float)
    weights = Clustering(mesh).area
    total = 0.0
    for cluster in np.unique(labels):
        of = labels == cluster
        mean = np.average(points[of], axis=0, weights=weights[of])
        total += float((weights[of] * np.square(points[of] - mean).sum(axis=1)).sum())
    return total


def pieces(mesh: Any, labels: Array) -> int:
    """Number of connected pieces of clusters, across edges of triangles."""
    parent = list(range(mesh.n_points))

    def root(a: int) -> int:
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        return a

    faces = triangles(mesh)
    for a, b in np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]):
        if labels[a] == labels[b]:
            parent[root(a)] = root(b)
    return len({root(a) for a in range(mesh.n_points) if labels[a] >= 0})


def doubled(mesh: Any) -> Any:
    """The same surface with three points of its own for each triangle."""
    faces = triangles(mesh)
    return pyvista.PolyData(
        np.asarray(mesh.points)[faces.ravel()], np.insert(np.arange(faces.size).reshape(-1, 3), 0, 3, axis=1).ravel()
    )


def test_points_at_one_position_have_one_label() -> None:
    mesh = uneven()
    joined, apart = Clustering(mesh), Clustering(doubled(mesh))
    joined.cluster(90)
    apart.cluster(90)
    assert joined.clusters is not None and apart.clusters is not None
    of_corners = joined.clusters[triangles(mesh).ravel()]
    # a label of one has exactly one of the other: positions are numbered by first use, in both
    pairs = np.unique(np.stack([of_corners, apart.clusters]), axis=1)
    assert pairs.shape[1] == 90 == len(np.unique(apart.clusters))
    assert Clustering(doubled(mesh)).cluster(mesh.n_points).max() + 1 == mesh.n_points


def test_precision_of_points_does_not_matter() -> None:
    mesh = uneven()
    single = pyvista.PolyData(np.asarray(mesh.points, dtype=np.float32), mesh.faces)
    double = pyvista.PolyData(np.asarray(single.points, dtype=np.float64), mesh.faces)
    assert (single.points.dtype, double.points.dtype) == (np.float32, np.float64)
    assert np.array_equal(Clustering(single).cluster(70), Clustering(double).cluster(70))


def test_equal_weights_are_none() -> None:
    mesh = uneven()
    weighted = Clustering(mesh, weights=np.full(mesh.n_points, 7.0))
    assert np.array_equal(weighted.cluster(70), Clustering(mesh).cluster(70))


@pytest.mark.parametrize("weight", [0.0, -1.0, np.nan, np.inf])
def test_weights_that_are_none_are_refused(weight: float) -> None:
    mesh = uneven(12)
    weights = np.ones(mesh.n_points)
    weights[3] = weight
    with pytest.raises(tesserae_mesh.Error, match="above 0") as caught:
        Clustering(mesh, weights=weights).cluster(5)
    assert caught.value.kind == "invalid-parameter"


def test_exactly_so_many_clusters_each_connected() -> None:
    mesh = uneven()
    for nclus in (1, 7, 100, 600):
        clustering = Clustering(mesh)
        labels = clustering.cluster(nclus)
        assert labels.dtype == np.int32
        assert labels is clustering.clusters
        assert clustering.nclus == nclus
        assert np.array_equal(np.unique(labels), np.arange(nclus))
        assert pieces(mesh, labels) == nclus


def test_clusters_are_the_same_each_time() -> None:
    mesh = uneven()
    labels = Clustering(mesh).cluster(50)
    assert np.array_equal(labels, Clustering(mesh.copy()).cluster(50))


def test_pyacvd_does_not_find_a_lower_energy() -> None:
    peer = pytest.importorskip("pyacvd")
    mesh = uneven(60)
    for nclus in (30, 300):
        theirs = peer.Clustering(mesh.copy())
        theirs.cluster(nclus)
        ours = Clustering(mesh).cluster(nclus)
        assert energy(mesh, ours) < energy(mesh, theirs.clusters)


def test_weights_draw_clusters() -> None:
    mesh = pyvista.Plane(i_resolution=60, j_resolution=60).triangulate()
    right = np.asarray(mesh.points)[:, 0] > 0
    labels = Clustering(mesh, weights=np.where(right, 16.0, 1.0)).cluster(100)
    dense, other = len(set(labels[right])), len(set(labels[~right]))
    assert 2.5 < dense / other < 6
    with pytest.raises(ValueError, match="weights"):
        Clustering(mesh, weights=[1.0])


def test_arguments_that_mean_nothing_are_warned_of() -> None:
    clustering = Clustering(uneven(12))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        clustering.cluster(5)
        clustering.cluster(5, maxiter=2)
        clustering.cluster(5, iso_try=0)
        clustering.cluster(5, init_only=True)
        clustering.fast_cluster(5)
    with pytest.warns(UserWarning, match="iso_try"):
        clustering.cluster(5, 100, False, 10)
    with pytest.warns(UserWarning, match="debug"):
        clustering.cluster(5, debug=True)


def test_limits_on_iterations_are_kept() -> None:
    mesh = uneven()
    start, one, end = (Clustering(mesh) for _ in range(3))
    start.cluster(60, init_only=True)
    one.cluster(60, maxiter=1)
    end.cluster(60)
    assert start.clusters is not None and one.clusters is not None and end.clusters is not None
    assert energy(mesh, start.clusters) > energy(mesh, one.clusters) > energy(mesh, end.clusters)


def test_more_clusters_than_points_and_fewer_than_components() -> None:
    mesh = uneven(12)
    clustering = Clustering(mesh)
    assert np.array_equal(np.sort(clustering.cluster(10**6)), np.arange(mesh.n_points))
    assert clustering.nclus == mesh.n_points
    apart = mesh.merge(mesh.translate((9, 0, 0))).merge(mesh.translate((0, 9, 0))).extract_surface(algorithm=None)
    assert len(np.unique(Clustering(apart).cluster(2))) == 2
    with pytest.raises(tesserae_mesh.Error) as caught:
        Clustering(mesh).cluster(0)
    assert caught.value.kind == "invalid-parameter"


def test_points_without_a_triangle_have_no_cluster() -> None:
    mesh = uneven(12)
    lonely = pyvista.PolyData(np.vstack([mesh.points, [[9, 9, 9]]]), mesh.faces)
    clustering = Clustering(lonely)
    labels = clustering.cluster(20)
    assert labels[-1] == -1
    assert np.array_equal(np.unique(labels), np.arange(-1, 20))
    assert clustering.create_mesh().n_points == 20
    clustering.plot()


def test_subdivision_cuts_triangles_in_four_in_place() -> None:
    mesh = uneven(12)
    area, faces = mesh.area, mesh.n_cells
    clustering = Clustering(mesh)
    clustering.cluster(5)
    clustering.subdivide(2)
    assert clustering.mesh is mesh
    assert mesh.n_cells == 16 * faces
    assert mesh.area == pytest.approx(area)
    assert mesh.is_manifold
    assert clustering.clusters is None
    quads = pyvista.Box(quads=True)
    clustering = Clustering(quads)
    clustering.subdivide(1)
    assert (quads.n_cells, clustering.mesh.n_cells) == (6, 48)


def test_subdivided_points_are_those_of_pyvista_in_their_order() -> None:
    mesh = uneven(12)
    finer, theirs = Clustering(mesh.copy()), mesh.subdivide(2)
    finer.subdivide(2)
    assert np.allclose(finer.mesh.points, theirs.points, atol=1e-6)
    # a cylinder has points at one position, of which pyvista merges none
    mesh = pyvista.Cylinder().triangulate()
    finer, theirs = Clustering(mesh.copy()), mesh.subdivide(2)
    finer.subdivide(2)
    assert finer.mesh.n_points < theirs.n_points
    apart = np.linalg.norm(finer.mesh.points[:, None] - theirs.points, axis=2)
    assert apart.min(axis=0).max() < 1e-6 and apart.min(axis=1).max() < 1e-6


@pytest.mark.skipif(not hasattr(pyvista, "register_dataset_accessor"), reason="pyvista is older than 0.48")
@pytest.mark.parametrize("mesh", [pyvista.Cylinder().triangulate(), uneven(20)], ids=["seam", "no seam"])
def test_weights_may_be_those_of_the_subdivided_points(mesh: Any) -> None:
    pyacvd.register_accessor()

    def weights(points: Any) -> Array:
        # of three coordinates, so that no other order of points has the same
        return np.asarray(1 + np.exp(np.asarray(points, dtype=float) @ [3.0, 2.0, 1.0]))

    def labels(given: Any) -> Array:
        return np.asarray(mesh.acvd.cluster_ids(60, subdivide=2, weights=given))

    finer, theirs = mesh.acvd.subdivide(2), mesh.subdivide(2)
    for given in (weights(finer.points), weights(theirs.points)):
        made = mesh.acvd.clustering(given, subdivide=2)
        assert np.allclose(made._weights, weights(made.mesh.points), rtol=1e-5)
        made = mesh.acvd.clustering(given[::-1], subdivide=2)
        assert not np.allclose(made._weights, weights(made.mesh.points), rtol=0.5), "another order is seen"
    expected = labels(weights(finer.points))
    heavy = weights(finer.points) > np.median(weights(finer.points))
    assert len(np.unique(expected[heavy])) > 1.3 * len(np.unique(expected[~heavy]))
    coarse = mesh.acvd.clustering(weights(mesh.points), subdivide=2)._weights
    assert coarse is not None and coarse.shape == (finer.n_points,)
    assert np.isclose(coarse.min(), weights(mesh.points).min()) and np.isclose(coarse.max(), weights(mesh.points).max())
    assert mesh.acvd.remesh(60, subdivide=2, weights=np.ones(theirs.n_points)).n_points == 60
    numbers = rf"{mesh.n_points} points, or for each of the {finer.n_points} after the subdivision: \(7,\)"
    with pytest.raises(ValueError, match=numbers):
        labels(np.ones(7))


def test_meshes_have_the_topology_of_the_clusters() -> None:
    mesh = uneven()
    clustering = Clustering(mesh)
    clustering.cluster(200)
    made = clustering.create_mesh()
    assert made is clustering.remesh
    assert made.n_points == 200
    assert made.is_manifold
    assert made.n_points - made.n_cells // 2 == 2, "a sphere"
    outward = np.einsum("ij,ij->i", made.compute_normals(cell_normals=True, consistent_normals=False,
                        auto_orient_normals=False)["Normals"], made.cell_centers().points)  # fmt: skip
    assert (outward > 0).all()
    on_surface = mesh.find_closest_cell(made.points, return_closest_point=True)[1]
    assert np.allclose(on_surface, made.points, atol=1e-6)
    inside = clustering.create_mesh(moveclus=False)
    assert np.allclose(inside.points, clustering.cluster_centroid)
    assert not np.allclose(inside.points, made.points, atol=1e-4)


def test_flipnorm_turns_triangles_over() -> None:
    # The surface is turned inside out, with half of its triangles against the others.
    mesh = uneven(30)
    faces = triangles(mesh).copy()
    faces[::2] = faces[::2, ::-1]
    mixed = pyvista.PolyData(np.asarray(mesh.points), np.insert(faces, 0, 3, axis=1).ravel())
    clustering = Clustering(mixed)
    clustering.cluster(80)
    turned, kept = clustering.create_mesh(moveclus=False), clustering.create_mesh(moveclus=False, flipnorm=False)
    for made, expected in ((turned, True), (kept, False)):
        numbers = triangles(made)
        sums = clustering.cluster_norm[numbers].sum(axis=1)
        along = np.einsum("ij,ij->i", normals(np.asarray(made.points, dtype=float), numbers), sums)
        assert (along >= 0).all() == expected


def test_meshes_are_those_of_pyacvd_for_the_same_clusters() -> None:
    peer = pytest.importorskip("pyacvd")
    mesh = uneven(60)
    ours, theirs = Clustering(mesh), peer.Clustering(mesh)
    ours.cluster(300)
    theirs.clusters, theirs.nclus = ours.clusters, ours.nclus
    assert np.allclose(ours.area, theirs.area)
    assert np.allclose(ours.cluster_norm, theirs.cluster_norm, atol=1e-6)
    a, b = ours.create_mesh(moveclus=False, clean=False), theirs.create_mesh(moveclus=False, clean=False)
    assert np.allclose(a.points, b.points, atol=1e-6)
    assert {frozenset(face) for face in triangles(a)} == {frozenset(face) for face in triangles(b)}
    assert len(triangles(a)) == len(triangles(b))

    def oriented(mesh: Any) -> set[tuple[int, ...]]:
        return {tuple(np.roll(face, -int(np.argmin(face)))) for face in triangles(mesh)}

    assert oriented(a) == oriented(b)


def test_the_nearest_point_of_a_triangle_is_the_nearest_of_many() -> None:
    rng = np.random.default_rng(3)
    corners, points = rng.normal(size=(50, 3, 3)), rng.normal(size=(50, 3))
    corners[0] = corners[0, 0]  # without area: one point
    corners[1, 2] = corners[1, :2].mean(axis=0)  # and a line
    found = nearest_in_triangles(points, corners)
    steps = np.linspace(0, 1, 60)
    weights = np.array([(u, v, 1 - u - v) for u in steps for v in steps if u + v <= 1])
    for at in range(50):
        of_many = np.linalg.norm(weights @ corners[at] - points[at], axis=1).min()
        distance = np.linalg.norm(found[at] - points[at])
        assert distance <= of_many + 1e-12
        assert distance >= of_many - 0.2 * np.ptp(corners[at], axis=0).max()


def cow() -> Any:
    """A mesh like pyvista's cow: closed, of triangles and quads."""
    box = pyvista.Box(level=2, quads=True).clean()
    faces = box.faces.reshape(-1, 5)
    split = [[3, a, b, c, 3, a, c, d] if row % 2 else [4, a, b, c, d] for row, (_, a, b, c, d) in enumerate(faces)]
    return pyvista.PolyData(box.points, np.concatenate(split))


def test_the_examples_of_the_readme_run(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> None:
    """The two examples of pyacvd 0.4, with ``from tesserae_mesh import pyacvd`` for ``import pyacvd``."""
    from pyvista import examples

    monkeypatch.setattr(examples, "download_cow", cow)

    cow_ = examples.download_cow()
    cow_.plot(show_edges=True, color="w")
    clus = pyacvd.Clustering(cow_)
    # mesh is not dense enough for uniform remeshing
    clus.subdivide(3)
    clus.cluster(2000)
    clus.plot(screenshot=tmp_path / "clusters.png")
    assert (tmp_path / "clusters.png").stat().st_size > 1000
    remesh = clus.create_mesh()
    remesh.plot(color="w", show_edges=True)
    assert remesh.n_points == 2000
    assert remesh.is_manifold


@pytest.mark.skipif(not hasattr(pyvista, "register_dataset_accessor"), reason="pyvista is older than 0.48")
def test_the_example_of_the_accessor_runs() -> None:
    pyacvd.register_accessor()
    mesh = cow()
    assert isinstance(mesh.acvd, pyacvd.ACVDAccessor)
    before = mesh.copy()
    triangulated = mesh.triangulate()
    remesh = triangulated.acvd.remesh(1000, subdivide=3)
    assert remesh.n_points == 1000
    assert mesh.acvd.clustering(subdivide=1).mesh.n_cells == 4 * triangulated.n_cells
    assert mesh.acvd.subdivide(1).n_cells == 4 * triangulated.n_cells
    ids = mesh.acvd.cluster_ids(20, subdivide=1, fast=True)
    assert len(np.unique(ids)) == 20
    assert mesh == before, "the mesh was changed"


def test_what_needs_clusters_says_so() -> None:
    clustering = Clustering(uneven(12))
    with pytest.raises(RuntimeError, match=r"cluster\(\)"):
        clustering.create_mesh()
    with pytest.warns(UserWarning, match=r"cluster\(\)"):
        clustering.plot()
