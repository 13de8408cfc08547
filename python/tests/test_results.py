"""What a clustering gives: numbers, hierarchies, outputs, errors."""

from __future__ import annotations

import errno
import json
import pickle
import re
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any, Optional

import numpy as np
import pytest
from conftest import command, read_obj
from numpy.typing import NDArray

import tesserae_mesh
from tesserae_mesh import _native
from tesserae_mesh._errors import FileError
from tesserae_mesh.sklearn import GraphKMeans

Sample = Callable[[str, int], Path]
TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_numbers_add_up(sample: Sample) -> None:
    points, faces = read_obj(sample("terrain", 2000))
    clustering = tesserae_mesh.cluster(points, faces, 25, snapshots=[0, 2])
    labels = clustering.labels
    assert clustering.clusters == 25 and labels.shape == (len(faces),)
    assert clustering.sizes.sum() == len(faces) and clustering.sizes.min() > 0
    corners = points[np.array(faces)]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    middle = corners.mean(axis=1)
    centroids = np.array([np.average(middle[labels == k], axis=0, weights=area[labels == k]) for k in range(25)])
    assert np.allclose(clustering.centroids, centroids)
    energy = (area * ((middle - centroids[labels]) ** 2).sum(axis=1)).sum()
    assert np.isclose(clustering.energy, energy, rtol=1e-9)
    rows = clustering.iterations
    assert rows.dtype.names == ("iteration", "phase", "round", "energy", "moves", "elapsed_us")
    assert rows["iteration"][0] == 0 and (rows["round"] == -1).all() and np.isclose(rows["energy"][-1], energy)
    assert list(clustering.snapshots) == [0, 2]
    assert clustering.report["clusters"] == 25 and clustering.report["energy"]["final"] == clustering.energy
    assert clustering.hexagon_ratio == clustering.report["energy"]["hexagon_ratio"]


def test_hierarchies_are_cut_saved_and_loaded(sample: Sample, tmp_path: Path) -> None:
    points, faces = read_obj(sample("knot", 2000))
    whole = tesserae_mesh.cluster(points, faces, algorithm="pml")
    assert whole.hierarchy.roots == 1 and whole.hierarchy.faces == len(faces)
    with pytest.raises(tesserae_mesh.Error) as caught:
        whole.labels  # noqa: B018
    assert caught.value.kind == "conflict"
    whole.hierarchy.save(tmp_path / "knot.tsr")
    loaded = tesserae_mesh.Hierarchy.load(tmp_path / "knot.tsr")
    assert loaded.to_bytes() == tesserae_mesh.Hierarchy.load(whole.hierarchy.to_bytes()).to_bytes()
    cut = loaded.cut(37)
    assert cut.clusters == 37 == len(np.unique(cut.labels)) and np.array_equal(cut.labels, whole.cut(37).labels)
    done = command("cut", tmp_path / "knot.tsr", "-k", "37", "--labels", tmp_path / "cut.npy")
    assert done.returncode == 0 and np.array_equal(cut.labels, np.load(tmp_path / "cut.npy"))
    levels = loaded.levels
    assert levels["clusters"][-1] == 1 and (np.diff(levels["clusters"].astype(np.int64)) < 0).all()
    assert levels["merges"].sum() == len(faces) - 1
    exact = loaded.cut(int(levels["clusters"][0]))
    assert (exact.kind, exact.merges_on_top) == ("exact", 0) and np.isclose(exact.energy, levels["energy"][0])
    assert loaded.header["algorithm"] == "pml" and len(loaded.to_json(max_clusters=10)["nodes"]) == 10
    assert whole.cut(37).remesh("centroid").faces.shape[1] == 3
    for wrong in [0, len(faces) + 1, -1]:
        with pytest.raises(tesserae_mesh.Error) as caught:
            loaded.cut(wrong)
        assert caught.value.kind == "invalid-parameter"


def test_linkage_needs_a_nested_tree(sample: Sample) -> None:
    points, faces = read_obj(sample("knot", 500))
    linkage = tesserae_mesh.cluster(points, faces, algorithm="hr").hierarchy.linkage()
    assert linkage.shape == (len(faces) - 1, 4) and linkage[-1, 3] == len(faces)
    assert (np.diff(linkage[:, 2]) >= 0).all()
    with pytest.raises(tesserae_mesh.Error) as caught:
        tesserae_mesh.cluster(points, faces, algorithm="pml").hierarchy.linkage()
    assert caught.value.kind == "conflict"


