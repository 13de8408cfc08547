//! One job from bytes to results: what the command line and the service both do.
//!
//! Three stages, so that the service can overlap them for neighbouring jobs: [`prepare`] (parse, topology, seeds) and
//! the encoding of results ([`crate::output`]) belong on the cpu pool, [`run`] on the thread of the device.

mod seed_list;

use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};

use crate::cluster::flat::{Clustering, Options};
use crate::cluster::seeds::{self, SeedFaces};
use crate::cluster::{self, repair};
use crate::device::{Cancel, Device, Ending};
use crate::error::{Error, Kind, Result};
use crate::mesh::{self, Format, Limits, PolygonMesh, Resources};
use crate::parameters::{Algorithm, Parameters, Refine, Seeds};
use crate::report::{Energy, Input, Iteration, Report, Timings};
use crate::surface::Surface;

/// Everything that a job is made of.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// The bytes of the mesh.
    pub bytes: &'a [u8],
    /// Their format.
    pub format: Format,
    /// Where buffers that the mesh refers to come from.
    pub resources: &'a dyn Resources,
    /// What the mesh may cost.
    pub limits: Limits,
    /// What to do.
    pub parameters: &'a Parameters,
    /// A file that lists the seeds: face numbers of the upload, as `.npy`, a JSON array, or text.
    pub seeds: Option<&'a [u8]>,
}

/// A mesh that is ready to be clustered.
#[derive(Debug)]
pub struct Prepared {
    /// The lattice and the topology.
    pub surface: Surface,
    /// Where clusters start.
    pub seeds: SeedFaces,
    /// What was read, for the report.
    pub input: Input,
    /// Parameters with what the mesh decides filled in.
    pub parameters: Parameters,
    /// What is unusual about the mesh, for people.
    pub warnings: Vec<String>,
    /// What the stages so far took.
    pub timings: Timings,
}

/// Labels and what is said about them.
#[derive(Debug)]
pub struct Outcome {
    /// One label a face, in upload order.
    pub labels: Vec<u32>,
    /// The report; `timings_ms.read`, `.write` and `.total` are the caller's to fill.
    pub report: Report,
}

/// Reads, checks and prepares a mesh. Needs no device.
pub fn prepare(request: &Request<'_>) -> Result<Prepared> {
    let started = Instant::now();
    request.parameters.check(request.seeds.is_some())?;
    let listed = request.seeds.map(seed_list::parse).transpose()?;
    let mut parameters = request.parameters.clone();
    let clusters = match (&listed, parameters.clusters) {
        (Some(listed), Some(clusters)) if clusters != listed.len() as u64 => {
            return Err(Error::parameter(format_args!(
                "clusters and the number of listed seeds differ (leave clusters out): {clusters} and {}",
                listed.len()
            )));
        }
        (Some(listed), _) => listed.len() as u64,
        // `check` has seen that there is a number
        (None, clusters) => clusters.unwrap_or_default(),
    };
    parameters.clusters = Some(clusters);
    if listed.is_some() {
        parameters.seeds = Seeds::Listed;
    }

    let mesh = mesh::read(request.bytes, request.format, request.resources, &request.limits)?;
    let parsed = Instant::now();
    let surface = Surface::build(&mesh)?;
    let seeds = seeds::choose(&surface, clusters, &parameters.seeds, parameters.seed, listed.as_deref())?;
    let input = describe(&mesh, &surface);
    let mut warnings = mesh.warnings;
    if surface.counts.zero_area_faces > 0 {
        warnings.push(format!(
            "faces without area, which weigh as little as a face can: {}",
            surface.counts.zero_area_faces
        ));
    }
    let timings = Timings {
        parse: milliseconds(parsed - started),
        topology: milliseconds(parsed.elapsed()),
        ..Timings::default()
    };
    Ok(Prepared { surface, seeds, input, parameters, warnings, timings })
}

