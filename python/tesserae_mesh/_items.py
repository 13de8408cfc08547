"""Points with neighbours, as labels refer to them."""

from __future__ import annotations

from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray


class Items(NamedTuple):
    """The items of a clustering of points."""

    coordinates: NDArray[Any]
    """The shape of the items, and then d."""
    weights: Optional[NDArray[np.float64]]
    """One an item, in one dimension."""
    mask: Optional[NDArray[np.bool_]]
    """Whether each takes part, in one dimension."""

    def placed(self, labels: NDArray[np.uint32]) -> NDArray[np.int32]:
        """Return labels in the shape of the items, -1 where the mask leaves one out.

        Labels are those of all items, 2**32 - 1 where they are masked, or of those that take part.
        """
        placed = labels.view(np.int32)
        if self.mask is not None and placed.size < self.mask.size:
            placed = np.full(self.mask.size, -1, dtype=np.int32)
            placed[self.mask] = labels.view(np.int32)
        return placed.reshape(self.coordinates.shape[:-1])

    def means(self, labels: NDArray[np.int32], clusters: int) -> NDArray[np.float64]:
        """Return the weighted mean of each cluster, shape (clusters, d)."""
        flat = labels.reshape(-1)
        taken = flat >= 0
        flat = flat[taken]
        weights = None if self.weights is None else self.weights[taken]
        total = np.bincount(flat, weights, clusters)
        means = np.empty((clusters, self.coordinates.shape[-1]))
        for axis in range(means.shape[1]):
            column = self.coordinates[..., axis].reshape(-1)[taken].astype(np.float64, copy=False)
            # differences to one of them: means far from 0 keep their digits
            sums = np.bincount(flat, (column - column[0]) * (1 if weights is None else weights), clusters)
            means[:, axis] = column[0] + sums / total
        return means
