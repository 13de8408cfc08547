//! The report of a job: the JSON of `--report` and `GET /v1/jobs/{id}/report`, and the rows of the event stream.

use serde::Serialize;
use utoipa::ToSchema;

pub use crate::cluster::run::Phase;
use crate::data::Format as PointsFormat;
pub use crate::device::{DeviceInfo, DeviceKind};
pub use crate::hierarchy::Level;
use crate::mesh::{Format, Part};
use crate::parameters::{Algorithm, Length, Parameters};
pub use crate::remesh::Summary;
use crate::shapes::table::ClusterShape;

/// Everything that is known about an ended clustering.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Report {
    /// What was read.
    pub input: Input,
    /// The algorithm that ran.
    pub algorithm: Algorithm,
    /// The parameters it ran with, defaults filled in.
    pub parameters: Parameters,
    /// Where it ran.
    pub device: DeviceInfo,
    /// Number of clusters, none of them empty; of a whole hierarchy, that of its roots.
    pub clusters: u64,
    /// Clusters that are in several pieces across shared edges; counted on the final labels. An edge of more than two
    /// faces connects them as a chain, in the order of their numbers: each with the one before and the one after.
    pub disconnected_clusters: u64,
    /// Feature edges with one cluster on both sides, of the final labels: those of lines that end inside a region.
    pub feature_edges_inside: u64,
    /// The energy before and after.
    pub energy: Energy,
    /// The shapes of the clusters, one a label; null for energies without shapes.
    pub shapes: Option<Vec<ClusterShape>>,
    /// How far corners are from these shapes, of a clustering within a tolerance; null otherwise.
    pub tolerance: Option<Tolerance>,
    /// One row an iteration; of hierarchies, the iterations of parallel rounds and at levels. Row 0 of a flat
    /// clustering is its start, and the only one where no face moves: that is 0 iterations. From 10,000 rows on,
    /// iterations of a phase that are less than a thousandth of those so far share a row: the number, energy and time
    /// of the last of them, and the moves of all.
    pub iterations: Vec<Iteration>,
    /// Hierarchies: the energy against the number of clusters, one row a round; empty for flat clusterings. Above
    /// 10,000 clusters, rounds that merge less than a thousandth of the clusters share a row.
    pub levels: Vec<Level>,
    /// Where the time went.
    pub timings_ms: Timings,
    /// SHA-256 of the labels as u32 little-endian, in upload order; lower-case hexadecimal. Null for a whole hierarchy,
    /// which has no labels of its own.
    pub labels_sha256: Option<String>,
    /// The iterations whose labels were kept, ascending.
    pub snapshots: Vec<u32>,
    /// What was checked of the remesh; null where none was made with the job.
    pub remesh: Option<Summary>,
    /// What is unusual about the mesh or the run.
    pub warnings: Vec<String>,
}

/// What was read.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum Input {
    /// A mesh.
    Mesh(MeshInput),
    /// Points with neighbours.
    Points(PointsInput),
}

impl Input {
    /// Faces of the mesh, or items.
    pub fn items(&self) -> u64 {
        match self {
            Self::Mesh(mesh) => mesh.faces,
            Self::Points(points) => points.items,
        }
    }

    /// Connected components.
    pub fn components(&self) -> u64 {
        match self {
            Self::Mesh(mesh) => mesh.components,
            Self::Points(points) => points.components,
        }
    }
}

/// Points that were read.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct PointsInput {
    /// The format of the upload. Null for points that were in memory, as in Python.
    #[schema(value_type = PointsFormat)]
    pub format: Option<PointsFormat>,
    /// Items; each has a label, unless a mask leaves it out.
    pub items: u64,
    /// Items that a mask leaves out.
    pub masked: u64,
    /// Coordinates of an item.
    pub dimensions: u64,
    /// Shape of the items: that of the grid, or their number.
    pub shape: Vec<u64>,
    /// Pairs of neighbours.
    pub edges: u64,
    /// Sets of items that neighbours connect.
    pub components: u64,
    /// What makes items neighbours: `knn:Q`, `grid`, `grid:full` or `edges`.
    pub graph: String,
    /// Coordinates are rounded to multiples of this.
    pub lattice_unit: f64,
}

