"""`tesserae_mesh.cluster`: one clustering, in this process."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal, Optional, Union

import numpy as np

from tesserae_mesh import _native
from tesserae_mesh._arguments import as_json, as_npy
from tesserae_mesh._clustering import Clustering
from tesserae_mesh._errors import Error, count, count_if_given, warn
from tesserae_mesh._mesh import Mesh
from tesserae_mesh._progress import Rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from tesserae_mesh._mesh import FacesLike, MeshLike, PathLike
    from tesserae_mesh._progress import Progress

Algorithm = Literal["bb", "pml", "ml", "hr", "acvd", "vc"]
Energy = Literal["cvd", "l21", "planes", "shapes"]
Quality = Literal["fast", "default", "best"]
Device = Literal["auto", "cpu", "gpu"]


class _Default(int):
    """A number that was left out."""


_CLUSTERS = _Default(1000)


def cluster(
    points: Union[ArrayLike, MeshLike, PathLike],
    faces: Union[FacesLike, int, None] = None,
    clusters: Optional[int] = _CLUSTERS,
    *,
    algorithm: Algorithm = "bb",
    energy: Energy = "cvd",
    shapes: Optional[str] = None,
    resolution: Union[float, str, None] = None,
    tolerance: Union[float, str, None] = None,
    quality: Quality = "default",
    seeds: Union[Literal["coarse", "merged", "morton", "random"], ArrayLike] = "coarse",
    seed: int = 0,
    max_iterations: Optional[int] = None,
    refine: Literal["on", "none"] = "on",
    allow_disconnected: bool = False,
    bridge_components: bool = False,
    features: Union[float, str, None] = None,
    snapshots: Union[int, Sequence[int], str, None] = None,
    curvature_exponent: Optional[float] = None,
    weights: Optional[ArrayLike] = None,
    weight_attribute: Optional[str] = None,
    optimize: Literal["on", "none"] = "on",
    optimize_iterations: Optional[int] = None,
    switch_to_ml_at: Optional[int] = None,
    collapse_fraction: Optional[float] = None,
    ties: Literal["hash", "largest-id"] = "hash",
    pairs: Literal["cheaper-half", "all", "eighth"] = "cheaper-half",
    levels: Union[Sequence[int], str, None] = None,
    device: Device = "auto",
    adapter: Optional[str] = None,
    format: Optional[Literal["obj", "glb", "gltf", "ply", "stl", "off"]] = None,
    max_faces: Optional[int] = None,
    max_faces_per_byte: Optional[int] = None,
    max_upload_bytes: Optional[int] = None,
    progress: Progress = False,
) -> Clustering:
    """Cluster the faces of a mesh.

    Labels are a function of the mesh and the parameters only, and equal those of ``tesserae cluster`` on the command
    line. The lock of the interpreter is released; Ctrl-C cancels.

    Parameters
    ----------
    points : array_like of shape (N, 3), mesh, or path
        Positions in any unit of length, float32 or float64; an array that is contiguous and aligned is not copied. Or
        with `faces` left out: a ``pyvista.PolyData``, ``trimesh.Trimesh``, ``trimesh.Scene`` (its meshes in the order
        of ``to_mesh()``, each at its place), ``open3d.geometry.TriangleMesh``, ``meshio.Mesh`` or `tesserae_mesh.Mesh`,
        or the name of an OBJ, GLB, glTF, PLY, STL or OFF file.
    faces : array_like or tuple, optional
        Polygons: integers of shape (F, n), F faces of n corners; VTK's padded array of one dimension; or a tuple of
        offsets (F + 1) and corners. A single integer after a mesh or path is `clusters`.
    clusters : int or None
        Number of clusters; ``cluster(mesh, 100)`` is ``cluster(mesh, clusters=100)``. When left out: 1,000 for flat
        clusterings, the number of seeds if they are listed, what it takes with a tolerance, and all the way to the top
        for hierarchies.
    algorithm : {"bb", "pml", "ml", "hr", "acvd", "vc"}
        ``"bb"``, boundary-based clustering (Parallel Mesh Clustering, section 3), makes flat clusters; ``"pml"``
        (parallel multilevel) and ``"ml"`` (multilevel; section 4) and ``"hr"`` (hierarchical, Garland et al. 2001)
        make hierarchies; ``"acvd"`` (Valette & Chassery 2004) and ``"vc"`` (Cohen-Steiner et al. 2004) are sequential
        references.
    energy : {"cvd", "l21", "planes", "shapes"}
        What clusters have little of: ``"cvd"``, area x squared distance to their mean place, for compact clusters;
        ``"l21"``, area x squared distance of the unit normal to their mean normal, for flat ones; ``"planes"``, area x
        squared distance to a plane; ``"shapes"``, to a plane, sphere, cylinder or cone.
        ``Clustering.report["shapes"]`` has the shapes.
    shapes : str, optional
        Energy shapes: types that clusters may have, of ``"plane,sphere,cylinder,cone"``; all but cones when left out;
        planes always.
    resolution : float or str, optional
        Energy shapes: distances below it are noise, which no curved shape stands for; a share of the diagonal of
        the mesh, 0.0003 or a tenth of the tolerance when left out, or a length, ``"0.5u"``.
    tolerance : float or str, optional
        Energies planes and shapes, in place of `clusters`: few clusters, such that no corner of a face is
        further than this from the shape of its cluster; a share of the diagonal of the mesh, or a length, ``"0.5u"``.
        The resolution is a tenth of it when left out.
    quality : {"default", "fast", "best"}
        How much time to take for how low an energy; bb and pml.
    seeds : {"coarse", "merged", "morton", "random"} or array_like of int
        Where flat clusters start: on a coarser mesh, merged from single faces (energies other than cvd take this for coarse),
        stratified by area along a Morton curve, on random faces (Parallel
        Mesh Clustering, section 5.3), or on these faces. Cluster i then is the one of seed i.
    seed : int
        Number that the random choices of seeds are drawn from.
    max_iterations : int, optional
        Stop a flat clustering after this many iterations, converged or not. Unlimited when left out, 3 with quality
        ``"fast"``.
    refine : {"on", "none"}
        Refine what boundary-based optimisation ends with by exact gains, or leave it.
    allow_disconnected : bool
        Accept clusters in several pieces, as the optimisation left them.
    bridge_components : bool
        Join separate parts where they are nearest, as if they shared an edge.
    features : float or str, optional
        Do not let clusters cross edges at which the surface bends by more than this angle in degrees, 0 to 180 (40 is
        safe). Files: ``"groups"``, or both as ``"40,groups"``, also keeps OBJ groups and materials and glTF primitives
        apart.
    snapshots : int, sequence of int, or str, optional
        Keep the labels at every N-th iteration of a flat clustering, or at these; 0 is the initial growth.
    curvature_exponent : float, optional
        Let clusters be smaller where the surface bends: areas are multiplied by curvature over its root mean square to
        this power; from 0 to 10, no unit.
    weights : array_like of float, optional
        Numbers above 0 that areas are multiplied by: one a face, or one a point, whose mean a face takes. No unit.
    weight_attribute : str, optional
        glTF files: multiply areas by this attribute of the vertices; its name begins with an underscore.
    optimize : {"on", "none"}
        Hierarchies: optimise after the merges of a round, or only merge, which makes a nested tree. hr never optimises.
    optimize_iterations : int, optional
        Hierarchies: at most this many iterations in a round that is optimised, except at levels and at the end.
    switch_to_ml_at : int, optional
        pml: go on as ml, one merge a step, once this many clusters or fewer are left.
    collapse_fraction : float, optional
        ml, hr, and pml after its switch: merge this percentage of the clusters a step, the cheapest pairs first, in
        place of one pair; above 0, at most 50.
    ties : {"hash", "largest-id"}
        Hierarchies: which of equally cheap pairs merges first; ``"largest-id"`` is the rule of the paper.
    pairs : {"cheaper-half", "all", "eighth"}
        pml: which of the pairs that chose each other merge in a round; ``"all"`` as in the paper (section 5.4);
        ``"eighth"``, which energy l21 takes for cheaper-half, the cheapest, an eighth of the merges that are left.
    levels : sequence of int, or str, optional
        Hierarchies: numbers of clusters to stop at on the way and to optimise at until no move is left.
    device : {"auto", "cpu", "gpu"}
        Where to cluster; labels do not depend on it.
    adapter : str, optional
        Which gpu: its number, or a part of its name, as ``tesserae devices`` lists them.
    format : {"obj", "glb", "gltf", "ply", "stl", "off"}, optional
        Format of a file; by its name, then by its content when left out.
    max_faces : int, optional
        Largest number of faces that is accepted; 50,000,000 when left out.
    max_faces_per_byte : int, optional
        Files: largest number of faces for each byte of the mesh, beyond the first 524,288. Unlimited when left out.
    max_upload_bytes : int, optional
        Files: largest number of bytes, the mesh and its buffers together; 4 GiB when left out.
    progress : bool or callable
        True shows a bar on standard error (by tqdm, if that is installed). A callable gets every
        `tesserae_mesh.Iteration`, and of hierarchies every `tesserae_mesh.Level`, in the calling thread; an exception
        that it raises cancels.

    Returns
    -------
    Clustering
        Labels, energy, report, and, of pml, ml and hr, the hierarchy.

    Raises
    ------
    tesserae_mesh.Error
        A parameter is unknown or impossible (``kind`` is ``"invalid-parameter"``), the mesh cannot be clustered
        (``"invalid-mesh"``, ``"unsupported-mesh"``, ``"too-large"``), a file cannot be read (``"io"``; the error is an
        `OSError`, too), or the device does not exist or cannot take the mesh (``"device-unsuitable"``).
    KeyboardInterrupt
        Ctrl-C was pressed.

    Examples
    --------
    >>> import numpy as np, tesserae_mesh
    >>> points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    >>> clustering = tesserae_mesh.cluster(points, [[0, 1, 2], [0, 2, 3]], clusters=2)
    >>> clustering.labels
    array([0, 1], dtype=uint32)
    """
    if _is_number(faces):
        number = count(faces, "clusters")
        if clusters is not _CLUSTERS:
            raise Error("invalid-parameter", f"the number of clusters is given twice: {number} and {clusters}")
        clusters, faces = number, None
    file = os.fspath(points) if faces is None and isinstance(points, (str, os.PathLike)) else None
    listed = None if isinstance(seeds, str) else as_npy(seeds, "seeds", "iu")
    decides = algorithm in ("pml", "ml", "hr") or listed is not None or tolerance is not None
    if clusters is _CLUSTERS and decides:
        clusters = None
    job = _native.Job(
        as_json(
            algorithm=algorithm,
            energy=energy,
            shapes=shapes,
            resolution=resolution,
            tolerance=tolerance,
            clusters=clusters,
            quality=quality,
            seeds=seeds if isinstance(seeds, str) else "listed",
            seed=seed,
            max_iterations=max_iterations,
            refine=refine,
            allow_disconnected=allow_disconnected,
            bridge_components=bridge_components,
            features=features,
            snapshots=snapshots,
            curvature_exponent=curvature_exponent,
            weight_attribute=weight_attribute,
            optimize=optimize,
            optimize_iterations=optimize_iterations,
            switch_to_ml_at=switch_to_ml_at,
            collapse_fraction=collapse_fraction,
            ties=ties,
            pairs=pairs,
            levels=levels,
        ),
        listed,
        None if weights is None else as_npy(weights, "weights", "fiu"),
        str(device),
        None if adapter is None else str(adapter),
        count_if_given(max_faces, "max_faces"),
        count_if_given(max_faces_per_byte, "max_faces_per_byte"),
        count_if_given(max_upload_bytes, "max_upload_bytes"),
    )
    if file is not None:
        with Rows(progress) as rows:
            outcome = _native.cluster_file(str(file), format, job, rows.function)
        warn(outcome.warnings())
        return Clustering(outcome, None)
    if format is not None:
        raise Error("invalid-parameter", f"format goes with the name of a file, not with arrays: {format}")
    mesh = Mesh.of(points) if faces is None else Mesh(points, faces)  # type: ignore[arg-type]
    with Rows(progress) as rows:
        outcome = _native.cluster(mesh.points, mesh.connectivity, mesh.offsets, job, rows.function)
    warn(outcome.warnings())
    return Clustering(outcome, mesh)


def cluster_vertices(
    mesh: Mesh, clusters: int, weights: Optional[NDArray[np.float64]], **parameters: Any
) -> tuple[NDArray[np.int32], int]:
    """Cluster the points of triangles, for `tesserae_mesh.pyacvd`: one label a point, and the number of clusters.

    Points that no triangle uses have the label -1, those at one position the same. There are no more clusters than
    positions, and separate parts are joined where they are nearest if they are more than the clusters.
    """
    job = _native.Job(as_json(clusters=clusters, **parameters), None, None, "cpu", None, None, None, None)
    return _native.cluster_vertices(mesh.points, mesh.connectivity, weights, job)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)
