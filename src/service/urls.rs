//! The paths of a job's resources, and how much of a client's path is repeated.

use std::collections::BTreeMap;

use serde::Serialize;
use tesserae_mesh::artifacts::Artifact;
use utoipa::ToSchema;

use super::kept;
use super::store::{Job, JobId};

/// Where everything about a job is: paths on this service.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Urls {
    /// The job itself.
    #[serde(rename = "self")]
    #[schema(rename = "self")]
    job: String,
    /// Its events.
    events: String,
    /// Its labels, once it has succeeded; of a whole hierarchy, with `?clusters=K`.
    labels: String,
    /// Its hierarchy, once it has succeeded; null for flat algorithms.
    hierarchy: Option<String>,
    /// Its report, once it has succeeded.
    report: String,
    /// Its mesh as it was uploaded, while the job waits and runs and of a job that was given up; null otherwise.
    upload: Option<String>,
    /// What it can give of its mesh, by name, once it has succeeded: what was named, or all if it keeps the mesh. Of a
    /// whole hierarchy, with `?clusters=K`.
    #[serde(flatten)]
    derived: BTreeMap<&'static str, String>,
}

/// Longest path of a request that is logged or sent back, in bytes.
const MAX_PATH: usize = 256;

/// The beginning of a path.
pub(super) fn cut(path: &str) -> &str {
    &path[..path.floor_char_boundary(MAX_PATH)]
}

/// Path of a job.
pub(super) fn path(id: JobId) -> String {
    format!("/v1/jobs/{id}")
}

/// The route of an output.
pub(super) fn route(artifact: &Artifact) -> String {
    format!("/v1/jobs/{{id}}/{}", artifact.name)
}

impl Urls {
    /// Those of a job.
    pub fn of(job: &Job) -> Self {
        let path = path(job.id);
        let is_hierarchical = job.spec.parameters.algorithm.is_hierarchical();
        let given = kept::made_of_mesh().filter(|artifact| job.spec.kept.gives(artifact));
        Self {
            events: format!("{path}/events"),
            labels: format!("{path}/labels"),
            hierarchy: is_hierarchical.then(|| format!("{path}/hierarchy")),
            report: format!("{path}/report"),
            upload: job.has_upload().then(|| format!("{path}/upload")),
            derived: given.map(|artifact| (artifact.name, format!("{path}/{}", artifact.name))).collect(),
            job: path,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_cut_between_characters() {
        assert_eq!(cut("/v1/jobs"), "/v1/jobs");
        let long = format!("/{}", "ü".repeat(500));
        assert!(cut(&long).len() == MAX_PATH - 1 && long.starts_with(cut(&long)));
    }
}