def test_a_remesh_is_a_manifold_with_a_vertex_a_cluster(sample: Sample) -> None:
    points, faces = read_obj(sample("knot", 3000))
    remesh = tesserae_mesh.cluster(points, faces, 300).remesh()
    assert remesh.summary["checked"] and remesh.summary["triangles"] == len(remesh.faces)
    edges = np.sort(remesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert np.array_equal(remesh.clusters[:300], np.arange(300))
    source = remesh.source
    places = (source["barycentric"][:, :, None] * points[source["vertices"]]).sum(axis=1)
    assert np.linalg.norm(places - remesh.points, axis=1).max() < 0.1 * np.ptp(points)


def test_every_output_is_that_of_the_command_line(sample: Sample, tmp_path: Path) -> None:
    path = sample("knot", 800)
    points, faces = read_obj(path)
    clustering = tesserae_mesh.cluster(points, faces, algorithm="hr", clusters=20)
    flags = {"clusters": "--clusters-table", "graph": "--clusters-graph"}
    left_out = {"snapshots.npy", "snapshots.json", "report.json", "linkage.npy"}
    left_out |= {"labels.png", "means.png"}  # of images
    left_out |= {"shapes.json"}  # of energies of shapes
    for form, about in _native.forms():
        assert about
        if form in left_out:
            continue
        stem, extension = form.split(".", 1)
        out = tmp_path / f"out.{extension}"
        flag = flags.get(stem, f"--{stem}")
        done = command("cluster", path, "--algorithm", "hr", "-k", "20", flag, out)
        assert done.returncode == 0, done.stderr
        ours, theirs = clustering.output(form), out.read_bytes()
        if form == "hierarchy.tsr":  # its header names the format of the file
            assert len(ours) > 1000
        else:
            assert ours == theirs, form
    assert json.loads(clustering.output("report.json"))["clusters"] == 20
    for form, kind in [("mesh.xyz", "not-found"), ("linkage.npy", "conflict")]:
        with pytest.raises(tesserae_mesh.Error) as caught:
            clustering.output(form)
        assert caught.value.kind == kind


def test_shapes_are_those_of_the_command_line(sample: Sample, tmp_path: Path) -> None:
    path = sample("part", 1500)
    clustering = tesserae_mesh.cluster(path, clusters=13, energy="shapes")
    out = tmp_path / "shapes.json"
    done = command("cluster", path, "-k", "13", "--energy", "shapes", "--shapes-out", out)
    assert done.returncode == 0, done.stderr
    assert json.loads(clustering.output("shapes.json")) == json.loads(out.read_bytes()) == clustering.report["shapes"]
    with pytest.raises(tesserae_mesh.Error, match="shapes: take the energy planes or shapes"):
        tesserae_mesh.cluster(path, clusters=3).output("shapes.json")


def test_every_parameter_of_the_command_line_is_a_documented_keyword() -> None:
    keywords = signature(tesserae_mesh.cluster).parameters
    help_of_command = command("cluster", "--help").stdout
    flags = {flag.replace("-", "_") for flag in re.findall(r"--([a-z][a-z-]+)", help_of_command)}
    outputs = {form.split(".")[0].replace("-", "_") for form, _ in _native.forms()}
    of_outputs = {"clusters_graph", "clusters_table", "placement", "ply_vertex_colours", "shapes_out", "force"}
    of_outputs |= {"min_clusters", "max_clusters"}
    # a mesh in memory is divided by what made it
    of_files = {"subdivide"}
    of_the_command = {"help", "version", "output", "quiet"}
    of_points = {"graph", "compactness"}
    missing = flags - outputs - of_outputs - of_files - of_points - of_the_command - set(keywords)
    assert not missing
    assert set(_native.parameters()) - of_files - of_points <= set(keywords)
    assert keywords["clusters"].default == 1000
    described = tesserae_mesh.cluster.__doc__ or ""
    for name in keywords:
        assert re.search(rf"^    {name} : ", described, flags=re.MULTILINE), name


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"points": TRIANGLE[:, :2]}, "invalid-mesh"),
    ({"points": TRIANGLE.astype(complex)}, "invalid-mesh"),
    ({"points": [[0, 0, 0], [1]]}, "invalid-mesh"),
    ({"points": np.full((3, 3), np.nan)}, "invalid-mesh"),
    ({"points": object()}, "invalid-mesh"),
    ({"faces": [[0, 1, 3]]}, "invalid-mesh"),
    ({"faces": [[0, 1, -1]]}, "invalid-mesh"),
    ({"faces": [[0, 1, 1 << 40]]}, "invalid-mesh"),
    ({"faces": [[0.0, 1.0, 2.0]]}, "invalid-mesh"),
    ({"faces": np.zeros((0, 3), dtype=int)}, "invalid-mesh"),
    ({"faces": np.array([3, 0, 1])}, "invalid-mesh"),
    ({"faces": np.array([3, 0, 1, 2, 0])}, "invalid-mesh"),
    ({"faces": (np.array([0, 3, 2]), np.array([0, 1, 2]))}, "invalid-mesh"),
    ({"clusters": 2}, "invalid-parameter"),
    ({"clusters": 0}, "invalid-parameter"),
    ({"clusters": -1}, "invalid-parameter"),
    ({"clusters": "many"}, "invalid-parameter"),
    ({"clusters": 1.5}, "invalid-parameter"),
    ({"algorithm": "kmeans"}, "invalid-parameter"),
    ({"seeds": [0.5]}, "invalid-parameter"),
    ({"seeds": [7]}, "invalid-parameter"),
    ({"weights": [-1.0]}, "invalid-parameter"),
    ({"weights": ["a"]}, "invalid-parameter"),
    ({"curvature_exponent": float("nan")}, "invalid-parameter"),
    ({"weight_attribute": "_W"}, "invalid-parameter"),
    ({"features": "sharp"}, "invalid-parameter"),
    ({"features": "30,groups"}, "invalid-parameter"),
    ({"features": 30, "bridge_components": True}, "invalid-parameter"),
    ({"device": "tpu"}, "invalid-parameter"),
    ({"max_faces": -1}, "invalid-parameter"),
    ({"max_faces": 0}, "too-large"),
    ({"format": "obj"}, "invalid-parameter"),
    ({"points": "no-such-file.obj", "faces": None}, "io"),
]


