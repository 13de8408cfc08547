//! Errors of the disk.

use std::io;
use std::path::Path;

use tesserae_mesh::error::{Error, Kind};

/// What clients get when the storage cannot be reached; the log says why.
pub(super) const CANNOT_REACH: &str = "the storage of the service cannot be reached; try again later";

pub(super) fn storage_error(what: impl std::fmt::Display, error: io::Error) -> Error {
    Error::new(Kind::of_storage(&error), format_args!("{what}: {error}"))
}

pub(super) fn cannot_make(path: &Path, error: io::Error) -> Error {
    Error::io(format_args!("the data folder cannot be used: {}", path.display()), error)
}
