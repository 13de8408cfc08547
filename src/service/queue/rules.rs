//! What the operator allows, and the texts of the rules.

use std::fmt::Display;
use std::time::Duration;

use tesserae_mesh::error::{Error, Kind, Result};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rules {
    pub max_queued: usize,
    /// Counted attempts after which a job that keeps being given back has failed.
    pub max_attempts: u32,
    /// Pause of a suspect after each crash: long enough that a supervisor does not take the crashes for a service that
    /// cannot start.
    pub crash_pause: Duration,
}

impl Rules {
    /// [`Kind::QueueFull`] when as many jobs wait as may, or `most` of the tenant.
    pub fn check_room(&self, waiting: u64, own: u64, most: Option<u64>) -> Result<()> {
        let full = |whose: &str, most: u64| {
            Err(Error::new(Kind::QueueFull, format_args!("as many jobs{whose} wait as may; try again later: {most}")))
        };
        match most {
            _ if waiting >= self.max_queued as u64 => full("", self.max_queued as u64),
            Some(most) if own >= most => full(" of this tenant", most),
            _ => Ok(()),
        }
    }
}

pub(crate) fn given_up(attempts: u32, last: &Error) -> Error {
    Error::new(
        Kind::Poison,
        format_args!(
            "the job was given up after {attempts} attempt{}, of which the last failed: {last}; its upload is kept \
             until the job is deleted: to run it again, POST to its path followed by /retry",
            if attempts == 1 { "" } else { "s" }
        ),
    )
}

pub(crate) fn lease_is_over() -> Error {
    Error::new(Kind::Unavailable, "the service ended, or stood still, while the job ran")
}

pub(crate) fn not_yours(job: impl Display) -> Error {
    Error::new(Kind::Conflict, format_args!("the job is no longer this worker's: {job}"))
}
