"""Points with neighbours: labels, masks, graphs, trees, errors."""

from __future__ import annotations

import doctest
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse
from items import assert_connected, by_command, energy, grid_edges, sha256
from numpy.typing import NDArray
from sklearn.cluster import AgglomerativeClustering
from sklearn.neighbors import kneighbors_graph

import tesserae_mesh
import tesserae_mesh._points
from tesserae_mesh import cluster_points, superpixels


def points(n: int, d: int, seed: int = 0) -> NDArray[np.float64]:
    """Random points without ties, in one component by their 8 nearest."""
    return np.random.default_rng(seed).random((n, d))


def test_every_graph_gives_the_labels_of_the_command_line(tmp_path: Path) -> None:
    x = points(600, 5).astype(np.float32)
    edges = kneighbors_graph(x, 6)
    image = points(24 * 25, 3, 1).reshape(24, 25, 3)
    np.save(tmp_path / "x.npy", x)
    np.save(tmp_path / "image.npy", image)
    np.save(tmp_path / "volume.npy", image.reshape(6, 10, 10, 3))
    np.save(tmp_path / "weights.npy", np.linspace(1, 5, 600))
    scipy.sparse.save_npz(tmp_path / "edges.npz", edges)
    given: list[tuple[str, list[str], Any, dict[str, Any]]] = [
        ("x", [], x, {}),
        ("x", ["--graph", "knn:5"], x, {"graph": 5}),
        ("x", ["--graph", "knn:5", "--algorithm", "pml"], x, {"graph": "knn:5", "algorithm": "pml"}),
        ("x", ["--graph", os.fspath(tmp_path / "edges.npz")], x, {"graph": edges}),
        ("x", ["--weights", os.fspath(tmp_path / "weights.npy")], x, {"weights": np.linspace(1, 5, 600)}),
        ("image", ["--graph", "grid"], image, {"graph": "grid"}),
        ("volume", ["--graph", "grid:full"], image.reshape(6, 10, 10, 3), {"graph": "grid:full"}),
    ]
    for name, options, array, keywords in given:
        report = by_command(tmp_path / f"{name}.npy", "-k", "20", *options)
        clustering = cluster_points(array, 20, **keywords)
        assert clustering.labels.dtype == np.int32 and clustering.labels.shape == array.shape[:-1]
        assert clustering.report["labels_sha256"] == report["labels_sha256"] == sha256(clustering.labels), keywords
        assert clustering.energy == report["energy"]["final"]
        assert clustering.report["input"]["format"] is None


def test_clusters_are_connected_and_exactly_as_many(tmp_path: Path) -> None:
    x = points(700, 4)
    nearest = kneighbors_graph(x, 8)
    image = points(30 * 20, 2, 3).reshape(30, 20, 2)
    volume = points(8 * 9 * 10, 2, 4).reshape(8, 9, 10, 2)
    for k in [1, 2, 23, 250, 600]:
        for algorithm in ["bb", "pml", "ml"]:
            assert_connected(cluster_points(x, k, algorithm=algorithm).labels, nearest, k)
            of_image = cluster_points(image, k, graph="grid", algorithm=algorithm)
            assert_connected(of_image.labels, grid_edges((30, 20)), k)
        assert_connected(cluster_points(volume, k, graph="grid").labels, grid_edges((8, 9, 10)), k)
    # the check itself can fail
    with pytest.raises(AssertionError):
        assert_connected(np.random.default_rng(0).integers(0, 23, 700), nearest, 23)


