"""Progress of a running clustering: a bar, or a function that gets every row."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any, Callable, Optional, Union

from tesserae_mesh._rows import Iteration, Level

if TYPE_CHECKING:
    Progress = Union[bool, Callable[[Union[Iteration, Level]], object]]


class Bar:
    """A bar on standard error: tqdm's if that is installed, else a line that is written again."""

    def __init__(self) -> None:
        self._tqdm: Optional[Any] = None
        self._rows = 0
        if sys.stderr is None:
            return
        try:
            tqdm: Any = import_module("tqdm.auto").tqdm
        except ImportError:
            return
        self._tqdm = tqdm(desc="clustering", unit=" rows")

    def __call__(self, row: Union[Iteration, Level]) -> None:
        """Show a row."""
        self._rows += 1
        energy = "" if row.energy is None else f"{row.energy:.6g}"
        if isinstance(row, Iteration):
            state = {"phase": row.phase, "iteration": row.iteration, "energy": energy}
        else:
            state = {"round": row.round, "clusters": row.clusters, "energy": energy}
        if self._tqdm is not None:
            self._tqdm.set_postfix(state, refresh=False)
            self._tqdm.update(1)
        elif self._rows % 16 == 1:
            self._write(", ".join(f"{name} {value}" for name, value in state.items()))

    def close(self) -> None:
        """End the line."""
        if self._tqdm is not None:
            self._tqdm.close()
        elif self._rows:
            self._write(f"{self._rows} rows", end="\n")

    @staticmethod
    def _write(text: str, end: str = "") -> None:
        if sys.stderr is not None and sys.stderr.isatty():
            sys.stderr.write(f"\rclustering: {text:70}{end}")
            sys.stderr.flush()


class Rows:
    """Hands rows of the extension to a bar or a function."""

    def __init__(self, progress: Progress) -> None:
        self._bar: Optional[Bar] = Bar() if progress is True else None
        self._function = progress if callable(progress) else self._bar

    @property
    def function(self) -> Optional[Callable[[bool, tuple[Any, ...]], object]]:
        """What the extension calls; None where nothing listens."""
        if self._function is None:
            return None
        function = self._function

        def on_row(is_level: bool, row: tuple[Any, ...]) -> None:
            function(Level(*row) if is_level else Iteration(*row))

        return on_row

    def __enter__(self) -> Rows:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()
