"""The rows that a running clustering reports, and its report keeps."""

from __future__ import annotations

from typing import NamedTuple, Optional


class Iteration(NamedTuple):
    """One iteration of an optimisation."""

    iteration: int
    """0 is the state after the initial growth; then counted through all phases."""
    phase: str
    """What kind of step it was: ``"boundary"``, ``"refine"``, ``"repair"``, ..."""
    round: Optional[int]
    """Hierarchies: the round of merges it belongs to; None for flat clusterings."""
    energy: Optional[float]
    """Energy of the labels after it: area x length**2, in units of the mesh. None when it overflows."""
    moves: int
    """Faces that changed their cluster."""
    elapsed_us: int
    """Time since the clustering began, in microseconds."""


class Level(NamedTuple):
    """A round of a hierarchy, or several, each of which merged little."""

    round: int
    """Number of the round, from 1; of several, the last."""
    clusters: int
    """Clusters left after it."""
    energy: Optional[float]
    """Energy after it: area x length**2, in units of the mesh. None when it overflows."""
    merges: int
    """Pairs that merged since the row before."""
    moves: int
    """Faces that the optimisation gave to other clusters since the row before."""
