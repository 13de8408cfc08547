//! Results as responses: what is stored, and what is made of it on request. No handler is known here.

mod checked;
pub(crate) mod made;
pub(crate) mod stored;

use std::fmt::Display;
use std::sync::Arc;

use tesserae_mesh::artifacts::{HIERARCHY, LABELS, Need};
use tesserae_mesh::error::{Error, Kind, Result};

use crate::http::state::Shared;
use crate::store::{Job, State, Summary};

/// A job that has succeeded.
pub(crate) struct DoneJob {
    pub shared: Arc<Shared>,
    pub job: Job,
    pub summary: Summary,
}

impl DoneJob {
    /// An error says why there is nothing yet, or never will be.
    pub fn of(shared: Arc<Shared>, job: Job) -> Result<Arc<Self>> {
        Err(match (job.state, job.summary.clone()) {
            (State::Succeeded, Some(summary)) => return Ok(Arc::new(Self { shared, job, summary })),
            (State::Failed, _) => {
                let why = job.problem.map_or_else(String::new, |problem| problem.message);
                Error::conflict(format_args!("the job failed and has no result: {why}"))
            }
            (State::Cancelled, _) => Error::new(Kind::Cancelled, "the job was cancelled and has no result"),
            (State::Queued | State::Running | State::Succeeded, _) => Error::conflict(format_args!(
                "the job has no result yet; follow its events, or ask again later: it is {}",
                job.state.name()
            )),
        })
    }

    /// Refuses a number of clusters for a flat job, and none for a whole hierarchy.
    pub fn check_clusters(&self, clusters: Option<u64>) -> Result<()> {
        let (parameters, summary) = (&self.job.spec.parameters, &self.summary);
        let message = match clusters {
            Some(clusters) if !HIERARCHY.is_made(parameters) => format!(
                "this job made a flat clustering of {} clusters, which cannot be cut at another number; leave \
                 clusters out, not {clusters}",
                summary.clusters
            ),
            None if LABELS.lacks(parameters) == Some(Need::Labels) => format!(
                "this job made a whole hierarchy, which has labels at every number of clusters: give clusters, from \
                 {} to {}",
                summary.clusters, summary.faces
            ),
            _ => return Ok(()),
        };
        Err(Error::conflict(message))
    }

    fn damaged(&self, name: &str, why: impl Display) -> Error {
        self.shared.files.damaged(self.job.id, name, why)
    }
}
