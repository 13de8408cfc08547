//! One job from bytes to results: what the command line and the service both do.
//!
//! Three stages, so that the service can overlap them for neighbouring jobs: [`prepare`] (read, parse, topology) and
//! encoding belong on the cpu pool, [`run`] on the thread of the device.

use crate::device::{Cancel, Device};
use crate::error::Result;
use crate::mesh::{Format, Limits, Resources};
use crate::parameters::Parameters;
use crate::report::{Input, Iteration, Report, Timings};
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
    /// Listed seeds as a file ([`crate::output`] has no part in it): `.npy` of integers, JSON array, or numbers in text.
    pub seeds: Option<&'a [u8]>,
}

/// A mesh that is ready to be clustered.
#[derive(Debug)]
pub struct Prepared {
    /// The lattice and the topology.
    pub surface: Surface,
    /// What was read, for the report.
    pub input: Input,
    /// Parameters with what the mesh decides filled in.
    pub parameters: Parameters,
    /// First face of each cluster, when listed: upload order.
    pub listed_seeds: Option<Vec<u32>>,
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
    /// The report; `timings_ms.write` and `.total` are the caller's to fill.
    pub report: Report,
}

/// Reads, checks and prepares a mesh. Needs no device.
pub fn prepare(request: &Request<'_>) -> Result<Prepared> {
    let _ = request;
    Err(crate::Error::new(
        crate::Kind::Internal,
        "under construction",
    ))
}

/// Clusters a prepared mesh. `on_iteration` is told of every row of the report as it comes.
pub fn run(
    prepared: &Prepared,
    device: &mut dyn Device,
    cancel: &Cancel,
    on_iteration: &mut dyn FnMut(&Iteration),
) -> Result<Outcome> {
    let _ = (prepared, device, cancel, on_iteration);
    Err(crate::Error::new(
        crate::Kind::Internal,
        "under construction",
    ))
}
