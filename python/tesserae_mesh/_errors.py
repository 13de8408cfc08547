"""The one exception of the package."""

from __future__ import annotations

import operator
from typing import Optional, SupportsIndex, cast


class Error(Exception):
    """Something that `tesserae_mesh` refuses or could not do.

    Parameters
    ----------
    kind : str
        What went wrong, for programs: the last segment of the problem types of the HTTP service, such as
        ``"invalid-parameter"``, ``"invalid-mesh"``, ``"too-large"``, ``"conflict"`` or ``"io"``.
    message : str
        What went wrong, for people: what, where in the input, what to do.
    """

    kind: str
    message: str

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(kind, message)
        self.kind = kind
        self.message = message

    def __str__(self) -> str:
        return self.message


def count(value: object, name: str) -> int:
    """Return a number that counts something: an integer from 0 to 2**64 - 1."""
    try:
        number = operator.index(cast(SupportsIndex, value))
    except TypeError as error:
        raise Error("invalid-parameter", f"{name} must be an integer, not {value!r:.80}") from error
    if not 0 <= number < 1 << 64:
        raise Error("invalid-parameter", f"{name} must be from 0 to 2**64 - 1, not {number!r:.80}")
    return number


def count_if_given(value: object, name: str) -> Optional[int]:
    """Return the same, or None."""
    return None if value is None else count(value, name)
