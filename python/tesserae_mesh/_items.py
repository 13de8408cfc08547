"""Points with neighbours, as labels refer to them."""

from __future__ import annotations

from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray


class Items(NamedTuple):
    """The items of a clustering of points."""

    shape: tuple[int, ...]
    """Their shape."""
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
        return placed.reshape(self.shape)
