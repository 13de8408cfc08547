//! Reservations: uploads by URL that no job is made of yet. For the quota of their tenant they count as waiting jobs.

use std::fmt;
use std::time::Duration;

use async_trait::async_trait;
use serde::{Deserialize, Serialize};

use super::job::JobId;
use super::queue::Queue;
use crate::error::{Error, Kind, Result};

/// Time after which no job is made of an upload by URL any more.
pub(in crate::service) const RESERVED_FOR: Duration = Duration::from_secs(12 * 3600);

/// An upload by URL that is expected.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(in crate::service) struct Reservation {
    /// The tenant that may make a job of it.
    pub tenant: String,
    /// Length of the mesh file.
    pub bytes: u64,
    /// Name that the client gave the mesh file.
    pub file_name: Option<String>,
    /// Whether no job is made of it any more, by the clock of the store.
    #[serde(skip)]
    pub is_over: bool,
}

/// The error for an upload by URL without a reservation.
pub(in crate::service) fn no_such_upload(id: impl fmt::Display) -> Error {
    let hours = RESERVED_FOR.as_secs() / 3600;
    let message = format_args!("there is no such upload, or no job was made of it within {hours} hours: {id}");
    Error::new(Kind::NotFound, message)
}

/// Keeps reservations, each under the name of the job that the upload will be. [`Queue::create`] of that job removes it
/// in the same step, and adds no job without it.
#[async_trait]
pub(in crate::service) trait Reservations: Queue {
    /// Adds a reservation with a new id. It is over when `valid` has passed, and is removed when another upload is
    /// reserved after `valid` has passed once more.
    async fn reserve(&self, id: JobId, reservation: Reservation, valid: Duration) -> Result<()>;

    /// A reservation; none after it was taken back or became a job.
    async fn reservation(&self, id: JobId) -> Result<Option<Reservation>>;

    /// Takes a reservation back. False when there is none, as when it became a job.
    async fn unreserve(&self, id: JobId) -> Result<bool>;

    /// Number of jobs of a tenant that wait, and of its reservations that are not over.
    async fn waiting_of(&self, tenant: &str) -> Result<u64>;
}