/// A mesh that was read.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct MeshInput {
    /// The format of the upload. Null for a mesh that was in memory, as in Python.
    #[schema(value_type = Format)]
    pub format: Option<Format>,
    /// Vertices stored in the upload, those that no face uses included (glTF: every placement counts).
    pub vertices: u64,
    /// Faces; each has a label.
    pub faces: u64,
    /// Triangles of the fans that the faces are cut into.
    pub triangles: u64,
    /// Distinct positions among the vertices that faces use.
    pub welded_vertices: u64,
    /// glTF: vertices that were moved to a vertex of another part, from which only rounding kept them apart: parts with
    /// different transforms meet there. 0 for other formats.
    pub joined_across_parts: u64,
    /// Sets of faces connected across shared edges that are no feature edges, loose faces aside.
    pub components: u64,
    /// Edges of exactly one face. A face that runs along an edge several times counts once for an odd number of times
    /// and not at all for an even one: there and back, as at the slit of a polygon with a hole, it has itself on both
    /// sides.
    pub boundary_edges: u64,
    /// Edges of more than two faces, counted in the same way.
    pub non_manifold_edges: u64,
    /// Faces with two corners at one position. Others may have no area, too: where there are any, a warning says how
    /// many.
    pub degenerate_faces: u64,
    /// Faces without area that shared edges connect with no face that has area. They take no cluster: each has the
    /// label of a face at one of its vertices, else of one whose centroid is near.
    pub loose_faces: u64,
    /// Faces whose set of corner positions an earlier face has; extra copies only.
    pub duplicate_faces: u64,
    /// Edges that clusters do not cross (`features`); of an edge of more than two faces, each two that it would connect
    /// count.
    pub feature_edges: u64,
    /// Where runs of faces come from.
    pub parts: Vec<Part>,
}

/// Energies, in source units: area × length², of l21 area.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Energy {
    /// Name of the energy functional: `cvd`, the sum over faces of area × squared distance between the face's centroid
    /// and its cluster's (centroidal Voronoi diagram), or `l21`, the same of unit normals.
    pub functional: String,
    /// What areas are multiplied by, in these energies and wherever faces are weighed; empty where area alone counts.
    pub weighted_by: Vec<WeightedBy>,
    /// After the initial growth; f64 from the source positions. Null when it overflows, and for hierarchies, which
    /// start with every face a cluster.
    pub initial: Option<f64>,
    /// Of the final labels; f64 from the source positions. Null when it overflows.
    #[serde(rename = "final")]
    #[schema(rename = "final")]
    pub final_: Option<f64>,
    /// With one cluster. Of points alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total: Option<f64>,
    /// The part of `total` that the clusters explain: 1 − `final`/`total`. Of points alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub explained: Option<f64>,
    /// `final` over the energy of a flat tiling by regular hexagons with as many clusters, less what lies inside the
    /// faces; null where that difference leaves less than half of the tiling's energy, and where `weighted_by` is not
    /// empty, and of `l21`.
    pub hexagon_ratio: Option<f64>,
    /// L2,1 of the final labels: the sum over faces of area × squared distance between the unit normal and the
    /// direction of its cluster's mean normal, over the squared diagonal of the bounding box (Cohen-Steiner et al.
    /// 2004). Null for cvd.
    pub l21: Option<f64>,
}

/// A tolerance, and how much of it was needed. Loose faces do not count.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
#[schema(as = ReportedTolerance)]
pub struct Tolerance {
    /// As it was given.
    pub asked: Length,
    /// In units of the file.
    pub length: f64,
    /// The largest distance of a corner from the shape of its cluster, in units of the file: at most `length`, unless a
    /// warning counts faces that bend by more.
    pub largest: f64,
}

/// What areas are multiplied by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum WeightedBy {
    /// Weights that came with the mesh, one a face or vertex.
    Weights,
    /// An attribute of the mesh.
    Attribute,
    /// A power of the curvature over its root mean square.
    Curvature,
}

/// One iteration of an optimisation.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Iteration {
    /// 0 is the state after the initial growth; then counted through all phases.
    pub iteration: u32,
    /// What kind of step it was.
    pub phase: Phase,
    /// Hierarchies: the round of merges it belongs to; null for flat clusterings.
    pub round: Option<u32>,
    /// Energy of the labels after it, source units: of cluster centres rounded to the lattice that decides the labels,
    /// so it may differ from `energy` of the report in the last digits. It never rises within a phase, except `repair`.
    /// Null when it overflows.
    pub energy: Option<f64>,
    /// Faces that changed their cluster. From iteration 256 of a boundary phase on, an iteration has several passes,
    /// and a face counts once for each in which it did.
    pub moves: u64,
    /// Time since the clustering began, in microseconds. On a gpu, when the batch it was in came back.
    pub elapsed_us: u64,
}

/// What a running job tells of as it happens, and its report keeps.
#[derive(Debug, Clone, PartialEq)]
pub enum Row {
    /// A row of `iterations`.
    Iteration(Iteration),
    /// A row of `levels`.
    Round(Level),
}

/// Durations of the stages, in milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, ToSchema)]
pub struct Timings {
    /// Getting the bytes.
    pub read: f64,
    /// From bytes to faces and positions.
    pub parse: f64,
    /// Welding, adjacency, components, lattice, order.
    pub topology: f64,
    /// Bringing the mesh to the device, apart from what was brought while it worked on another.
    pub upload: f64,
    /// Growth, optimisation and repair.
    pub cluster: f64,
    /// Bringing the labels back and into upload order, energies from source positions.
    pub download: f64,
    /// Writing results.
    pub write: f64,
    /// From the first byte to the last.
    pub total: f64,
}