def test_results_add_up() -> None:
    x = points(500, 3) + 1e6
    weights = np.linspace(0.5, 4, 500)
    clustering = cluster_points(x, 12, weights=weights, snapshots=[0, 2])
    labels = clustering.labels
    assert clustering.clusters == 12 and clustering.sizes.sum() == 500 and clustering.sizes.min() > 0
    assert np.isclose(clustering.energy, energy(x, labels, weights), rtol=1e-6)
    means = [np.average(x[labels == k], axis=0, weights=weights[labels == k]) for k in range(12)]
    assert np.allclose(clustering.centroids, means, rtol=1e-13)
    assert [row["items"] for row in clustering.table] == list(clustering.sizes)
    assert np.isclose(sum(row["energy"] for row in clustering.table), clustering.energy)
    pairs = json.loads(clustering.output("graph.json"))["edges"]
    assert sum(row["neighbours"] for row in clustering.table) == 2 * len(pairs) > 0
    assert clustering.hexagon_ratio is None and clustering.report["input"]["dimensions"] == 3
    assert clustering.iterations["energy"][-1] <= clustering.iterations["energy"][0]
    assert {at: one.shape for at, one in clustering.snapshots.items()} == {0: (500,), 2: (500,)}
    assert repr(clustering).startswith("Clustering(500 items, 12 clusters, energy ")
    assert np.array_equal(np.load(io.BytesIO(clustering.output("labels.npy"))), labels)
    listed = cluster_points(x, seeds=[3, 77, 400])
    assert listed.clusters == 3 and list(listed.labels[[3, 77, 400]]) == [0, 1, 2]


def test_types_and_layouts_make_no_difference() -> None:
    whole = np.random.default_rng(5).integers(0, 200, (300, 3))
    expected = cluster_points(whole.astype("f8"), 15).labels
    kinds = ["u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8"]
    for kind in [*kinds, *(f">{kind}" for kind in kinds)]:
        assert np.array_equal(cluster_points(whole.astype(kind), 15).labels, expected), kind
    x = whole.astype("f8")
    packed = np.zeros(300, dtype=[("skip", "u1"), ("x", "f8", 3)])
    packed["x"] = x
    frozen = x.copy()
    frozen.flags.writeable = False
    layouts: list[Any] = [
        np.asfortranarray(x),
        np.repeat(x, 2, axis=0)[::2],
        np.repeat(x, 2, axis=1)[:, ::2],
        x[::-1][::-1],
        packed["x"],
        frozen,
        x.tolist(),
    ]
    for given in layouts:
        assert np.array_equal(cluster_points(given, 15).labels, expected)
    image = points(20 * 30, 3, 6).reshape(20, 30, 3)
    expected = cluster_points(image, 15, graph="grid").labels
    assert np.array_equal(cluster_points(np.asfortranarray(image), 15, graph="grid").labels, expected)
    assert np.array_equal(cluster_points(image[:, ::-1], 15, graph="grid").sizes.sum(), 600)
    turned = np.ascontiguousarray(image.transpose(1, 0, 2)).transpose(1, 0, 2)
    assert np.array_equal(cluster_points(turned, 15, graph="grid").labels, expected)


def test_every_form_of_the_same_edges_has_the_same_labels() -> None:
    x = points(400, 2)
    edges = kneighbors_graph(x, 7)
    both = edges + edges.T
    expected = cluster_points(x, 20, graph=7)
    with_zeros = both.copy()
    extra = scipy.sparse.csr_matrix(([1.0], ([0], [399])), shape=(400, 400))
    with_zeros = with_zeros + extra
    with_zeros[0, 399] = 0
    assert with_zeros.nnz > both.nnz
    narrow = (edges.indptr.astype(np.int32), edges.indices.astype(np.int32))
    forms: list[Any] = [
        edges,
        edges.tocsc(),
        edges.tocoo(),
        edges.tolil(),
        scipy.sparse.csr_array(edges),
        edges.T,
        scipy.sparse.triu(both),
        both - scipy.sparse.diags(np.full(400, 3.0)),
        with_zeros,
        narrow,
        (edges.indptr.astype(np.int64), edges.indices.astype(np.int64)),
        (edges.indptr.tolist(), edges.indices.astype(np.uint16)),
    ]
    entries = with_zeros.nnz
    for graph in forms:
        clustering = cluster_points(x, 20, graph=graph)
        assert np.array_equal(clustering.labels, expected.labels)
        assert clustering.report["input"]["edges"] == expected.report["input"]["edges"]
    assert with_zeros.nnz == entries


