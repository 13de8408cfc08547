"""An estimator of scikit-learn's that clusters over a graph: `GraphKMeans`. Needs scikit-learn 1.6 or later."""
# pyright: basic, reportArgumentType=false

from __future__ import annotations

import warnings
from typing import Any, Callable, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tesserae_mesh._points import cluster_points

try:
    from scipy.sparse import csr_matrix, issparse
    from sklearn.base import BaseEstimator, ClusterMixin
    from sklearn.metrics import pairwise_distances_argmin
    from sklearn.utils.validation import (
        _check_sample_weight,
        check_array,
        check_is_fitted,
        validate_data,
    )
except ImportError as error:
    raise ModuleNotFoundError(
        "tesserae_mesh.sklearn needs scikit-learn 1.6 or later: pip install 'scikit-learn>=1.6'", name="sklearn"
    ) from error

__all__ = ["GraphKMeans"]


class GraphKMeans(ClusterMixin, BaseEstimator):  # type: ignore[misc]
    """k-means whose clusters are connected in a graph: `tesserae_mesh.cluster_points` as an estimator.

    Labels are the same on every machine and for any number of threads; nothing is drawn at random.

    Parameters
    ----------
    n_clusters : int
        Number of clusters; there are exactly as many.
    connectivity : sparse matrix, array, or callable, optional
        Which samples are neighbours, as in `sklearn.cluster.AgglomerativeClustering`: shape (n_samples, n_samples),
        or a function that makes such a matrix of X. The `n_neighbors` nearest when left out.
    n_neighbors : int
        Number of nearest neighbours, from 1 to 64.
    algorithm : {"bb", "pml", "ml", "hr"}
        As in `tesserae_mesh.cluster`. ``"hr"`` merges the cheapest pair of neighbours a step (Ward's linkage) and
        makes a tree.
    quality : {"fast", "default", "best"}
        How much time to take for how low an inertia; bb and pml.

    Attributes
    ----------
    labels_ : ndarray of int32, shape (n_samples,)
        Cluster of each sample. One of weight 0 takes no part; it has the label that `predict` gives.
    cluster_centers_ : ndarray of shape (n_clusters, n_features)
        Weighted mean of each cluster.
    inertia_ : float
        Sum of weight x squared distance to the mean of the cluster, over the samples.
    n_connected_components_ : int
        Connected components of the graph. Where there are more than one, they are joined where they are nearest, with a
        warning.
    children_, distances_ : ndarray of shape (n_samples - 1, 2) and (n_samples - 1,)
        Of ``algorithm="hr"``: the tree, as in `sklearn.cluster.AgglomerativeClustering`. The distance of two clusters
        is sqrt(2 x rise of the inertia). Samples of weight 0 are no leaves.
    n_features_in_ : int
        Number of columns of X.
    """

    def __init__(
        self,
        n_clusters: int = 8,
        *,
        connectivity: Union[ArrayLike, Callable[[Any], Any], Any, None] = None,
        n_neighbors: int = 8,
        algorithm: str = "bb",
        quality: str = "default",
    ) -> None:
        self.n_clusters = n_clusters
        self.connectivity = connectivity
        self.n_neighbors = n_neighbors
        self.algorithm = algorithm
        self.quality = quality

    def fit(self, X: Any, y: Any = None, sample_weight: Optional[ArrayLike] = None) -> GraphKMeans:
        """Cluster the rows of X; `y` is ignored.

        Raises
        ------
        tesserae_mesh.Error
            A parameter is impossible, or X has more than 64 columns.
        """
        X = validate_data(self, X, dtype=(np.float64, np.float32))
        if len(X) < self.n_clusters:
            raise ValueError(f"n_samples={len(X)} should be >= n_clusters={self.n_clusters}")
        weights = mask = None
        if sample_weight is not None:
            weights = _check_sample_weight(sample_weight, X, dtype=np.float64, ensure_non_negative=True)
            mask = None if weights.all() else weights > 0
        for of_tree in ("children_", "distances_"):
            self.__dict__.pop(of_tree, None)
        is_tree = self.algorithm == "hr"
        clustering = cluster_points(
            X,
            None if is_tree else self.n_clusters,
            graph=self._graph(X),
            weights=weights,
            mask=mask,
            algorithm=self.algorithm,
            quality=self.quality,
            bridge_components=True,
        )
        self.n_connected_components_: int = clustering.report["input"]["components"]
        if self.n_connected_components_ > 1:
            warnings.warn(
                f"the graph has {self.n_connected_components_} connected components, which were joined where they are "
                "nearest",
                stacklevel=2,
            )
        if is_tree:
            nodes = clustering.hierarchy.to_json()["nodes"]
            children = np.array([node["children"] for node in nodes], dtype=np.int64)
            self.children_ = np.sort(children.reshape(-1, 2), axis=1)
            self.distances_ = np.sqrt(2 * np.array([node["cost"] for node in nodes], dtype=np.float64))
            clustering = clustering.cut(self.n_clusters)
        self.cluster_centers_: NDArray[Any] = clustering.centroids.astype(X.dtype, copy=False)
        self.inertia_ = clustering.energy
        self.labels_: NDArray[np.int32] = clustering.labels
        if mask is not None:
            self.labels_[~mask] = self._nearest(X[~mask])
        return self

    def fit_predict(self, X: Any, y: Any = None, sample_weight: Optional[ArrayLike] = None) -> NDArray[np.int32]:
        """Cluster the rows of X and return their labels; `y` is ignored."""
        return self.fit(X, y, sample_weight).labels_

    def predict(self, X: Any) -> NDArray[np.int32]:
        """Return the cluster whose center is nearest to each row of X, whatever the graph."""
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=(np.float64, np.float32))
        return self._nearest(X)

    def _nearest(self, X: NDArray[Any]) -> NDArray[np.int32]:
        nearest: NDArray[Any] = pairwise_distances_argmin(X, self.cluster_centers_)
        return nearest.astype(np.int32)

    def _graph(self, X: NDArray[Any]) -> Any:
        if self.connectivity is None:
            return self.n_neighbors
        graph = self.connectivity(X) if callable(self.connectivity) else self.connectivity
        graph = check_array(graph, accept_sparse=True, input_name="connectivity")
        return graph if issparse(graph) else csr_matrix(graph)
