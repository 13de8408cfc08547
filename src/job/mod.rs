//! One job from bytes to results: what the command line and the service both do.
//!
//! Stages, so that the service can overlap them for neighbouring jobs: [`cluster`] belongs on the thread of the device;
//! what comes before ([`prepare()`]: parse, topology, seeds) and after ([`finish()`], and the encoding of results,
//! [`crate::artifacts`]) on the cpu pool.

mod divide;
mod finish;
mod flat;
mod format;
mod hierarchical;
mod iterations;
mod label_list;
mod on_device;
mod plan;
mod points;
mod prepare;
mod seed_list;
mod shapes;
mod spec;
mod subject;
mod watched;
mod weight_list;

pub use finish::{finish, labels_sha256};
pub use format::Format as InputFormat;
pub use label_list::parse as parse_labels;
pub use on_device::{Ahead, DeviceFor, OnDevice, instead_of_gpu, run_on};
pub use plan::{Coarse, Plan};
pub use points::{
    PointsInMemory, PointsRequest, check_head_of_graph, check_points, prepare_points, prepare_points_in_memory,
    table_of_points,
};
pub use prepare::{InMemory, prepare_in_memory, prepare_surface};
#[cfg(any(fuzzing, test))]
pub(crate) use seed_list::parse as parse_seeds;
pub use shapes::{RESOLUTION, Shaped, ShapesSpec};
pub use spec::{Clustering, CoarseSpec, JobSpec, Method};
pub use subject::{Planned, Points, Subject, Width};
pub use weight_list::check_head as check_head_of_weights;
#[cfg(any(fuzzing, test))]
pub(crate) use weight_list::parse as parse_weights;

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use crate::artifacts::{Artifact, Content, Labels, Need};
use crate::cluster::record::Record;
use crate::data::PointTable;
use crate::data::image;
use crate::device::{Cancel, Device};
use crate::error::{Error, Result};
use crate::hierarchy::Tree;
use crate::hierarchy::stored::Stored;
use crate::mesh::divide::Origin;
use crate::mesh::{self, Format, Limits, NoResources, PolygonMesh, ReadMesh, Resources};
use crate::parameters::Parameters;
use crate::report::{DeviceInfo, DeviceKind, Input, Iteration, Level, Report, Row, Timings, WeightedBy};

use self::prepare::{About, Checked};

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
    /// A file with one weight a face or vertex: `.npy` with floats.
    pub weights: Option<&'a [u8]>,
    /// What will be written of the job: the mesh is kept if one of these needs it.
    pub outputs: &'a [&'a Artifact],
}

impl<'a> Request<'a> {
    /// A mesh in one file within the default limits, without seeds, weights and outputs.
    pub fn new(bytes: &'a [u8], format: Format, parameters: &'a Parameters) -> Self {
        let limits = Limits::default();
        Self { bytes, format, resources: &NoResources, limits, parameters, seeds: None, weights: None, outputs: &[] }
    }
}

/// A mesh or points, ready to be clustered.
#[derive(Debug)]
pub struct Prepared {
    /// What is clustered: the lattice and the neighbours.
    pub subject: Subject,
    /// What the job does, with what the mesh decides filled in.
    pub spec: JobSpec,
    /// What was read, for the report.
    pub input: Input,
    /// What areas are multiplied by.
    pub weighted_by: Vec<WeightedBy>,
    /// What is unusual about it.
    pub warnings: Vec<String>,
    /// The mesh that is clustered, if an output needs it.
    pub mesh: Option<Arc<PolygonMesh>>,
    /// Whether an output needs the cluster table of points.
    pub wants_table: bool,
    /// Where its faces come from, if those that were read were divided.
    pub origin: Option<Arc<Origin>>,
    /// Sees labels while a device and moves of whole clusters work on them, if the caller set it.
    pub viewer: Option<Arc<dyn Viewer>>,
    /// What the stages so far took.
    pub timings: Timings,
}

/// Sees labels while a job is clustered.
pub trait Viewer: fmt::Debug + Send + Sync {
    /// Whether a phase is interrupted to show labels.
    fn watches(&self) -> bool;

    /// Whether labels are to be shown now.
    fn is_due(&self) -> bool;

    /// Shows labels, one a face of the upload.
    fn show(&self, labels: Vec<u32>);
}

