"""The JSON documents of the service, as types.

``openapi.yaml`` says what their members mean, and a test compares the two. Lengths, areas and energies are in the units
of the mesh (an energy is area x length squared). A number that overflows is ``None``.
"""

from __future__ import annotations

from typing import Any, Literal, TypedDict, Union

State = Literal["queued", "running", "succeeded", "failed", "cancelled"]
Algorithm = Literal["bb", "pml", "ml", "hr", "acvd", "vc"]
Format = Literal["obj", "glb", "gltf", "ply", "stl", "off"]
PointsFormat = Literal["npy", "npz", "png", "jpeg"]
InputFormat = Union[Format, PointsFormat]
Phase = Literal[
    "boundary",
    "refine",
    "refit",
    "merge",
    "repair",
    "regrow",
    "swap",
    "merged-start",
    "fast-start",
    "settled-start",
    "other-job",
    "trial",
    "breathe",
]
DeviceKind = Literal["cpu", "gpu"]
WeightedBy = Literal["weights", "attribute", "curvature"]


class Problem(TypedDict):
    """What went wrong (RFC 9457)."""

    type: str
    title: str
    status: int
    detail: str
    instance: str


class Progress(TypedDict):
    """How far a job is."""

    iterations: int
    phase: Phase | None
    rounds: int
    clusters_left: int | None
    energy: float | None


class ResultSummary(TypedDict):
    """What a job gave."""

    faces: int
    clusters: int


class UploadedMesh(TypedDict):
    """What was uploaded."""

    file_name: str | None
    format: InputFormat
    bytes: int
    buffers: list[str]


class JobDocument(TypedDict):
    """A job: where it is in its life, and what it was asked to do."""

    id: str
    state: State
    queue_position: int | None
    priority: int
    attempt: int
    worker: str | None
    progress: Progress
    cancel_requested: bool
    problem: Problem | None
    result: ResultSummary | None
    parameters: dict[str, Any]
    mesh: UploadedMesh
    created_at: str
    started_at: str | None
    ended_at: str | None
    expires_at: str | None
    outputs: list[str]
    keep_mesh: bool
    urls: dict[str, str | None]


class JobList(TypedDict):
    """A page of jobs."""

    jobs: list[JobDocument]
    next: str | None


class _StateEvent(TypedDict):
    state: State


class StateEvent(_StateEvent, total=False):
    """Data of the event ``state``."""

    attempt: int
    worker: str


class EndEvent(TypedDict):
    """Data of the event ``end``."""

    state: State
    problem: Problem | None


class Part(TypedDict):
    """A run of consecutive faces with a common origin."""

    node: int | None
    mesh: int | None
    primitive: int | None
    instance: int | None
    group: str | None
    first_face: int
    faces: int


class Input(TypedDict):
    """What was read."""

    format: Format
    vertices: int
    faces: int
    triangles: int
    welded_vertices: int
    joined_across_parts: int
    components: int
    boundary_edges: int
    non_manifold_edges: int
    degenerate_faces: int
    loose_faces: int
    duplicate_faces: int
    feature_edges: int
    parts: list[Part]


class PointsInput(TypedDict):
    """Points that were read."""

    format: PointsFormat
    items: int
    masked: int
    dimensions: int
    shape: list[int]
    edges: int
    components: int
    graph: str
    lattice_unit: float


class DeviceInfo(TypedDict):
    """The device that ran a job."""

    kind: DeviceKind
    name: str
    backend: str
    driver: str


class Energy(TypedDict):
    """Energies, in source units: area × length², of l21 area; of points, weight × squared units of the columns."""

    functional: str
    weighted_by: list[WeightedBy]
    initial: float | None
    final: float | None
    total: float | None
    explained: float | None
    hexagon_ratio: float | None
    l21: float | None


class Iteration(TypedDict):
    """One iteration of an optimisation."""

    iteration: int
    phase: Phase
    round: int | None
    energy: float | None
    moves: int
    elapsed_us: int


class Level(TypedDict):
    """A round of a hierarchy, or several, each of which merged little."""

    round: int
    clusters: int
    energy: float | None
    merges: int
    moves: int


class Timings(TypedDict):
    """Durations of the stages, in milliseconds."""

    read: float
    parse: float
    topology: float
    upload: float
    cluster: float
    download: float
    write: float
    total: float


class VertexCounts(TypedDict):
    """Numbers of vertices by kind."""

    clusters: int
    split: int
    boundary: int
    extra: int


class RemeshSummary(TypedDict):
    """What a report says about a remesh."""

    placement: str
    vertices: VertexCounts
    triangles: int
    euler: int
    loops: int
    components: int
    cut_edges: int
    flipped: int
    checked: bool


class Deviation(TypedDict):
    """How far faces are from a shape."""

    rms: float
    max: float


class Plane(TypedDict):
    """A plane."""

    point: list[float]
    normal: list[float]


class Sphere(TypedDict):
    """A sphere."""

    centre: list[float]
    radius: float
    convex: bool


class Cylinder(TypedDict):
    """A cylinder; the extent is along the axis from the point, the angle in degrees."""

    point: list[float]
    axis: list[float]
    radius: float
    convex: bool
    extent: list[float]
    angle: float


class Cone(TypedDict):
    """A cone; the axis is from the apex into it, the extent is along the axis from the apex, angles are in degrees, and
    the half angle is half the opening angle."""

    apex: list[float]
    axis: list[float]
    half_angle: float
    convex: bool
    extent: list[float]
    angle: float


class Torus(TypedDict):
    """A torus of which a cluster is a slice: the major radius is that of the circle in the middle of its tube."""

    centre: list[float]
    axis: list[float]
    major_radius: float
    minor_radius: float
    convex: bool
    residual: Deviation


