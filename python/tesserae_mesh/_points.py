"""`tesserae_mesh.cluster_points` and `tesserae_mesh.superpixels`: points with neighbours, in this process."""

from __future__ import annotations

import re
from numbers import Integral
from typing import TYPE_CHECKING, Any, Optional, Union, cast

import numpy as np

from tesserae_mesh import _native
from tesserae_mesh._arguments import as_json, as_npy
from tesserae_mesh._clustering import Clustering
from tesserae_mesh._errors import Error, count, warn
from tesserae_mesh._items import Items
from tesserae_mesh._progress import Rows

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from tesserae_mesh._progress import Progress

    Edges = Union[
        tuple[NDArray[np.int32], NDArray[np.int32]],
        tuple[NDArray[np.int64], NDArray[np.int64]],
    ]

READ_AS_THEY_ARE = ("f4", "f8", "u1", "u2", "i4")


def cluster_points(
    X: ArrayLike,
    k: Optional[int] = None,
    *,
    graph: Any = None,
    weights: Optional[ArrayLike] = None,
    mask: Optional[ArrayLike] = None,
    seeds: Union[str, ArrayLike] = "coarse",
    device: str = "auto",
    adapter: Optional[str] = None,
    progress: Progress = False,
    **parameters: Any,
) -> Clustering:
    """Cluster points of any number of coordinates that have neighbours: pixels, voxels, regions, rows of tables.

    Every cluster is connected, there are exactly `k`, and labels are a function of the arguments only: neither threads
    nor machine change them. They equal those of ``tesserae cluster X.npy``. The energy is the sum of weight x squared
    distance between an item and the mean of its cluster. Columns are taken as they are: scale them before.

    Parameters
    ----------
    X : array_like of shape (n, d)
        Finite numbers, d from 1 to 64. float32, float64, uint8, uint16 and int32 are read as they are; other types
        become float64 where NumPy does that safely. With a grid: its shape of 2 or 3 dimensions, and then d.
    k : int, optional
        Number of clusters. When left out: the number of seeds if they are listed, and all the way to the top for
        hierarchies.
    graph : int, str, sparse matrix, or tuple, optional
        What makes items neighbours. A number Q, or ``"knn:Q"``: one is among the Q nearest of the other, exactly;
        ``"grid"``: the place in a grid, 4 or 6 neighbours (``"grid:full"``: 8 or 26); a sparse matrix of scipy's, n x
        n: entries other than 0, in both directions; ``(indptr, indices)``: the same as compressed rows. 8 nearest
        neighbours when left out.
    weights : array_like of float, optional
        One an item, above 0.
    mask : array_like of bool, optional
        True where an item takes part; others have the label -1, and their coordinates are not looked at.
    seeds : {"coarse", "morton", "random"} or array_like of int
        Where flat clusters start, or at which items. Cluster i then is the one of seed i.
    device, adapter, progress
        As of `tesserae_mesh.cluster`. A gpu takes points of up to 8 coordinates.
    **parameters
        Others of `tesserae_mesh.cluster`, but those of meshes: `algorithm`, `quality`, `bridge_components`, `levels`,
        ...

    Returns
    -------
    Clustering
        `labels` are int32 and have the shape of the items.

    Raises
    ------
    tesserae_mesh.Error
        A parameter or array is impossible (``"invalid-parameter"``), such as fewer clusters than connected components
        without ``bridge_components=True``; there are too many items or edges (``"too-large"``).
    KeyboardInterrupt
        Ctrl-C was pressed.

    Examples
    --------
    >>> import numpy as np, tesserae_mesh
    >>> X = np.array([[0.0], [1.0], [5.0], [6.0]])
    >>> tesserae_mesh.cluster_points(X, 2, graph=1, bridge_components=True).labels
    array([0, 0, 1, 1], dtype=int32)
    """
    coordinates = _coordinates(X)
    name, edges = _graph(graph)
    if coordinates.ndim < 2 or (coordinates.ndim != 2 and not (name or "").startswith("grid")):
        raise Error(
            "invalid-parameter",
            "X must have items x columns, as X.reshape(-1, d) makes it, or with graph=\"grid\" a shape and then "
            f"columns, not the shape {coordinates.shape}",
        )
    shape = coordinates.shape[:-1]
    of_items = _weights(weights, shape)
    items = Items(shape, _mask(mask, shape, "items"))
    job = _job(k, seeds, device, adapter, parameters, graph=name)
    with Rows(progress) as rows:
        outcome = _native.cluster_points(coordinates, of_items, items.mask, edges, job, rows.function)
    warn(outcome.warnings())
    return Clustering(outcome, None, items=items)