/// What a job gives.
#[derive(Debug)]
pub struct Outcome {
    /// One label a face or item, in upload order, [`FREE`](crate::device::FREE) of an item that a mask leaves out; none
    /// for a whole hierarchy, which has labels at every number of clusters.
    pub labels: Option<Vec<u32>>,
    /// The hierarchy, of hierarchical algorithms.
    pub hierarchy: Option<Stored>,
    /// The shape of points, whose labels have it: that of their grid, or their number.
    pub shape: Option<Vec<usize>>,
    /// The labels of the requested iterations, in upload order; numbered as `labels`, so that a number means
    /// the same cluster in all of them.
    pub snapshots: Record,
    /// The mesh that was clustered, if an output needs it.
    pub mesh: Option<Arc<PolygonMesh>>,
    /// The cluster table of points, if an output needs it.
    pub table: Option<PointTable>,
    /// Where its faces come from, if those that were read were divided.
    pub origin: Option<Arc<Origin>>,
    /// The report; `timings_ms.read`, `.write` and `.total` are the caller's to fill.
    pub report: Report,
}

impl Outcome {
    /// What outputs are written from.
    pub fn content(&self) -> Content<'_> {
        Content {
            labels: self.labels.as_deref().map(|labels| Labels::new(self.report.clusters, labels)),
            shape: self.shape.as_deref(),
            snapshots: Some(&self.snapshots),
            hierarchy: self.hierarchy.as_ref(),
            report: Some(&self.report),
            mesh: self.mesh.as_deref(),
            points: self.table.as_ref(),
            compactness: compactness(&self.report),
            origin: self.origin.as_deref(),
            ..Content::default()
        }
    }
}

/// The compactness of an image; none of anything else.
fn compactness(report: &Report) -> Option<f64> {
    match &report.input {
        Input::Points(points) if points.format.is_some_and(|format| format.is_image()) => {
            Some(image::compactness(report.parameters.compactness))
        }
        _ => None,
    }
}

/// The file of a [`Request`] that an error is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputFile {
    /// The mesh, with its buffers, or the points.
    Mesh,
    /// The list of seeds.
    Seeds,
    /// The weights.
    Weights,
    /// The edges between points.
    Graph,
}

/// An error of [`prepare_naming_files`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The file it is about; none for errors of the parameters themselves.
    pub file: Option<InputFile>,
    /// What is wrong.
    pub error: Error,
}

impl Refusal {
    /// Makes a refusal of any error about a file.
    fn of(file: InputFile) -> impl Fn(Error) -> Refusal {
        move |error| Refusal { file: Some(file), error }
    }
}

impl From<Error> for Refusal {
    fn from(error: Error) -> Self {
        Refusal { file: None, error }
    }
}

/// Reads, checks and prepares a mesh. Needs no device.
pub fn prepare(request: &Request<'_>) -> Result<Prepared> {
    prepare_naming_files(request).map_err(|refusal| refusal.error)
}

/// As [`prepare()`], with errors that say which file they are about.
pub fn prepare_naming_files(request: &Request<'_>) -> Result<Prepared, Refusal> {
    open(request, |opened| opened.prepare())?
}

/// What the second half of [`prepare()`] does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preparing {
    /// Builds the mesh of its bytes.
    Mesh,
    /// Finds neighbours, components, the lattice.
    Surface,
    /// Finds where clusters start.
    Start,
}

/// A job whose mesh was opened ([`mesh::open`]).
pub struct Opened<'a> {
    mesh: mesh::Opened<'a>,
    checked: Checked,
    format: Format,
    limits: Limits,
    keeps_mesh: bool,
}

/// Checks the parameters, opens the mesh and calls `then` with it: the first half of [`prepare()`].
///
/// # Errors
/// What is wrong with the parameters or a file; then `then` is not called.
pub fn open<T>(request: &Request<'_>, then: impl FnOnce(Opened<'_>) -> T) -> Result<T, Refusal> {
    let checked = Checked::new(request.parameters, request.seeds, request.weights)?;
    let Request { bytes, format, resources, ref limits, .. } = *request;
    let attribute = checked.spec.weight_attribute.clone();
    let attribute = attribute.as_deref();
    let keeps_mesh = request.outputs.iter().any(|output| output.needs.contains(&Need::Mesh));
    let groups = checked.spec.features.is_some_and(|features| features.groups);
    mesh::open(mesh::Source { bytes, format, resources, limits, attribute, groups }, |mesh| {
        then(Opened { mesh, checked, format, limits: *limits, keeps_mesh })
    })
    .map_err(Refusal::of(InputFile::Mesh))
}

