"""The exceptions and warnings of the package."""

from __future__ import annotations

import operator
import os
import warnings
from typing import Optional, SupportsIndex, Union, cast


class Error(ValueError):
    """Something that `tesserae_mesh` refuses or could not do.

    Parameters
    ----------
    kind : str
        What went wrong, for programs: the last segment of the problem types of the HTTP service, such as
        ``"invalid-parameter"``, ``"invalid-mesh"``, ``"too-large"``, ``"conflict"`` or ``"io"``. The errors of files
        are `OSError`, too, with ``errno`` and ``filename``.
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


class FileError(Error, OSError):
    """A file that cannot be read or written.

    Parameters
    ----------
    message : str
        Which file, and why.
    number : int, optional
        `OSError.errno`.
    path : str or path, optional
        `OSError.filename`.
    """

    def __init__(
        self, message: str, number: Optional[int] = None, path: Union[str, os.PathLike[str], None] = None
    ) -> None:
        super().__init__("io", message)
        self.errno = number
        self.strerror = None if number is None else os.strerror(number)
        self.filename = None if path is None else os.fspath(path)

    def __reduce__(self) -> tuple[type[FileError], tuple[object, ...]]:
        return type(self), (self.message, self.errno, self.filename)


class ClusteringWarning(UserWarning):
    """Something unusual in a clustering, and what to do: an entry of ``report["warnings"]``."""


def warn(messages: list[str]) -> None:
    """Warn of each, at the line outside the package that called it."""
    if not messages:
        return
    from inspect import currentframe

    level, frame = 1, currentframe()
    while frame is not None and frame.f_globals.get("__name__", "").startswith("tesserae_mesh."):
        level, frame = level + 1, frame.f_back
    for message in messages:
        warnings.warn(message, ClusteringWarning, stacklevel=level)


def file_error(what: str, path: Union[str, os.PathLike[str]], cause: Exception) -> FileError:
    """Return the error of a file that the system refuses: `what` is ``"read"`` or ``"write"``."""
    number = cause.errno if isinstance(cause, OSError) else None
    reason = cause if number is None else os.strerror(number)
    return FileError(f"cannot {what} {os.fspath(path)}: {reason}", number, path)


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
