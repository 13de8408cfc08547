//! Errors of files that cannot be read.

use std::io;

use super::blocks::Unreadable;
use crate::error::{Error, Kind, Result};

pub(super) fn unreadable(reason: Unreadable) -> Error {
    match reason {
        Unreadable::Io(error) => cannot_read(error),
        Unreadable::Damaged => {
            Error::new(Kind::BadRequest, "the hierarchy cannot be read: it was changed or damaged: a checksum is wrong")
        }
    }
}

pub(super) fn cannot_read(error: io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => Error::new(Kind::BadRequest, "the hierarchy cannot be read: it ends early"),
        _ => Error::io("the hierarchy cannot be read", error),
    }
}

pub(super) fn malformed<T>(what: impl std::fmt::Display) -> Result<T> {
    Err(Error::new(Kind::BadRequest, format_args!("the hierarchy cannot be read: {what}")))
}
