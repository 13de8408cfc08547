//! The paths of a job's resources.

use std::collections::BTreeMap;

use serde::Serialize;
use tesserae_mesh::artifacts::{Artifact, HIERARCHY};
use utoipa::ToSchema;

use crate::store::{Job, JobId, kept};

/// Where everything about a job is: paths on this service.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Urls {
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
    /// Its mesh as it was uploaded, while the job waits and runs and of a job that was given up, and an image that is
    /// kept; null otherwise.
    upload: Option<String>,
    /// What it can give of its mesh, by name, once it has succeeded: what was named, or all if it keeps the mesh. Of a
    /// whole hierarchy, with `?clusters=K`.
    #[serde(flatten)]
    derived: BTreeMap<&'static str, String>,
}

pub(crate) fn path(id: JobId) -> String {
    format!("/v1/jobs/{id}")
}

pub(crate) fn route(artifact: &Artifact) -> String {
    format!("/v1/jobs/{{id}}/{}", artifact.name)
}

impl Urls {
    pub fn of(job: &Job) -> Self {
        let path = path(job.id);
        let is_hierarchical = HIERARCHY.is_made(&job.spec.parameters);
        let given = kept::made_of_input().filter(|artifact| job.spec.kept.gives(artifact, job.spec.format));
        Self {
            events: format!("{path}/events"),
            labels: format!("{path}/labels"),
            hierarchy: is_hierarchical.then(|| format!("{path}/hierarchy")),
            report: format!("{path}/report"),
            upload: (job.has_upload() || job.has_image()).then(|| format!("{path}/upload")),
            derived: given.map(|artifact| (artifact.name, format!("{path}/{}", artifact.name))).collect(),
            job: path,
        }
    }
}
