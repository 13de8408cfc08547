"""What tests of points and images use: graphs, and checks that are independent of the package."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Optional

import numpy as np
import scipy.sparse
from conftest import command
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components


def grid_edges(shape: tuple[int, ...]) -> scipy.sparse.csr_matrix:
    """A grid without corners as a sparse matrix, each edge in one direction."""
    numbers = np.arange(np.prod(shape)).reshape(shape)
    pairs = [
        (np.moveaxis(numbers, axis, 0)[:-1].ravel(), np.moveaxis(numbers, axis, 0)[1:].ravel())
        for axis in range(len(shape))
    ]
    rows, columns = (np.concatenate(ends) for ends in zip(*pairs))
    return scipy.sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(numbers.size, numbers.size))


def assert_connected(labels: NDArray[Any], edges: Any, k: int) -> None:
    """Each of the labels 0 to k - 1 is there and connected."""
    flat = labels.reshape(-1)
    assert np.array_equal(np.unique(flat[flat >= 0]), np.arange(k))
    within = edges.tocoo()
    same = (flat[within.row] == flat[within.col]) & (flat[within.row] >= 0)
    inside = scipy.sparse.coo_matrix((np.ones(same.sum()), (within.row[same], within.col[same])), shape=edges.shape)
    pieces = connected_components(inside, directed=False)[0] - (flat < 0).sum()
    assert pieces == k


def energy(x: NDArray[Any], labels: NDArray[Any], weights: Optional[NDArray[Any]] = None) -> float:
    """The energy, computed independently."""
    flat, rows = labels.reshape(-1), x.reshape(-1, x.shape[-1]).astype(np.float64)
    weights = np.ones(len(rows)) if weights is None else weights.reshape(-1)
    total = 0.0
    for k in range(flat.max() + 1):
        mine = flat == k
        mean = np.average(rows[mine], axis=0, weights=weights[mine])
        total += float((weights[mine] * ((rows[mine] - mean) ** 2).sum(axis=1)).sum())
    return total


def sha256(labels: NDArray[np.int32]) -> str:
    return hashlib.sha256(labels.astype("<i4").tobytes()).hexdigest()


def by_command(file: Path, *options: str) -> dict[str, Any]:
    """The report of the command line."""
    report = file.with_suffix(".report")
    done = command("cluster", file, *options, "--report", report)
    assert done.returncode == 0, done.stderr
    value: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return value
