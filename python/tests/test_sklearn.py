"""The estimator: scikit-learn's own checks, weights, graphs, pipelines."""

from __future__ import annotations

import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest
import scipy.sparse
from sklearn.base import clone
from sklearn.cluster import AgglomerativeClustering
from sklearn.datasets import make_blobs
from sklearn.feature_extraction.image import grid_to_graph
from sklearn.neighbors import kneighbors_graph
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import check_estimator

import tesserae_mesh
from tesserae_mesh.sklearn import GraphKMeans

X = np.random.default_rng(0).random((300, 4))

NOT_MET = {
    "check_sample_weight_equivalence_on_dense_data": "a sample that is there twice has other nearest neighbours",
}


@pytest.mark.parametrize("algorithm", ["bb", "hr"])
def test_the_checks_of_scikit_learn_pass(algorithm: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = check_estimator(GraphKMeans(3, algorithm=algorithm), expected_failed_checks=NOT_MET, on_fail=None)
    failed = {check["check_name"]: check["exception"] for check in done if check["status"] == "failed"}
    assert not failed and sum(check["status"] == "passed" for check in done) > 40


def test_it_is_cluster_points() -> None:
    model = GraphKMeans(12).fit(X)
    clustering = tesserae_mesh.cluster_points(X, 12)
    assert np.array_equal(model.labels_, clustering.labels) and model.inertia_ == clustering.energy
    means = [X[model.labels_ == k].mean(axis=0) for k in range(12)]
    assert np.allclose(model.cluster_centers_, means) and model.cluster_centers_.dtype == np.float64
    assert (model.n_features_in_, model.n_connected_components_) == (4, 1)
    distances = ((X[:, None] - np.array(means)) ** 2).sum(axis=2)
    assert np.array_equal(model.predict(X), distances.argmin(axis=1))
    of_five = tesserae_mesh.cluster_points(X, 12, graph=5).labels
    assert np.array_equal(GraphKMeans(12, n_neighbors=5).fit(X).labels_, of_five)
    assert not hasattr(model, "children_")
    single = GraphKMeans(12).fit(X.astype(np.float32))
    assert single.cluster_centers_.dtype == np.float32


def test_a_connectivity_is_a_matrix_an_array_or_a_function() -> None:
    graph = kneighbors_graph(X, 6)
    expected = tesserae_mesh.cluster_points(X, 9, graph=graph).labels
    matrices = [graph, graph.tocoo(), scipy.sparse.csr_array(graph), graph.toarray()]
    for connectivity in [*matrices, lambda x: kneighbors_graph(x, 6)]:
        assert np.array_equal(GraphKMeans(9, connectivity=connectivity).fit_predict(X), expected)
    image = X.reshape(-1)[:600].reshape(20, 30, 1)
    of_grid = GraphKMeans(9, connectivity=grid_to_graph(20, 30)).fit_predict(image.reshape(-1, 1))
    assert len(np.unique(of_grid)) == 9


def test_weights_count_and_samples_without_weight_take_no_part() -> None:
    weights = np.linspace(1, 5, 300)
    weighted = GraphKMeans(7).fit(X, sample_weight=weights)
    assert np.array_equal(weighted.labels_, tesserae_mesh.cluster_points(X, 7, weights=weights).labels)
    assert not np.array_equal(weighted.labels_, GraphKMeans(7).fit(X).labels_)
    weights[::7] = 0
    left = weights > 0
    for algorithm in ["bb", "hr"]:
        part = GraphKMeans(7, algorithm=algorithm).fit(X, sample_weight=weights)
        alone = GraphKMeans(7, algorithm=algorithm).fit(X[left], sample_weight=weights[left])
        assert np.array_equal(part.labels_[left], alone.labels_)
        assert np.array_equal(part.labels_[~left], alone.predict(X[~left]))
        assert np.allclose(part.cluster_centers_, alone.cluster_centers_)


def test_components_are_joined_with_a_warning() -> None:
    x, _ = make_blobs([40, 50, 60], random_state=0, cluster_std=0.1)
    for algorithm in ["bb", "hr"]:
        with pytest.warns(UserWarning, match="3 connected components"):
            model = GraphKMeans(2, algorithm=algorithm).fit(x)
        assert model.n_connected_components_ == 3 and len(np.unique(model.labels_)) == 2
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            GraphKMeans(2, algorithm=algorithm).fit(X)
    with pytest.warns(UserWarning):
        theirs = AgglomerativeClustering(2, connectivity=kneighbors_graph(x, 8)).fit(x)
    assert theirs.n_connected_components_ == 3


def test_it_works_in_a_pipeline_and_is_cloned() -> None:
    scaled = StandardScaler().fit_transform(X)
    pipeline = make_pipeline(StandardScaler(), GraphKMeans(6, quality="fast"))
    assert np.array_equal(pipeline.fit_predict(X), GraphKMeans(6, quality="fast").fit_predict(scaled))
    pipeline.set_params(graphkmeans__n_clusters=4, graphkmeans__algorithm="pml", graphkmeans__quality="default")
    assert set(clone(pipeline).fit(X).predict(X)) <= set(range(4))


def test_what_is_refused_is_an_error_of_values() -> None:
    refused: list[tuple[dict[str, Any], str]] = [
        ({"n_clusters": 301}, "n_samples=300 should be >= n_clusters=301"),
        ({"n_clusters": 0}, "at least 1"),
        ({"n_neighbors": 0}, "nearest neighbours must be from 1 to 64"),
        ({"algorithm": "kmeans"}, "algorithm"),
        ({"connectivity": kneighbors_graph(X[:9], 3)}, "row for each of 300 items"),
    ]
    for wrong, words in refused:
        with pytest.raises(ValueError, match=words):
            GraphKMeans(**wrong).fit(X)
    with pytest.raises(ValueError, match="from 1 to 64 columns: 65"):
        GraphKMeans().fit(np.random.default_rng(0).random((99, 65)))


def test_without_scikit_learn_an_import_says_what_to_install() -> None:
    code = """import sys
sys.modules["sklearn"] = None
try:
    import tesserae_mesh.sklearn
except ImportError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "tesserae_mesh.sklearn needs scikit-learn 1.6 or later: pip install 'scikit-learn>=1.6'\n"
