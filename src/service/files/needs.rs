//! How many bytes the result of a job takes: estimated from the faces that its upload claims or from its bytes, then
//! from its faces, then counted.
//!
//! | | bytes |
//! |---|---|
//! | labels | 4 a face |
//! | snapshots | 4 a face and iteration that is kept |
//! | hierarchy | 60 a merge, 8 a move, 32 a round, and checkpoints of half of the merges and moves before them |
//! | outputs made of the mesh, kept mesh | [`OUTPUT`] each and [`KEPT_MESH`] a face |
//! | report and events | [`FIXED`] |
//!
//! For hierarchies the estimate is [`HIERARCHY`] or, with a pair a round, [`SEQUENTIAL`] bytes a face.

use crate::job::Outcome;
use crate::mesh::Limits;
use crate::parameters::{Algorithm, Parameters, Snapshots};
use crate::service::kept::Kept;
use crate::service::kept_mesh;
use crate::service::store::{SMALL_BLOBS, Spec};

/// Bytes of a job's report, its events and its row in the store.
const FIXED: u64 = 32 << 10;

/// Bytes of a job that is kept in the store, at most: upload, result, and its row.
pub(super) const SMALL_JOB: u64 = 2 * SMALL_BLOBS + FIXED;

/// Bytes of an iteration, a round or a part in the report and in the store of jobs.
const ROW: u64 = 512;

/// Bytes of the labels of a face.
const LABEL: u64 = 4;

/// Bytes of a face in a hierarchy whose rounds merge many pairs. `pml` with optimisation took 99 for 100,000 faces.
const HIERARCHY: u64 = 128;

/// Bytes of a face in a hierarchy whose rounds merge one pair.
const SEQUENTIAL: u64 = HIERARCHY + 32;

/// Bytes of a face in a kept mesh: a triangle, and half a vertex in double precision.
const KEPT_MESH: u64 = 24;

/// Bytes of a face in an output that is made of the mesh. The largest, a GLB of clusters of few faces, has a vertex a
/// corner.
const OUTPUT: u64 = 72;

/// Iterations that are expected where there is no limit.
const ITERATIONS: u64 = 64;

/// Bytes of all snapshots of a job, at most: see `cluster::record`.
const SNAPSHOTS: u64 = 512 << 20;

/// What the result of a job is expected to take, whose upload has so many bytes.
pub(super) fn of_upload(spec: &Spec, upload: u64, limits: &Limits) -> u64 {
    let faces = spec.claimed_faces.unwrap_or_else(|| upload / spec.format.least_bytes_a_face());
    let faces = faces.min(limits.most_faces(upload));
    of_faces(&spec.parameters, faces).saturating_add(of_kept(&spec.kept, faces))
}

/// What is expected to be kept of a mesh with so many faces.
pub(in crate::service) fn of_kept(kept: &Kept, faces: u64) -> u64 {
    let a_face = OUTPUT * kept.outputs.len() as u64 + if kept.mesh { KEPT_MESH } else { 0 };
    faces.saturating_mul(a_face)
}

/// What the result of a job is expected to take, whose mesh has so many faces.
pub(in crate::service) fn of_faces(parameters: &Parameters, faces: u64) -> u64 {
    let a_face = match parameters.algorithm {
        Algorithm::Bb | Algorithm::Acvd | Algorithm::Vc => LABEL,
        Algorithm::Pml => HIERARCHY + LABEL,
        Algorithm::Ml | Algorithm::Hr => SEQUENTIAL + LABEL,
    };
    let kept = match &parameters.snapshots {
        None => 0,
        Some(Snapshots::At(list)) => list.len() as u64,
        Some(Snapshots::Every(step)) => parameters.max_iterations.map_or(ITERATIONS, u64::from) / u64::from(*step) + 1,
    };
    let snapshots = faces.saturating_mul(LABEL * kept).min(SNAPSHOTS);
    faces.saturating_mul(a_face).saturating_add(snapshots).saturating_add(FIXED)
}

/// What a result takes. The report and what is kept of the mesh are estimated from above.
pub(in crate::service) fn of_result(outcome: &Outcome, kept: &Kept) -> u64 {
    let Outcome { labels, hierarchy, report, mesh, .. } = outcome;
    let outputs = of_kept(&Kept { mesh: false, ..kept.clone() }, report.input.triangles);
    let mesh = mesh.as_ref().filter(|_| kept.mesh).map_or(0, |mesh| kept_mesh::most_bytes(mesh));
    let labels = labels.as_ref().map_or(0, |labels| labels.len() as u64 * LABEL);
    let snapshots = report.snapshots.len() as u64 * report.input.faces * LABEL;
    let hierarchy = hierarchy.as_ref().map_or(0, |hierarchy| hierarchy.bytes());
    let rows = report.iterations.len() + report.levels.len() + report.snapshots.len() + report.input.parts.len();
    let names: usize = report.input.parts.iter().filter_map(|part| part.group.as_ref()).map(|name| name.len()).sum();
    labels + snapshots + hierarchy + outputs + mesh + rows as u64 * ROW + 2 * names as u64 + FIXED
}