class Neighbour(TypedDict):
    """A cluster beside another: length of the border, and angle in degrees by which the surface bends there."""

    label: int
    length: float
    angle: float


# a member is named type
ClusterShape = TypedDict(
    "ClusterShape",
    {
        "label": int,
        "type": Literal["plane", "sphere", "cylinder", "cone"],
        "faces": int,
        "area": float,
        "residual": Deviation,
        "normal_deviation": Deviation,
        "plane": Plane,
        "sphere": Sphere,
        "cylinder": Cylinder,
        "cone": Cone,
        "torus": Torus,
        "neighbours": list[Neighbour],
    },
    total=False,
)


class ReportedTolerance(TypedDict):
    """A tolerance, and how much of it was needed."""

    asked: float | str
    length: float
    largest: float


class Report(TypedDict):
    """Everything that is known about an ended clustering."""

    input: Input | PointsInput
    algorithm: Algorithm
    parameters: dict[str, Any]
    device: DeviceInfo
    clusters: int
    disconnected_clusters: int
    feature_edges_inside: int
    energy: Energy
    shapes: list[ClusterShape] | None
    tolerance: ReportedTolerance | None
    iterations: list[Iteration]
    levels: list[Level]
    timings_ms: Timings
    labels_sha256: str | None
    snapshots: list[int]
    remesh: RemeshSummary | None
    warnings: list[str]


class _Node(TypedDict):
    id: int
    children: list[int]
    round: int
    clusters_left: int
    cost: float | None
    energy: float | None
    faces: int
    weight: float | None
    proxy: list[float]


class Node(_Node, total=False):
    """Two clusters that became one."""

    type: Literal["plane", "sphere", "cylinder", "cone"]


class CutNodes(TypedDict):
    """The clusters of a cut as nodes of the tree, in the order of their labels."""

    nodes: list[int]
    parents: list[int | None]


class HierarchyDocument(TypedDict):
    """A hierarchy as JSON."""

    algorithm: str
    parameters: dict[str, Any]
    faces: int
    levels: list[Level]
    nodes: list[Node]
    roots: list[int]
    cut: CutNodes | None


class Cluster(TypedDict):
    """A row of the cluster table."""

    cluster: int
    faces: int
    area: float
    perimeter: float
    centroid: list[float] | None
    normal: list[float] | None
    normal_cone: float | None
    bbox: list[list[float]] | None
    roundness: float | None
    planarity: float | None
    euler: int
    neighbours: int
    component: int | None
    open: bool
    energy: float


class ClusterTable(TypedDict):
    """The cluster table as JSON."""

    tesserae: int
    clusters: list[Cluster]


class Junction(TypedDict):
    """A point at which curves meet."""

    point: int
    clusters: list[int]


class Curve(TypedDict):
    """A curve between two clusters, or of the boundary of one."""

    left: int
    right: int | None
    points: list[int]
    start: int | None
    end: int | None
    closed: bool
    length: float


class Boundaries(TypedDict):
    """The curves between clusters and along the boundary, and the points where they meet."""

    tesserae: int
    points: list[list[float]]
    point_vertices: list[int]
    junctions: list[Junction]
    curves: list[Curve]


class PointCluster(TypedDict):
    """A row of the cluster table of points."""

    cluster: int
    items: int
    weight: float | None
    energy: float | None
    neighbours: int
    component: int
    mean: list[float | None]


class PointClusterEdge(TypedDict):
    """Two clusters of points that are neighbours."""

    source: int
    target: int
    pairs: int


class Edge(TypedDict):
    """Two clusters that have a curve between them."""

    source: int
    target: int
    length: float
    arcs: int


class GraphNode(Cluster):
    """A cluster as a node of a graph."""

    id: int


class Graph(TypedDict):
    """A graph as networkx reads it: ``networkx.node_link_graph``."""

    tesserae: int
    directed: bool
    multigraph: bool
    nodes: list[GraphNode]
    edges: list[Edge]


class LargestMeshes(TypedDict):
    """The largest meshes that fit on an adapter, in faces."""

    flat: int
    hierarchy: int


class AdapterReport(TypedDict):
    """A graphics adapter that a service looked at."""

    index: int
    name: str
    kind: Literal["discrete", "integrated", "virtual", "other", "software"]
    backend: str
    driver: str
    usable: bool
    reason: str | None
    largest: LargestMeshes


class DeviceDescription(DeviceInfo):
    """The device of a service and why it is that one."""

    chosen: str
    cpu_below_faces: int | None
    adapters: list[AdapterReport]


class Worker(TypedDict):
    """A process that works on jobs."""

    id: str
    name: str
    version: str
    device: str | None
    started_at: str
    seen_at: str
    jobs: list[str]


class WorkerList(TypedDict):
    """The workers."""

    workers: list[Worker]


class FormatInfo(TypedDict):
    """A format."""

    name: str
    media_type: str


class Formats(TypedDict):
    """Formats that are read and written."""

    meshes: list[FormatInfo]
    points: list[FormatInfo]
    labels: list[FormatInfo]


class MeshLimits(TypedDict):
    """What a mesh may be."""

    max_upload_bytes: int
    max_faces: int


class Version(TypedDict):
    """The version of the service."""

    name: str
    version: str


class Health(TypedDict):
    """That the process answers."""

    status: str


class Condition(TypedDict):
    """What is wrong with a part."""

    part: str
    severity: str
    detail: str


class Readiness(TypedDict):
    """That jobs are taken."""

    status: str
    conditions: list[Condition]
