//! Work on files away from the runtime, and its errors.

use std::io;
use std::path::Path;

use crate::error::{Error, Kind, Result};

/// Runs file work where blocking is allowed.
pub(in crate::service) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| Error::new(Kind::Internal, format_args!("work on a file did not end: {error}")))
}

/// The error of a disk that does not take what is to be stored.
pub(super) fn storage_error(what: impl std::fmt::Display, error: io::Error) -> Error {
    Error::new(Kind::of_storage(&error), format_args!("{what}: {error}"))
}

pub(super) fn cannot_make(path: &Path, error: io::Error) -> Error {
    Error::io(format_args!("the data folder cannot be used: {}", path.display()), error)
}
