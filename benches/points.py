"""Scores labels of points, as pyacvd makes them."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def points_scored(points, weights, triangles, labels):
    """Energy of labels of points, and how many clusters are connected across edges."""
    labels, k = np.asarray(labels), int(np.max(labels)) + 1
    mass = np.bincount(labels, weights, k)
    mean = np.stack([np.bincount(labels, weights * axis, k) for axis in points.T], 1) / np.maximum(mass, 1e-300)[:, None]
    energy = float((weights * ((points - mean[labels]) ** 2).sum(1)).sum())
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = edges[labels[edges[:, 0]] == labels[edges[:, 1]]]
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(points),) * 2)
    pieces, piece = connected_components(graph, directed=False)
    of = np.zeros(pieces, dtype=int)
    of[piece] = labels
    return energy, int((np.bincount(of, minlength=k) == 1).sum())