@pytest.mark.parametrize(("wrong", "kind"), REFUSED)
def test_what_is_refused_says_so_with_its_kind(wrong: dict[str, Any], kind: str) -> None:
    given: dict[str, Any] = {"points": TRIANGLE, "faces": [[0, 1, 2]], "clusters": 1, **wrong}
    with pytest.raises(tesserae_mesh.Error) as caught:
        tesserae_mesh.cluster(**given)
    assert caught.value.kind == kind, caught.value
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, OSError) == (kind == "io")
    assert "\n" not in str(caught.value) and "(from 0)" not in str(caught.value)


def test_what_is_unusual_is_a_warning_at_the_call() -> None:
    points = np.vstack([TRIANGLE, TRIANGLE])
    with pytest.warns(tesserae_mesh.ClusteringWarning, match="degenerate faces") as caught:
        clustering = tesserae_mesh.cluster(points, [[0, 1, 2], [3, 3, 4]], 1)
    assert {str(warning.message) for warning in caught} == set(clustering.report["warnings"])
    assert {warning.filename for warning in caught} == {__file__}
    table = np.arange(50.0)[:, None]
    table[3] = 1e13
    with pytest.warns(tesserae_mesh.ClusteringWarning, match="cut off outliers"):
        tesserae_mesh.cluster_points(table, 2, graph=20)
    with pytest.warns(tesserae_mesh.ClusteringWarning) as caught:
        GraphKMeans(2, n_neighbors=20).fit(table)
    assert {warning.filename for warning in caught} == {__file__}


def test_errors_survive_pickling() -> None:
    error = pickle.loads(pickle.dumps(tesserae_mesh.Error("conflict", "there is no x")))
    assert (error.kind, str(error)) == ("conflict", "there is no x")
    error = pickle.loads(pickle.dumps(FileError("cannot read x", errno.EACCES, "x")))
    assert (error.kind, str(error)) == ("io", "cannot read x")
    assert (error.errno, error.strerror, error.filename) == (errno.EACCES, "Permission denied", "x")


