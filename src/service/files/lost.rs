//! A store of jobs that was lost: the service does not start beside files of its jobs.

use tesserae_mesh::error::{Error, Kind, Result};

use super::ballast::BALLAST;
use super::folder::Files;
use super::names::{RESULTS, UPLOADS};
use super::root;

impl Files {
    /// Checks, before the store of jobs is opened, that it is there if a service worked in the folder before: it left
    /// files of jobs or, where all jobs were small, its ballast.
    pub async fn check_store(&self) -> Result<()> {
        if self.database().metadata().is_ok_and(|found| found.len() > 0) {
            return Ok(());
        }
        let jobs = match self.is_shared() {
            // whatever lies elsewhere, it stays
            true => 0,
            false => self.jobs_in(UPLOADS).await?.len() + self.jobs_in(RESULTS).await?.len(),
        };
        match jobs > 0 || self.root.path.join(BALLAST).exists() {
            true => Err(self.lost("is missing or empty", jobs)),
            false => Ok(()),
        }
    }

    /// Checks a store of jobs that never knew a job: there are no results then.
    pub async fn check_unused_store(&self) -> Result<()> {
        if self.is_shared() {
            return Ok(());
        }
        match self.jobs_in(RESULTS).await?.len() {
            0 => Ok(()),
            jobs => Err(self.lost("is new", jobs)),
        }
    }

    fn lost(&self, what: &str, jobs: usize) -> Error {
        let others = match jobs {
            0 => "a service has worked in the data folder".to_owned(),
            _ => format!("the data folder holds files of {jobs} job{}", if jobs == 1 { "" } else { "s" }),
        };
        Error::new(
            Kind::Conflict,
            format_args!(
                "the store of jobs ({}) {what}, but {others}: put the store back, from a backup for instance, or, to \
                 begin with an empty store, move {UPLOADS}, {RESULTS} and {BALLAST} out of the data folder: {}",
                root::STORE[0],
                self.root.path.display()
            ),
        )
    }
}
