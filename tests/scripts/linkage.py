"""Linkage matrices as scipy sees them, and exact Ward clustering by higra where that is installed.

    python linkage.py MESH.obj CLUSTERS          prints the energy of higra's area-weighted Ward on neighbouring faces
"""

import sys

import numpy as np
from scipy.cluster import hierarchy

import score

try:
    import higra
except ImportError:
    higra = None


def check(matrix, faces):
    """Everything that scipy asks of a matrix and does with it."""
    assert matrix.shape == (faces - 1, 4) and matrix.dtype == np.float64, f"{matrix.shape} {matrix.dtype}"
    hierarchy.is_valid_linkage(matrix, throw=True)
    assert hierarchy.is_monotonic(matrix), "distances fall"
    assert matrix[-1, 3] == faces, "the last row is not the root"
    drawn = hierarchy.dendrogram(matrix, no_plot=True, truncate_mode="lastp", p=50)
    assert len(drawn["leaves"]) == 50, len(drawn["leaves"])
    distances = matrix[:, 2]
    for threshold in np.quantile(distances, [0.5, 0.9, 0.99, 0.999]):
        labels = hierarchy.fcluster(matrix, threshold, "distance")
        assert labels.max() == 1 + (distances > threshold).sum(), f"{labels.max()} clusters at {threshold}"
    # Fewer than asked for where distances tie, never more.
    for clusters in (2, 10, 100):
        assert hierarchy.fcluster(matrix, clusters, "maxclust").max() <= clusters
    # The checks can fail: distances that fall, and a row that uses what comes later.
    broken = matrix.copy()
    broken[[0, -1], 2] = broken[[-1, 0], 2]
    assert not hierarchy.is_monotonic(broken)
    broken = matrix[::-1].copy()
    assert not hierarchy.is_valid_linkage(broken)


def dual_edges(corners, first, vertices):
    """Pairs of faces that share an edge, positions that are equal being one vertex."""
    _, weld = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    corner = weld.ravel()[corners]
    face = np.repeat(np.arange(len(first) - 1), np.diff(first))
    after = np.arange(1, len(corners) + 1)
    after[first[1:] - 1] = first[:-1]
    ends = np.sort(np.stack([corner, corner[after]], 1), axis=1)
    order = np.lexsort(ends.T)
    same = (ends[order][1:] == ends[order][:-1]).all(1)
    pairs = np.sort(np.stack([face[order][:-1][same], face[order][1:][same]], 1), axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def ward(mesh, clusters):
    """Energy at so many clusters of higra's Ward clustering of the face centroids, weighted by area."""
    vertices, corners, first = mesh
    faces = len(first) - 1
    triangles, face = score.fans(corners, first)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    area = np.sqrt((np.cross(b - a, c - a) ** 2).sum(1)) / 2
    face_area = np.bincount(face, area, faces)
    middle = (a + b + c) / 3
    moment = np.stack([np.bincount(face, area * middle[:, axis], faces) for axis in range(3)], 1)
    centroid = moment / np.where(face_area > 0, face_area, 1)[:, None]
    pairs = dual_edges(corners, first, vertices)
    graph = higra.UndirectedGraph(faces)
    graph.add_edges(pairs[:, 0], pairs[:, 1])
    # its own rule for inversions only sets altitudes; merges come in the order of the nodes
    tree, _ = higra.binary_partition_tree_ward_linkage(graph, centroid, face_area)
    parents = tree.parents()
    top = np.arange(tree.num_vertices())
    last = tree.num_vertices() - (clusters - 1)
    for node in range(tree.num_vertices() - 1, -1, -1):
        if parents[node] < last:
            top[node] = top[parents[node]]
    return score.score(mesh, np.unique(top[:faces], return_inverse=True)[1])["energy"]


if higra is None:
    ward = None

if __name__ == "__main__":
    print(ward(score.load(sys.argv[1]), int(sys.argv[2])))
