"""The keywords of `Client.submit`.

Names and meanings are those of the flags of ``tesserae cluster``, with underscores. What is left out has the service's
default, so a client need not know it.
"""

from __future__ import annotations

import os
from typing import IO, TYPE_CHECKING, Any, Literal, Mapping, Sequence, TypedDict, Union

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from tesserae_mesh._mesh import FacesLike, MeshLike
    from tesserae_mesh.client.documents import Algorithm, InputFormat

Source = Union[str, "os.PathLike[str]", bytes, IO[bytes]]
"""A file: its name, its bytes, or an open binary file that can be rewound."""


MeshSource = Union[Source, "MeshLike", "tuple[ArrayLike, FacesLike]", "NDArray[Any]"]
"""A mesh: a file, a mesh in memory, points and faces as a tuple, or the URL ``s3://…`` of one in a bucket.

Or points with neighbours: a file with an array or an image, or an array of items × columns.
"""


class Parameters(TypedDict, total=False):
    """What a job is asked to do: the members of the part ``parameters`` of an upload."""

    #: How to cluster: ``"bb"``, ``"acvd"``, ``"vc"`` make flat clusters, ``"pml"``, ``"ml"``, ``"hr"`` a hierarchy.
    algorithm: Algorithm
    #: What clusters have little of: distance from their mean place, their mean normal, a plane, or a shape.
    energy: Literal["cvd", "l21", "planes", "shapes"]
    #: Energy ``"shapes"``: types that clusters may have, of ``"plane,sphere,cylinder,cone"``.
    shapes: str
    #: Energy ``"shapes"``: distances below it are noise; a share of the diagonal, or a length as ``"0.5u"``.
    resolution: float | str
    #: Energies ``"planes"`` and ``"shapes"``, in place of ``clusters``: how far corners may be from the shapes of their
    #: clusters; a share of the diagonal, or a length as ``"0.5u"``.
    tolerance: float | str
    #: Number of clusters. May be left out with listed ``seeds`` or a ``tolerance``, and for hierarchies, which
    #: then go to the top.
    clusters: int
    #: How much time to take for how low an energy.
    quality: Literal["fast", "default", "best"]
    #: Where flat clusters start; or a face number for each cluster, which is uploaded.
    seeds: Literal["coarse", "merged", "morton", "random"] | Sequence[int] | NDArray[np.integer[Any]]
    #: Number that the random choices of seeds are drawn from.
    seed: int
    #: Stop a flat clustering after this many iterations, without moves of whole clusters.
    max_iterations: int
    #: Whether to refine by exact gains.
    refine: Literal["on", "none"]
    #: Accept clusters in several pieces.
    allow_disconnected: bool
    #: Join separate parts where they are nearest.
    bridge_components: bool
    #: Do not let clusters cross edges sharper than this angle in degrees, or borders of groups: ``40``, ``"groups"``,
    #: ``"40,groups"``.
    features: float | str
    #: Keep the labels of every N-th iteration, or of the listed ones.
    snapshots: int | Sequence[int]
    #: Divide every triangle into four, this many times or until there are 30 faces a cluster: for remeshes.
    subdivide: int | Literal["auto"]
    #: Multiply areas by curvature to this power, 0 to 10: smaller clusters where the surface bends.
    curvature_exponent: float
    #: glTF: multiply areas by this attribute of the vertices.
    weight_attribute: str
    #: Points: which items are neighbours, ``"knn:Q"``, ``"grid"`` or ``"grid:full"``; or a sparse matrix of scipy.
    graph: Any
    #: Images: how much the place of a pixel counts beside its colour.
    compactness: float
    #: Hierarchies: whether to optimise between merges.
    optimize: Literal["on", "none"]
    #: Hierarchies: at most this many iterations in a round that is optimised.
    optimize_iterations: int
    #: ``"pml"``: one merge a step once this many clusters are left.
    switch_to_ml_at: int
    #: Merge this percentage of the clusters a step, above 0 and at most 50.
    collapse_fraction: float
    #: Hierarchies: which of equally cheap pairs merges first.
    ties: Literal["hash", "largest-id"]
    #: ``"pml"``: which of the pairs that chose each other merge in a round.
    pairs: Literal["cheaper-half", "all", "eighth"]
    #: Hierarchies: numbers of clusters to stop and to optimise at.
    levels: Sequence[int]
    #: Of your waiting jobs, those with a higher priority start first: -100 to 100.
    priority: int
    #: Files to make of the mesh with the result, such as ``["mesh.glb", "remesh"]``.
    outputs: Sequence[str]
    #: Keep the mesh or the image with the result, so that every output can be made of it later.
    keep_mesh: bool
    #: URL that the service calls at the end of the job.
    webhook: str


class SubmitOptions(Parameters, total=False):
    """What comes with a mesh: its parameters, its other files, and how the request is made."""

    #: A number above 0 for each face or each vertex that areas are multiplied by: smaller clusters where it is larger.
    #: Of points, one for each item.
    weights: NDArray[Any] | Sequence[float]
    #: Buffers that a ``.gltf`` refers to, by URI. Those beside a ``.gltf`` that is given by its name are found.
    buffers: Mapping[str, Source]
    #: Format of a file, where neither name nor content tells.
    format: InputFormat
    #: Name of a mesh that has none, for lists of jobs.
    file_name: str
    #: Seconds that the service waits for the end of the job before it answers.
    wait: float
    #: The same key and request give the same job; a new key each time when left out.
    idempotency_key: str
