"""Arguments as what the extension reads: parameters as JSON, lists of numbers as files of NumPy's."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from tesserae_mesh._errors import Error

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def as_json(**parameters: Any) -> str:
    """Return the parameters that were given as JSON, whose reader checks them."""
    given = {name: value for name, value in parameters.items() if value is not None}
    try:
        return json.dumps(given, allow_nan=False, default=_plain)
    except (TypeError, ValueError, OverflowError) as error:
        raise Error("invalid-parameter", f"a parameter is of a wrong type: {error}") from error


def _plain(value: Any) -> Any:
    """A number or array of NumPy as Python's own."""
    if isinstance(value, (np.generic, np.ndarray)):
        return cast(Any, value).tolist()
    if isinstance(value, range):
        return list(value)
    raise TypeError(f"{value!r:.80}")


def as_npy(values: ArrayLike, what: str, kinds: str) -> bytes:
    """Return a list of numbers as a file of NumPy's, which the library reads."""
    if np.ma.is_masked(values):
        raise Error("invalid-parameter", f"{what} are a masked array: give their values")
    try:
        array = np.asarray(values)
    except (TypeError, ValueError, OverflowError) as error:
        raise Error("invalid-parameter", f"{what} make no array: {error}") from error
    if array.ndim != 1 or array.dtype.kind not in kinds:
        raise Error("invalid-parameter", f"{what} must be numbers in one dimension, not {array.dtype} {array.shape}")
    with io.BytesIO() as file:
        np.save(file, array.astype("<f8" if "f" in kinds else "<i8", copy=False))
        return file.getvalue()