def superpixels(
    image: ArrayLike,
    n: int,
    compactness: float = 10,
    *,
    mask: Optional[ArrayLike] = None,
    device: str = "auto",
    adapter: Optional[str] = None,
    progress: Progress = False,
    **parameters: Any,
) -> NDArray[np.int32]:
    """Cluster the pixels of an image by colour and place: exactly `n` superpixels, each connected.

    The distance is that of SLIC (Achanta et al. 2012), in CIELAB.

    Parameters
    ----------
    image : array_like of shape (height, width) or (height, width, channels)
        sRGB, of 1 to 4 channels: grey; grey and alpha; red, green, blue; these and alpha. uint8, uint16, bool, or
        floats from 0 to 1, which become uint16 as `skimage.util.img_as_uint` makes them.
    n : int
        Number of superpixels.
    compactness : float
        How much place counts beside colour, as in `skimage.segmentation.slic`.
    mask : array_like of bool, shape (height, width), optional
        True where a pixel takes part; one whose alpha is 0 does not either.
    device, adapter, progress, **parameters
        As of `cluster_points`; ``bridge_components=True`` where what takes part is in more parts than `n`.

    Returns
    -------
    ndarray of int32, shape (height, width)
        Labels from 0 to ``n - 1``; -1 where a pixel takes no part.

    Raises
    ------
    tesserae_mesh.Error
        As of `cluster_points`.

    Examples
    --------
    >>> import numpy as np, tesserae_mesh
    >>> image = np.zeros((2, 4), dtype=np.uint8)
    >>> image[:, 2:] = 255
    >>> tesserae_mesh.superpixels(image, 2)
    array([[0, 0, 1, 1],
           [0, 0, 1, 1]], dtype=int32)
    """
    pixels = _asarray(image, "image")
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    if pixels.ndim != 3 or not 1 <= pixels.shape[2] <= 4:
        raise Error(
            "invalid-parameter",
            f"an image must have height x width, or these and 1 to 4 channels, not the shape {pixels.shape}",
        )
    taken = _mask(mask, pixels.shape[:2], "pixels")
    seeds = parameters.pop("seeds", "coarse")
    job = _job(count(n, "n"), seeds, device, adapter, parameters, compactness=compactness)
    with Rows(progress) as rows:
        outcome = _native.superpixels(_samples(pixels, taken), taken, job, rows.function)
    labels = outcome.labels()
    if labels is None:
        raise Error("conflict", "a whole hierarchy has labels at every number of clusters: give n")
    warn(outcome.warnings())
    return labels.view(np.int32).reshape(pixels.shape[:2])


def _job(
    k: Optional[int], seeds: Any, device: str, adapter: Optional[str], parameters: dict[str, Any], **own: Any
) -> _native.Job:
    unknown = set(parameters).difference(_native.parameters()).union({"graph", "compactness"}.intersection(parameters))
    if unknown:
        raise TypeError(f"there is no parameter of that name: {min(unknown)}")
    if k is not None:
        if "clusters" in parameters:
            raise Error("invalid-parameter", f"the number of clusters is given twice: {k} and {parameters['clusters']}")
        parameters = {**parameters, "clusters": count(k, "k")}
    is_listed = not isinstance(seeds, str)
    return _native.Job(
        as_json(seeds="listed" if is_listed else seeds, **parameters, **own),
        as_npy(seeds, "seeds", "iu") if is_listed else None,
        None,
        str(device),
        None if adapter is None else str(adapter),
        None,
        None,
        None,
    )


def _asarray(values: Any, what: str) -> NDArray[Any]:
    if np.ma.is_masked(values):
        raise Error("invalid-parameter", f"{what} is a masked array: give its values, and what takes part as mask")
    try:
        return np.asarray(values)
    except (TypeError, ValueError, OverflowError) as error:
        raise Error("invalid-parameter", f"{what} is no array: {error}") from error


def _converted(array: NDArray[Any], kind: str, what: str) -> NDArray[Any]:
    """An array of a type that fits every value, aligned and in the machine's order of bytes."""
    if not np.can_cast(array.dtype, kind, "safe"):
        raise Error("invalid-parameter", f"{what} must be real numbers that float64 can hold, not {array.dtype}")
    return np.require(array, kind, "A")


def _coordinates(values: Any) -> NDArray[Any]:
    array = _asarray(values, "X")
    kind = array.dtype.str[1:]
    return _converted(array, kind if kind in READ_AS_THEY_ARE else "f8", "X")


def _weights(values: Any, shape: tuple[int, ...]) -> Optional[NDArray[np.float64]]:
    if values is None:
        return None
    weights = _converted(_asarray(values, "weights"), "f8", "weights")
    return _of_items(weights, shape, "weights", "items")


