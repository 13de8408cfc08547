"""Hierarchies: one tree of merges, labels at any number of clusters."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, NamedTuple, Optional, Union

import numpy as np

from tesserae_mesh import _native
from tesserae_mesh._errors import count, count_if_given, file_error
from tesserae_mesh._items import Items

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEVEL = np.dtype([("round", "u4"), ("clusters", "u4"), ("energy", "f8"), ("merges", "u4"), ("moves", "u8")])
"""A row of `Hierarchy.levels`."""

MOST_FACES = 2**32
"""More than any hierarchy has, for one that is unpickled."""


class Cut(NamedTuple):
    """A clustering taken from a hierarchy."""

    labels: NDArray[Any]
    """One label a face or item, as in `Clustering.labels`, numbered by the first that carries them."""
    clusters: int
    """Number of clusters."""
    energy: float
    """Energy: area x length**2, in units of the mesh."""
    kind: str
    """``"exact"`` for a state that the run had, ``"merged"`` for one with merges of the next round on top."""
    round: int
    """Rounds replayed as a whole."""
    merges_on_top: int
    """Merges of the next round on top, the cheapest ones; 0 of an exact cut."""

    def __repr__(self) -> str:
        return f"Cut({self.labels.size} labels, {self.clusters} clusters, {self.kind}, energy {self.energy:.6g})"


class Hierarchy:
    """A hierarchy of clusterings of the same faces (Parallel Mesh Clustering, section 4).

    `Clustering.hierarchy` is one; `Hierarchy.load` reads one from a file.
    """

    __slots__ = ("_items", "_tree")

    _tree: _native.Tree
    _items: Optional[Items]

    def __init__(self, tree: _native.Tree, items: Optional[Items] = None) -> None:
        self._tree = tree
        self._items = items

    @classmethod
    def load(cls, source: Union[str, os.PathLike[str], bytes], *, max_faces: Optional[int] = None) -> Hierarchy:
        """Read a hierarchy that `save`, ``tesserae cluster --hierarchy OUT.tsr`` or the HTTP service wrote.

        Parameters
        ----------
        source : str, path or bytes
            Name of the file, or what is in it.
        max_faces : int, optional
            Largest number of faces that is accepted; 50,000,000 when left out.

        Raises
        ------
        tesserae_mesh.Error
            The file cannot be read (``"io"``), is no hierarchy (``"bad-request"``) or too large (``"too-large"``).
        """
        max_faces = count_if_given(max_faces, "max_faces")
        if isinstance(source, bytes):
            return _read(cls, source, max_faces)
        try:
            content = Path(source).read_bytes()
        except (OSError, ValueError) as error:
            raise file_error("read", source, error) from error
        return _read(cls, content, max_faces)

    def save(self, path: Union[str, os.PathLike[str]]) -> None:
        """Write the hierarchy to a file from which `load` and ``tesserae cut`` take labels; its name ends in .tsr.

        Raises
        ------
        tesserae_mesh.Error
            The file cannot be written (``"io"``).
        """
        content = self._tree.write()
        try:
            Path(path).write_bytes(content)
        except (OSError, ValueError) as error:
            raise file_error("write", path, error) from error

    def to_bytes(self) -> bytes:
        """Return what `save` writes."""
        return self._tree.write()

    def to_json(self, *, min_clusters: Optional[int] = None, max_clusters: Optional[int] = None) -> dict[str, Any]:
        """Return the tree with its levels and merges, as ``--hierarchy OUT.json`` writes it.

        Parameters
        ----------
        min_clusters, max_clusters : int, optional
            Leave out what comes after fewer, or before as few, clusters are left.
        """
        limits = count_if_given(min_clusters, "min_clusters"), count_if_given(max_clusters, "max_clusters")
        value: dict[str, Any] = json.loads(self._tree.json(*limits))
        return value

    @property
    def faces(self) -> int:
        """Number of faces, or of items that take part: the number of clusters before the first round."""
        return self._tree.faces

    @property
    def roots(self) -> int:
        """Number of clusters that the last round left."""
        return self._tree.roots

    @property
    def header(self) -> dict[str, Any]:
        """Where the hierarchy comes from: version, algorithm, parameters, input."""
        value: dict[str, Any] = json.loads(self._tree.header())
        return value

    @property
    def levels(self) -> NDArray[np.void]:
        """One row a round, finest first: ``round``, ``clusters``, ``energy``, ``merges``, ``moves``.

        `energy` is area x length**2, in units of the mesh.
        """
        clusters, energy, merges, moves = self._tree.rounds()
        levels = np.zeros(clusters.shape[0], dtype=LEVEL)
        levels["round"] = np.arange(1, clusters.shape[0] + 1)
        levels["clusters"], levels["energy"], levels["merges"], levels["moves"] = clusters, energy, merges, moves
        return levels

    def cut(self, clusters: int) -> Cut:
        """Take the labels at exactly this many clusters, without clustering again.

        A number that a round ended with gives the labels that the run had there, as does every number that was asked
        for with `levels`. Any other takes the last round before it and applies the next round's cheapest merges.

        Raises
        ------
        tesserae_mesh.Error
            There are fewer faces, or more roots, than that (``"invalid-parameter"``).
        """
        wanted = count(clusters, "clusters")
        labels, energy, rounds, merges = self._tree.cut(wanted)
        placed = labels if self._items is None else self._items.placed(labels)
        return Cut(placed, wanted, energy, "merged" if merges else "exact", rounds, merges)

    def linkage(self) -> NDArray[np.float64]:
        """Return scipy's linkage matrix: a row a merge, with two clusters, their distance, their number of faces.

        Raises
        ------
        tesserae_mesh.Error
            The tree is not nested (``optimize="none"`` makes it so) or has several roots (``"conflict"``).
        """
        return self._tree.linkage()

    def __reduce__(self) -> tuple[Callable[..., Hierarchy], tuple[type[Hierarchy], bytes, int]]:
        return _read, (type(self), self.to_bytes(), MOST_FACES)

    def __repr__(self) -> str:
        return f"Hierarchy({self.faces} {'faces' if self._items is None else 'items'}, {self.roots} roots)"


def _read(kind: type[Hierarchy], content: bytes, max_faces: Optional[int]) -> Hierarchy:
    """Return a hierarchy that was written; labels of points have their shape, and -1 where a mask left one out."""
    tree = _native.Tree.read(content, max_faces)
    shape = tree.shape()
    return kind(tree, None if shape is None else Items(tuple(shape), None))