@pytest.mark.parametrize("mask", [None, np.arange(120).reshape(10, 12) % 7 > 0])
def test_hierarchies_of_points_survive_files_and_pickling(mask: Optional[NDArray[np.bool_]]) -> None:
    pixels = np.random.default_rng(1).random((10, 12, 3))
    run = tesserae_mesh.cluster_points(pixels, graph="grid", mask=mask, algorithm="pml", bridge_components=True)
    hierarchy = run.hierarchy
    for copy in (pickle.loads(pickle.dumps(hierarchy)), tesserae_mesh.Hierarchy.load(hierarchy.to_bytes())):
        assert (copy.header, repr(copy)) == (hierarchy.header, repr(hierarchy))
        np.testing.assert_array_equal(copy.levels, hierarchy.levels)
        np.testing.assert_array_equal(copy.cut(9).labels, hierarchy.cut(9).labels)


def test_errors_of_files_have_the_number_and_the_name_of_the_system(tmp_path: Path, sample: Sample) -> None:
    hierarchy = tesserae_mesh.cluster(sample("knot", 500), algorithm="hr").hierarchy
    missing, folder = tmp_path / "missing.obj", tmp_path / "folder.obj"
    folder.mkdir()
    attempts: list[tuple[Callable[[], object], Path, int]] = [
        (lambda: tesserae_mesh.cluster(missing, 3), missing, errno.ENOENT),
        (lambda: tesserae_mesh.cluster(folder, 3), folder, errno.EISDIR),
        (lambda: tesserae_mesh.Hierarchy.load(missing), missing, errno.ENOENT),
        (lambda: hierarchy.save(folder), folder, errno.EISDIR),
        (lambda: hierarchy.save(missing / "x"), missing / "x", errno.ENOENT),
    ]
    for attempt, path, number in attempts:
        with pytest.raises(OSError) as caught:
            attempt()
        error = caught.value
        assert isinstance(error, tesserae_mesh.Error) and error.kind == "io"
        assert (error.errno, error.filename) == (number, str(path))
        assert str(error).startswith("cannot ") and str(path) in str(error)


def test_a_number_after_a_mesh_is_that_of_clusters(sample: Sample) -> None:
    path = sample("knot", 2000)
    mesh = tesserae_mesh.Mesh(*read_obj(path))
    expected = tesserae_mesh.cluster(mesh, clusters=30)
    assert expected.clusters == 30
    for given in (mesh, path, str(path)):
        for number in (30, np.int64(30), np.uint8(30)):
            assert np.array_equal(tesserae_mesh.cluster(given, number).labels, expected.labels)
    with pytest.raises(tesserae_mesh.Error, match="given twice: 30 and 40"):
        tesserae_mesh.cluster(mesh, 30, 40)
    with pytest.raises(tesserae_mesh.Error, match="a mesh is points and faces, .*, not ndarray"):
        tesserae_mesh.cluster(mesh.points, 30)
    with pytest.raises(tesserae_mesh.Error, match="must not be more than there are faces"):
        tesserae_mesh.cluster(mesh, 3000)


def test_every_result_is_one_short_line(sample: Sample) -> None:
    whole = tesserae_mesh.cluster(sample("knot", 2000), algorithm="pml")
    cut = whole.cut(25)
    lines = [whole, whole.hierarchy, whole.hierarchy.cut(25), cut, cut.remesh(), cut.mesh]
    for line in map(repr, lines):
        assert len(line) < 100 and "\n" not in line and "array" not in line
    assert re.fullmatch(r"Clustering\(2002 faces, 25 clusters, energy [0-9.e+-]+\)", repr(cut))
    assert re.fullmatch(r"Cut\(2002 labels, 25 clusters, (exact|merged), energy [0-9.e+-]+\)", repr(lines[2]))
    assert re.fullmatch(r"Remesh\([0-9]+ points, [0-9]+ triangles, 25 clusters\)", repr(cut.remesh()))


def test_the_module_lists_its_names_only() -> None:
    names = [name for name in dir(tesserae_mesh) if not name.startswith("__")]
    assert names == sorted(name for name in tesserae_mesh.__all__ if not name.startswith("__"))