def _mask(values: Any, shape: tuple[int, ...], what: str) -> Optional[NDArray[np.bool_]]:
    if values is None:
        return None
    mask = _asarray(values, "mask")
    if mask.dtype.kind not in "biu":
        raise Error("invalid-parameter", f"mask must be True and False, or whole numbers, not {mask.dtype}")
    return _of_items(mask.astype(np.bool_, copy=False), shape, "mask", what)


def _of_items(array: NDArray[Any], shape: tuple[int, ...], what: str, of: str) -> NDArray[Any]:
    if array.shape != shape:
        raise Error("invalid-parameter", f"{what} must have the shape of the {of}, {shape}, not {array.shape}")
    return array.reshape(-1)


def _graph(graph: Any) -> tuple[Optional[str], Optional[Edges]]:
    """What makes items neighbours: by a name that the library knows, or by edges."""
    if graph is None:
        return None, None
    if not isinstance(graph, bool) and isinstance(graph, Integral):
        return f"knn:{count(graph, 'graph')}", None
    if isinstance(graph, str) and re.fullmatch(r"knn|knn:[0-9]+|grid|grid:full", graph):
        return graph, None
    if isinstance(graph, tuple):
        return None, _edges(cast(Any, graph))
    # of scipy's sparse matrices and arrays, which need not be imported to be recognised
    if callable(getattr(graph, "tocsr", None)):
        return None, _edges_of(graph)
    shown = repr(graph) if isinstance(graph, str) else type(graph).__name__
    raise Error(
        "invalid-parameter",
        'graph must be a number of nearest neighbours, "knn:Q", "grid", "grid:full", a sparse matrix of scipy\'s, or '
        f"(indptr, indices), not {shown:.80}",
    )


def _edges_of(matrix: Any) -> Edges:
    """The entries other than 0 of a sparse matrix."""
    rows = matrix.tocsr()
    if len(rows.shape) != 2 or rows.shape[0] != rows.shape[1]:
        raise Error("invalid-parameter", f"a graph must be n x n for n items, not of the shape {rows.shape}")
    if not rows.data.all():
        rows = rows.copy()
        rows.eliminate_zeros()
    return _edges((rows.indptr, rows.indices))


def _edges(pair: tuple[Any, ...]) -> Edges:
    """Compressed rows, both arrays of one type."""
    names = ("indptr", "indices")
    if len(pair) != len(names):
        raise Error("invalid-parameter", f"a graph is two arrays, (indptr, indices), not {len(pair)}")
    arrays = [_asarray(array, name) for name, array in zip(names, pair)]
    for name, array in zip(names, arrays):
        if array.ndim != 1 or array.dtype.kind not in "iu" and array.size > 0:
            raise Error(
                "invalid-parameter",
                f"{name} must be whole numbers in one dimension, not {array.dtype} {array.shape}",
            )
    kind = "i4" if all(np.can_cast(array.dtype, "i4", "safe") for array in arrays) else "i8"
    first, second = (np.require(array.astype(kind, copy=False), kind, "A") for array in arrays)
    return first, second


def _samples(pixels: NDArray[Any], mask: Optional[NDArray[np.bool_]]) -> NDArray[Any]:
    """The samples of an image in 8 or 16 bits."""
    kind = pixels.dtype.str[1:]
    if kind in ("u1", "u2"):
        return _converted(pixels, kind, "image")
    if pixels.dtype.kind == "b":
        return np.array([0, 255], dtype=np.uint8)[pixels.astype(np.intp)]
    if pixels.dtype.kind != "f":
        raise Error(
            "invalid-parameter",
            f"an image must be of uint8, uint16, bool, or floats from 0 to 1, not {pixels.dtype}",
        )
    fits = (pixels >= 0) & (pixels <= 1)
    if not fits.all():
        if mask is not None:
            fits |= ~mask.reshape(fits.shape[:2])[:, :, None]
        wrong = np.argwhere(~fits)
        if wrong.size > 0:
            row, column, channel = (int(index) for index in wrong[0])
            raise Error(
                "invalid-parameter",
                f"an image of floats must have them from 0 to 1; row {row}, column {column}, channel {channel} is "
                f"{pixels[row, column, channel]}",
            )
        pixels = np.where((pixels >= 0) & (pixels <= 1), pixels, 0)
    # f8 stays f8 and others become f4, as img_as_uint computes
    scaled = np.multiply(pixels, 65535, dtype="f8" if pixels.dtype.itemsize > 4 else "f4")
    samples: NDArray[np.uint16] = np.rint(scaled).astype(np.uint16)
    return samples
