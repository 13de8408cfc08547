"""Cluster a mesh that is in arrays: labels, a hierarchy, a remesh."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

import tesserae_mesh


def bent_grid(n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points and triangles of a bent square."""
    x, y = np.meshgrid(np.linspace(0, 6, n), np.linspace(0, 6, n))
    points = np.reshape(np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1), (-1, 3))
    corner = np.ravel(np.arange(n - 1)[:, None] * n + np.arange(n - 1))
    lower = np.stack([corner, corner + 1, corner + n], axis=1)
    upper = np.stack([corner + 1, corner + n + 1, corner + n], axis=1)
    return points, np.concatenate([lower, upper])


def main() -> int:
    """Cluster, and print what came out."""
    points, faces = bent_grid(120)
    clustering = tesserae_mesh.cluster(points, faces, clusters=200)
    print(f"{clustering.clusters} clusters, energy {clustering.energy:.6e}, ratio {clustering.hexagon_ratio:.3f}")
    print(f"faces a cluster: {clustering.sizes.min()} to {clustering.sizes.max()}")

    remesh = clustering.remesh()
    print(f"remesh: {len(remesh.points)} points, {len(remesh.faces)} triangles")

    hierarchy = tesserae_mesh.cluster(points, faces, algorithm="pml").hierarchy
    for clusters in (1000, 100, 10):
        cut = hierarchy.cut(clusters)
        print(f"cut at {cut.clusters}: energy {cut.energy:.6e}, {cut.kind}")

    try:
        tesserae_mesh.cluster(points, faces, clusters=len(faces) + 1)
    except tesserae_mesh.Error as error:
        print(f"{error.kind}: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
