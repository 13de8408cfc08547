//! A job as a store keeps it.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::parameters::Parameters;
use tesserae_mesh::report::Phase;
use tokio_util::bytes::Bytes;
use utoipa::ToSchema;
use uuid::Uuid;

pub(crate) use crate::queue::State;
use crate::store::kept::Kept;

/// The tenant of every job of a service without tokens.
pub(crate) const LOCAL_TENANT: &str = "local";

/// Name of a job: 122 random bits, so that it cannot be guessed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, ToSchema)]
#[schema(value_type = String, format = "uuid")]
pub(crate) struct JobId(Uuid);

impl JobId {
    pub fn random() -> Self {
        Self(Uuid::new_v4())
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Serialize for JobId {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl FromStr for JobId {
    type Err = Error;

    /// Takes the hyphenated form only, so that a job has one address.
    fn from_str(text: &str) -> Result<Self> {
        Uuid::try_parse(text).ok().map(Self).filter(|id| id.to_string() == text).ok_or_else(|| no_such_job(text))
    }
}

pub(crate) fn no_such_job(id: impl fmt::Display) -> Error {
    Error::not_found(format_args!("there is no such job: {id}"))
}

pub(crate) fn not_failed(state: State) -> Error {
    let what = match state {
        State::Queued | State::Running => "wait for its end",
        State::Succeeded => "its results are there",
        State::Cancelled | State::Failed => "submit the mesh again",
    };
    Error::conflict(format_args!("only a job that has failed can be run again; {what}: it is {}", state.name()))
}

/// An upload: its tenant, its files, and what to do with it. What is said of a mesh holds for points, too.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Spec {
    pub tenant: String,
    /// The `traceparent` of the request (W3C Trace Context), which the work on the job continues.
    pub trace_parent: Option<String>,
    pub webhook: Option<String>,
    pub parameters: Parameters,
    /// Name that the client gave the mesh file. For people; never a path here.
    pub file_name: Option<String>,
    pub format: InputFormat,
    pub bytes: u64,
    /// Names of the buffers that came with the mesh, in the order of their parts.
    pub buffers: Vec<String>,
    pub listed_seeds: bool,
    pub has_weights: bool,
    pub has_graph: bool,
    /// Whether all of these are small blobs, which the store keeps.
    pub is_small: bool,
    /// Jobs of a tenant with a higher priority are claimed first.
    pub priority: i8,
    pub kept: Kept,
    /// Where the mesh lies, if it did not come with the request.
    pub referred: Option<Referred>,
}

/// A mesh that lay in a bucket before the request for its job came.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Referred {
    pub url: String,
    /// Changes with its content.
    pub tag: Option<String>,
}

pub(crate) const PRIORITIES: std::ops::RangeInclusive<i8> = -100..=100;

/// How far a job is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Progress {
    /// Iterations made.
    pub iterations: u32,
    /// Phase of the last of them.
    pub phase: Option<Phase>,
    /// Hierarchies: rounds made.
    pub rounds: u32,
    /// Hierarchies: clusters left after the last of them.
    pub clusters_left: Option<u64>,
    /// Energy after the last iteration or round.
    pub energy: Option<f64>,
}

/// What is known about the result of a job without opening it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Summary {
    /// Faces of the mesh, each with a label.
    pub faces: u64,
    pub clusters: u64,
    /// Shape of points: that of their grid, or their number. Empty for a mesh.
    pub shape: Vec<u64>,
    pub labels_sha256: Option<String>,
    /// Whether the result is small blobs, which the store keeps.
    pub is_small: bool,
    /// What its blobs held when they were stored, by their names.
    pub blobs: BTreeMap<String, Contents>,
}

impl Summary {
    pub fn shape(&self) -> Vec<usize> {
        self.shape.iter().map(|&length| length as usize).collect()
    }
}

/// What a blob held when it was stored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Contents {
    pub bytes: u64,
    pub sha256: String,
}

/// Bytes of all small blobs of an upload, or of a result, at the most.
pub(crate) const SMALL_BLOBS: u64 = 256 << 10;

/// A small file of a job, kept with the job: it needs no file and no separate wait for the disk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SmallBlob {
    pub name: String,
    pub bytes: Bytes,
}

/// A job as it is now.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Job {
    pub id: JobId,
    pub state: State,
    pub spec: Spec,
    /// Place among the waiting jobs of its tenant: 1 for the one that is claimed first; none when it does not wait.
    pub queue_position: Option<u64>,
    /// Claims so far; only the result of the last one counts.
    pub attempt: u32,
    /// Name of the process that claimed it last.
    pub worker: Option<String>,
    pub progress: Progress,
    pub cancel_requested: bool,
    pub problem: Option<Error>,
    pub summary: Option<Summary>,
    pub created_at: SystemTime,
    pub started_at: Option<SystemTime>,
    pub ended_at: Option<SystemTime>,
}

impl Job {
    /// Whether its upload is there to be read: not what a client named by a `mesh_url`.
    pub fn has_upload(&self) -> bool {
        self.spec.referred.is_none() && (!self.state.is_ended() || self.keeps_upload())
    }

    pub fn has_image(&self) -> bool {
        self.state == State::Succeeded && self.spec.kept.mesh && self.spec.format.is_image()
    }

    /// Whether its upload is kept after its end, so that it may be run again.
    pub fn keeps_upload(&self) -> bool {
        keeps_upload(self.problem.as_ref())
    }
}

/// Whether the upload of a job that ends with this problem is kept: that of a job that was given up, or whose files
/// could not be read or written.
pub(crate) fn keeps_upload(problem: Option<&Error>) -> bool {
    problem.is_some_and(|problem| matches!(problem.kind, Kind::Poison | Kind::InsufficientStorage))
}

/// The right to write about a running job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Ticket {
    pub job: JobId,
    /// Counts the claims of the job; an older one writes nothing.
    pub attempt: u32,
}