impl Opened<'_> {
    /// What the job does.
    pub fn spec(&self) -> &JobSpec {
        &self.checked.spec
    }

    /// Number of faces that memory is needed for.
    pub fn faces(&self) -> u64 {
        divide::faces(self.mesh.faces(), self.format, &self.checked.spec)
    }

    /// Builds the mesh and its surface: the second half of [`prepare()`]. May run on another thread than [`open`].
    pub fn prepare(self) -> Result<Prepared, Refusal> {
        self.prepare_telling(&mut |_| ())
    }

    /// As [`prepare`](Self::prepare). Calls `tell` with each step before it begins.
    pub fn prepare_telling(self, tell: &mut dyn FnMut(Preparing)) -> Result<Prepared, Refusal> {
        tell(Preparing::Mesh);
        let foreseen = self.faces();
        let Self { mesh, mut checked, limits, keeps_mesh, .. } = self;
        let ReadMesh { mut mesh, numbers: weights, mut groups } = mesh.read().map_err(Refusal::of(InputFile::Mesh))?;
        let origin = divide::divide(&mut mesh, &mut checked.spec, &limits, foreseen);
        let origin = origin.map_err(Refusal::of(InputFile::Mesh))?.map(Arc::new);
        let warnings = std::mem::take(&mut mesh.warnings);
        if let (Some(of_read), Some(origin)) = (&mut groups, &origin) {
            *of_read = (0..mesh.faces.len() as u32).map(|face| of_read[origin.face(face) as usize]).collect();
        }
        let (format, adjusted, parts) = (Some(mesh.format), mesh.adjusted, mesh.parts.clone());
        let about = About { format, adjusted, parts, weights, groups };
        tell(Preparing::Surface);
        let laid = checked.lay((&mesh).into(), about, warnings)?;
        // where no output needs the mesh, its memory is for the plan
        let mesh = keeps_mesh.then(|| Arc::new(mesh));
        tell(Preparing::Start);
        Ok(Prepared { mesh, origin, ..laid.plan()? })
    }
}

/// Clusters a prepared mesh, and finishes. Calls `on_row` with every row of the report as it comes.
pub fn run(
    prepared: &Prepared,
    device: &mut dyn Device,
    cancel: &Cancel,
    on_row: &mut (dyn FnMut(Row) + Send),
) -> Result<Outcome> {
    where_it_works(prepared, device.info().kind, || finish(prepared, cluster(prepared, device, cancel, on_row)?))
}

/// The part of a job that needs the device. `on_row` is called with every row of the report as it comes.
pub fn cluster(
    prepared: &Prepared,
    device: &mut dyn Device,
    cancel: &Cancel,
    on_row: &mut (dyn FnMut(Row) + Send),
) -> Result<Clustered> {
    cancel.check()?;
    where_it_works(prepared, device.info().kind, || prepared.subject.cluster(prepared, device, cancel, on_row))
}

/// Runs `work` for a device. The cpu works from within rayon's pool, the current one or else the global: each of
/// its many short parallel steps would otherwise wake the pool and wait for it, which took an eighth of a clustering's
/// time. A gpu is waited for outside, but for shapes, of which it does a part alone.
fn where_it_works<T: Send>(prepared: &Prepared, kind: DeviceKind, work: impl FnOnce() -> T + Send) -> T {
    match kind {
        DeviceKind::Gpu if !prepared.spec.energy.is_of_shapes() => work(),
        DeviceKind::Cpu | DeviceKind::Gpu => rayon::scope(|_| work()),
    }
}

/// What a device gave: labels as it numbers them, of faces in internal order. [`finish()`] makes the results of it.
#[derive(Debug)]
pub struct Clustered {
    device: DeviceInfo,
    /// One a face, below `clusters`.
    labels: Vec<u32>,
    clusters: usize,
    /// The labels after the growth, of flat clusterings.
    initial: Option<Vec<u32>>,
    tree: Option<Tree>,
    iterations: Vec<Iteration>,
    levels: Vec<Level>,
    snapshots: Record,
    /// The shapes of clusters, of energies that have them.
    shapes: Option<shapes::LastShapes>,
    warnings: Vec<String>,
    upload: Duration,
    cluster: Duration,
}

impl Clustered {
    /// The same with a warning more in its report.
    pub fn with_warning(mut self, warning: String) -> Self {
        self.warnings.push(warning);
        self
    }
}

/// JSON has no infinities.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// A duration in milliseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests;
