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
        """Return labels in the shape of the items: -1, which is 2**32 - 1, where the mask leaves one out."""
        return labels.view(np.int32).reshape(self.shape)
