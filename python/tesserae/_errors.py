"""The one exception of the package."""

from __future__ import annotations


class Error(Exception):
    """Something that `tesserae` refuses or could not do.

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