def test_masked_items_have_no_cluster() -> None:
    image = points(30 * 40, 2, 7).reshape(30, 40, 2)
    mask = np.ones((30, 40), dtype=bool)
    mask[:, 20] = mask[5:9, 3:8] = False
    image[~mask] = np.nan
    edges = grid_edges((30, 40))
    with pytest.raises(tesserae_mesh.Error, match="components"):
        cluster_points(image, 1, graph="grid", mask=mask)
    masks: list[Any] = [mask, mask.astype("u1"), mask.tolist()]
    for given in masks:
        clustering = cluster_points(image, 17, graph="grid", mask=given, snapshots=[0])
        assert np.array_equal(clustering.labels < 0, ~mask) and clustering.labels.min() == -1
        assert_connected(clustering.labels, edges, 17)
        assert np.array_equal(clustering.snapshots[0] < 0, ~mask)
        written = np.load(io.BytesIO(clustering.output("snapshots.npy")))
        assert np.array_equal(written[0].view(np.int32).reshape(30, 40), clustering.snapshots[0])
        assert clustering.sizes.sum() == mask.sum() and not np.isnan(clustering.centroids).any()
        assert np.isclose(clustering.energy, energy(image[mask], clustering.labels[mask]))
    whole = cluster_points(image, graph="grid", mask=mask, algorithm="pml", bridge_components=True)
    cut, from_hierarchy = whole.cut(17), whole.hierarchy.cut(17)
    assert np.array_equal(cut.labels < 0, ~mask) and cut.sizes.sum() == mask.sum() and cut.sizes.size == 17
    assert np.array_equal(cut.labels, from_hierarchy.labels) and repr(from_hierarchy).startswith("Cut(1200 labels, 17 ")
    assert np.load(io.BytesIO(cut.output("labels.npy"))).shape == (30, 40)
    means = [image[cut.labels == k].mean(axis=0) for k in range(17)]
    assert np.allclose(cut.centroids, means) and [row["items"] for row in cut.table] == list(cut.sizes)
    assert repr(whole.hierarchy) == f"Hierarchy({mask.sum()} items, 1 roots)"


def test_what_is_made_of_a_mesh_says_that_there_is_none() -> None:
    clustering = cluster_points(points(100, 3), 5)
    attempts: list[Callable[[], object]] = [
        lambda: clustering.mesh,
        clustering.remesh,
        clustering.plot,
        lambda: clustering.output("mesh.ply"),
    ]
    for attempt in attempts:
        with pytest.raises(tesserae_mesh.Error) as caught:
            attempt()
        assert caught.value.kind == "conflict" and "mesh" in str(caught.value)
    with pytest.raises(tesserae_mesh.Error, match="flat clustering"):
        clustering.cut(3)
    assert clustering._repr_html_() == f"<pre>{clustering!r}</pre>"