/// Clusters a prepared mesh. `on_iteration` is told of every row of the report as it comes.
pub fn run(
    prepared: &Prepared,
    device: &mut dyn Device,
    cancel: &Cancel,
    on_iteration: &mut dyn FnMut(&Iteration),
) -> Result<Outcome> {
    cancel.check()?;
    let Prepared { surface, seeds, parameters, .. } = prepared;
    let info = device.info().clone();
    let opened = Instant::now();
    let mut steps = device.open(surface, &seeds.component_of_cluster)?;
    let upload = opened.elapsed();

    let started = Instant::now();
    let mut iterations = Vec::new();
    let options = Options {
        max_iterations: parameters.max_iterations,
        refine: parameters.refine == Refine::On,
        allow_disconnected: parameters.allow_disconnected,
    };
    let mut on_row = |row: cluster::run::Row| {
        let row = Iteration {
            iteration: row.iteration,
            phase: row.phase,
            round: None,
            energy: finite(surface.energy(row.energy)),
            moves: row.moves,
            elapsed_us: started.elapsed().as_micros() as u64,
        };
        on_iteration(&row);
        iterations.push(row);
    };
    let clustering = match parameters.algorithm {
        Algorithm::Bb => cluster::flat::boundary_based(surface, seeds, options, steps.as_mut(), cancel, &mut on_row)?,
    };
    drop(steps);
    let clustered = Instant::now();

    let clusters = seeds.face_of_cluster.len();
    let initial = surface.source_energy(&clustering.initial, clusters);
    let final_ = surface.source_energy(&clustering.labels, clusters);
    let energy = Energy {
        functional: "cvd".to_owned(),
        initial: finite(initial),
        final_: finite(final_),
        hexagon_ratio: surface.hexagon_ratio(&clustering.labels, clusters),
    };
    let disconnected_clusters = repair::disconnected_clusters(surface, clusters, &clustering.labels);
    let labels = labels_of_upload(surface, &clustering.labels, clusters, parameters.seeds == Seeds::Listed)?;
    let timings_ms = Timings {
        upload: milliseconds(upload),
        cluster: milliseconds(clustered - started),
        download: milliseconds(clustered.elapsed()),
        ..prepared.timings
    };
    let report = Report {
        input: prepared.input.clone(),
        algorithm: parameters.algorithm,
        parameters: parameters.clone(),
        device: info,
        clusters: clusters as u64,
        disconnected_clusters,
        energy,
        iterations,
        timings_ms,
        labels_sha256: sha256(&labels),
        warnings: warnings(prepared, &clustering),
    };
    Ok(Outcome { labels, report })
}

/// What was read, for the report.
fn describe(mesh: &PolygonMesh, surface: &Surface) -> Input {
    let counts = surface.counts;
    Input {
        format: mesh.format,
        vertices: mesh.positions.len() as u64,
        faces: mesh.faces.len() as u64,
        triangles: mesh.faces.triangles(),
        welded_vertices: counts.welded_vertices,
        components: counts.components,
        boundary_edges: counts.boundary_edges,
        non_manifold_edges: counts.non_manifold_edges,
        degenerate_faces: counts.degenerate_faces,
        duplicate_faces: counts.duplicate_faces,
        parts: mesh.parts.clone(),
    }
}

/// Labels in upload order: those of listed seeds keep their numbers, others are numbered by the first face that
/// carries them. Checks that every cluster has a face.
fn labels_of_upload(surface: &Surface, internal: &[u32], clusters: usize, keep_numbers: bool) -> Result<Vec<u32>> {
    let mut labels = vec![0; internal.len()];
    for (&face, &label) in surface.upload_face.iter().zip(internal) {
        labels[face as usize] = label;
    }
    let mut number_of_cluster: Vec<Option<u32>> = vec![None; clusters];
    let mut seen = 0;
    for label in &mut labels {
        let number = number_of_cluster[*label as usize].get_or_insert_with(|| {
            let number = if keep_numbers { *label } else { seen };
            seen += 1;
            number
        });
        *label = *number;
    }
    if seen as usize != clusters {
        return Err(Error::new(Kind::Internal, format_args!("{seen} of {clusters} clusters have faces")));
    }
    Ok(labels)
}

/// SHA-256 of labels as u32 little-endian, lower-case hexadecimal.
fn sha256(labels: &[u32]) -> String {
    let mut hash = Sha256::new();
    let mut bytes = Vec::with_capacity(4 * 16_384);
    for chunk in labels.chunks(16_384) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|label| label.to_le_bytes()));
        hash.update(&bytes);
    }
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What is unusual about mesh and run.
fn warnings(prepared: &Prepared, clustering: &Clustering) -> Vec<String> {
    let mut warnings = prepared.warnings.clone();
    if clustering.ending == Ending::IterationLimit {
        let limit = prepared.parameters.max_iterations.unwrap_or(u32::MAX);
        warnings.push(format!("stopped by max_iterations, maybe before it had converged: {limit}"));
    }
    warnings
}

/// JSON has no infinities.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// A duration in milliseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}