def test_trees_are_those_of_scikit_learn() -> None:
    from tesserae_mesh.sklearn import GraphKMeans

    for n, d, seed in [(60, 2, 0), (80, 7, 1), (120, 20, 2)]:
        x = points(n, d, seed)
        graph = kneighbors_graph(x, 8)
        theirs = AgglomerativeClustering(5, connectivity=graph, linkage="ward", compute_distances=True).fit(x)
        assert theirs.n_connected_components_ == 1
        ours = GraphKMeans(5, connectivity=graph, algorithm="hr").fit(x)
        assert np.array_equal(ours.children_, theirs.children_)
        assert np.allclose(ours.distances_, theirs.distances_, rtol=1e-5)
        assert np.array_equal(np.unique(ours.labels_ * 5 + theirs.labels_).shape, (5,))
        assert np.isclose(ours.inertia_, energy(x, ours.labels_), rtol=1e-5)
        linkage = cluster_points(x, graph=graph, algorithm="hr").hierarchy.linkage()
        assert linkage.shape == (n - 1, 4) and np.allclose(linkage[-1, 2], theirs.distances_.max(), rtol=1e-5)
    assert not hasattr(ours.set_params(algorithm="bb").fit(x), "children_")


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"X": [[0.0], [1.0, 2.0]]}, "X is no array"),
    ({"X": np.zeros(4)}, "items x columns"),
    ({"X": np.zeros((2, 2, 3))}, "items x columns"),
    ({"X": np.zeros((4, 65))}, "from 1 to 64 columns: 65"),
    ({"X": np.zeros((4, 0))}, "from 1 to 64 columns: 0"),
    ({"X": np.zeros((0, 4))}, "there are no items"),
    ({"X": np.zeros((4, 2), dtype=complex)}, "complex128"),
    ({"X": np.array([["a", "b"]])}, "<U1"),
    ({"X": np.array([[None]])}, "object"),
    ({"X": [[0.0, 1], [np.nan, 2]]}, "item 1, column 0 is NaN"),
    ({"X": [[0.0, 1], [np.inf, 2]]}, "item 1, column 0 is inf"),
    ({"k": 0}, "clusters must be at least 1"),
    ({"k": 9}, "clusters must not be more"),
    ({"k": -1}, "k must be from 0"),
    ({"k": 1.5}, "k must be an integer"),
    ({"k": None}, "clusters is missing"),
    ({"clusters": 2}, "given twice"),
    ({"graph": "mesh"}, "graph must be .* not 'mesh'"),
    ({"graph": "knn:-1"}, "graph must be .* not 'knn:-1'"),
    ({"graph": "knn:99999999999"}, "graph"),
    ({"graph": 0}, "from 1 to 64"),
    ({"graph": 65}, "from 1 to 64"),
    ({"graph": True}, "not bool"),
    ({"graph": np.ones((4, 4))}, "not ndarray"),
    ({"graph": (1, 2, 3)}, "two arrays, .* not 3"),
    ({"graph": (1, 2)}, "whole numbers in one dimension"),
    ({"graph": scipy.sparse.eye(5)}, "row for each of 4 items"),
    ({"graph": scipy.sparse.csr_matrix((4, 5))}, "n x n"),
    ({"graph": (np.array([0, 1, 1, 1, 1]), np.array([4]))}, "indices must be from 0 to 3"),
    ({"graph": (np.array([0, 1, 0, 1, 1]), np.array([1]))}, "indptr must begin with 0"),
    ({"graph": (np.array([0, 1, 1, 1, 1]), np.array([1.0]))}, "indices must be whole numbers"),
    ({"graph": (np.array([], dtype=int), np.array([1]))}, "indptr must have one entry more"),
    ({"graph": "grid"}, "a grid has 2 or 3 dimensions"),
    ({"graph": (np.zeros(5, dtype=int), np.array([], dtype=int))}, "components"),
    ({"mask": [True] * 3}, r"mask must have the shape of the items, \(4,\), not \(3,\)"),
    ({"mask": [False] * 4}, "the mask leaves no item"),
    ({"mask": [1.0] * 4}, "True and False"),
    ({"weights": [1, 1, 1]}, "weights must have the shape"),
    ({"weights": [1, 1, 0, 1]}, "that of item 2 is 0"),
    ({"weights": [1, 1, np.nan, 1]}, "that of item 2 is NaN"),
    ({"weights": ["a"] * 4}, "weights must be real numbers"),
    ({"seeds": [0, 9], "k": None}, "no item, of which there are 4: 9"),
    ({"algorithm": "kmeans"}, "algorithm"),
    ({"curvature_exponent": 1.0}, "goes with meshes"),
    ({"device": "tpu"}, "device"),
]


@pytest.mark.parametrize(("wrong", "words"), REFUSED)
def test_what_is_refused_says_so_in_a_line(wrong: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"X": np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]]), "k": 2, **wrong}
    with pytest.raises(tesserae_mesh.Error, match=words) as caught:
        cluster_points(given.pop("X"), given.pop("k"), **given)
    assert caught.value.kind == "invalid-parameter" and "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_a_parameter_that_is_not_there_is_an_error_of_types() -> None:
    attempts: list[tuple[Callable[[], object], str]] = [
        (lambda: cluster_points(np.eye(4), 2, cluster=3), "cluster"),
        (lambda: cluster_points(np.eye(4), 2, compactness=3), "compactness"),
        (lambda: superpixels(np.zeros((4, 5), dtype=np.uint8), 2, graph="grid"), "graph"),
    ]
    for attempt, name in attempts:
        with pytest.raises(TypeError, match=f"no parameter of that name: {name}"):
            attempt()


def test_the_documentation_of_points_is_right() -> None:
    assert doctest.testmod(tesserae_mesh._points).failed == 0
