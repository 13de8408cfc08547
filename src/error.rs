//! The one error type of the crate.
//!
//! An error is a kind, which decides everything a program does with it (HTTP status, problem type, whether a retry can
//! help), and a message for the person who reads it: lower case, no full stop, the offending value last.

mod json;
pub mod names;
mod parsing;
mod text;

pub use json::{wrong_json, wrong_json_at};
pub use parsing::what_it_must_be;
pub use text::{Brief, Quoted};

use std::fmt::Display;
use std::io;

use serde::{Deserialize, Serialize};

/// What went wrong, for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The request itself cannot be read: a body that ends early, a malformed header or part.
    BadRequest,
    /// A parameter is unknown, malformed or impossible for this mesh.
    InvalidParameter,
    /// The mesh contradicts its format or cannot be clustered.
    InvalidMesh,
    /// The mesh is sound but uses a feature that is not supported.
    UnsupportedMesh,
    /// The type of the body is not one that is read here.
    UnsupportedMediaType,
    /// More bytes or faces than the limits allow.
    TooLarge,
    /// The query string has more bytes than are read.
    UriTooLong,
    /// There is no such thing.
    NotFound,
    /// The output is made of a mesh that the job did not keep.
    MeshNotKept,
    /// The resource exists, but does not answer this method.
    MethodNotAllowed,
    /// The request uses a feature of HTTP that is not supported, or one that this service is set up without.
    NotImplemented,
    /// Missing or invalid credentials.
    Unauthorized,
    /// The credentials do not permit this.
    Forbidden,
    /// A web page of another origin sent this.
    ForeignOrigin,
    /// The request names a host that this service does not answer for.
    Misdirected,
    /// The request took too long to arrive.
    Timeout,
    /// The result has no such part.
    RangeNotSatisfiable,
    /// This client is over its limit.
    RateLimited,
    /// All clients together are over a limit of the service.
    Overloaded,
    /// None of the representations the client accepts exists.
    NotAcceptable,
    /// The state of the job does not allow this.
    Conflict,
    /// The same `Idempotency-Key` came with another request before.
    KeyReused,
    /// The job took longer than a job may.
    TimeLimit,
    /// The job was tried as often as it may be, and never ended.
    Poison,
    /// There is no room for more files, or will soon be none.
    InsufficientStorage,
    /// The queue holds as many jobs as it may.
    QueueFull,
    /// The job was cancelled before it ended.
    Cancelled,
    /// The service is starting, stopping or lacks a resource.
    Unavailable,
    /// The chosen device does not exist or cannot take this mesh.
    DeviceUnsuitable,
    /// The device was lost or ran out of memory.
    DeviceLost,
    /// The device computed wrongly: what it gave contradicts itself.
    DeviceWrong,
    /// A file could not be read or written.
    Io,
    /// A stored result is not what was stored.
    Damaged,
    /// A defect of this program.
    Internal,
}

impl Kind {
    /// HTTP status of a problem of this kind.
    pub fn status(self) -> u16 {
        match self {
            Kind::BadRequest => 400,
            Kind::Unauthorized => 401,
            Kind::Forbidden | Kind::ForeignOrigin => 403,
            Kind::NotFound | Kind::MeshNotKept => 404,
            Kind::MethodNotAllowed => 405,
            Kind::NotAcceptable => 406,
            Kind::Timeout => 408,
            Kind::Conflict | Kind::Cancelled => 409,
            Kind::TooLarge => 413,
            Kind::UriTooLong => 414,
            Kind::UnsupportedMediaType => 415,
            Kind::RangeNotSatisfiable => 416,
            Kind::Misdirected => 421,
            Kind::InvalidParameter | Kind::InvalidMesh | Kind::UnsupportedMesh | Kind::DeviceUnsuitable => 422,
            Kind::KeyReused | Kind::TimeLimit => 422,
            Kind::QueueFull | Kind::RateLimited => 429,
            Kind::Io | Kind::Damaged | Kind::Internal | Kind::Poison | Kind::DeviceWrong => 500,
            Kind::NotImplemented => 501,
            Kind::Unavailable | Kind::Overloaded | Kind::DeviceLost => 503,
            Kind::InsufficientStorage => 507,
        }
    }

    /// Last segment of the problem's `type` URI (RFC 9457), `/problems/…`.
    pub fn slug(self) -> &'static str {
        match self {
            Kind::BadRequest => "bad-request",
            Kind::InvalidParameter => "invalid-parameter",
            Kind::InvalidMesh => "invalid-mesh",
            Kind::UnsupportedMesh => "unsupported-mesh",
            Kind::UnsupportedMediaType => "unsupported-media-type",
            Kind::TooLarge => "too-large",
            Kind::UriTooLong => "uri-too-long",
            Kind::NotImplemented => "not-implemented",
            Kind::Unauthorized => "unauthorized",
            Kind::Forbidden => "forbidden",
            Kind::ForeignOrigin => "foreign-origin",
            Kind::Misdirected => "misdirected",
            Kind::Timeout => "timeout",
            Kind::RangeNotSatisfiable => "range-not-satisfiable",
            Kind::RateLimited => "rate-limited",
            Kind::Overloaded => "overloaded",
            Kind::NotFound => "not-found",
            Kind::MeshNotKept => "mesh-not-kept",
            Kind::MethodNotAllowed => "method-not-allowed",
            Kind::NotAcceptable => "not-acceptable",
            Kind::Conflict => "conflict",
            Kind::KeyReused => "key-reused",
            Kind::TimeLimit => "time-limit",
            Kind::Poison => "poison",
            Kind::InsufficientStorage => "insufficient-storage",
            Kind::QueueFull => "queue-full",
            Kind::Cancelled => "cancelled",
            Kind::Unavailable => "unavailable",
            Kind::DeviceUnsuitable => "device-unsuitable",
            Kind::DeviceLost => "device-lost",
            Kind::DeviceWrong => "device-wrong",
            Kind::Io => "io",
            Kind::Damaged => "damaged",
            Kind::Internal => "internal",
        }
    }

    /// Short human-readable summary, the same for every problem of this kind (RFC 9457 `title`).
    pub fn title(self) -> &'static str {
        match self {
            Kind::BadRequest => "The request cannot be read",
            Kind::InvalidParameter => "A parameter is not valid",
            Kind::InvalidMesh => "The mesh is not valid",
            Kind::UnsupportedMesh => "The mesh uses an unsupported feature",
            Kind::UnsupportedMediaType => "The media type is not supported",
            Kind::TooLarge => "The upload is larger than allowed",
            Kind::UriTooLong => "The URI is too long",
            Kind::NotImplemented => "The service does not have this feature",
            Kind::Unauthorized => "A token is needed",
            Kind::Forbidden => "This token may not do this",
            Kind::ForeignOrigin => "A web page of another origin may not do this",
            Kind::Misdirected => "The service does not answer for this host",
            Kind::Timeout => "The request took too long to arrive",
            Kind::RangeNotSatisfiable => "There is no such part of the result",
            Kind::RateLimited => "More is asked for than a client's share",
            Kind::Overloaded => "The service has too much to do",
            Kind::NotFound => "Not found",
            Kind::MeshNotKept => "The mesh was not kept",
            Kind::MethodNotAllowed => "The method is not allowed here",
            Kind::NotAcceptable => "No acceptable representation",
            Kind::Conflict => "The state of the job does not allow this",
            Kind::KeyReused => "The Idempotency-Key stands for another request",
            Kind::TimeLimit => "The job took too long",
            Kind::Poison => "The job was given up",
            Kind::InsufficientStorage => "There is no room for it",
            Kind::QueueFull => "The queue is full",
            Kind::Cancelled => "The job was cancelled",
            Kind::Unavailable => "The service is not available",
            Kind::DeviceUnsuitable => "The device cannot do this",
            Kind::DeviceLost => "The device was lost",
            Kind::DeviceWrong => "The device computed wrongly",
            Kind::Io => "A file could not be read or written",
            Kind::Damaged => "A stored result is damaged",
            Kind::Internal => "Internal error",
        }
    }

    /// Whether the same request may succeed later.
    pub fn is_retryable(self) -> bool {
        match self {
            Kind::QueueFull
            | Kind::RateLimited
            | Kind::Overloaded
            | Kind::Timeout
            | Kind::Unavailable
            | Kind::DeviceLost
            | Kind::DeviceWrong
            | Kind::Io
            | Kind::InsufficientStorage => true,
            Kind::BadRequest
            | Kind::NotImplemented
            | Kind::Unauthorized
            | Kind::Forbidden
            | Kind::ForeignOrigin
            | Kind::Misdirected
            | Kind::RangeNotSatisfiable
            | Kind::InvalidParameter
            | Kind::InvalidMesh
            | Kind::UnsupportedMesh
            | Kind::UnsupportedMediaType
            | Kind::TooLarge
            | Kind::UriTooLong
            | Kind::NotFound
            | Kind::MeshNotKept
            | Kind::MethodNotAllowed
            | Kind::NotAcceptable
            | Kind::Conflict
            | Kind::KeyReused
            | Kind::TimeLimit
            | Kind::Poison
            | Kind::Cancelled
            | Kind::DeviceUnsuitable
            | Kind::Damaged
            | Kind::Internal => false,
        }
    }
}

impl Kind {
    /// The kind of a file system error while something is stored: no room, or no disk.
    pub fn of_storage(error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
                Kind::InsufficientStorage
            }
            _ => Kind::Unavailable,
        }
    }
}

/// Characters of a message; a longer one ends in an ellipsis and its length in bytes.
pub const LONGEST_MESSAGE: usize = 1000;

/// An error with its kind and its message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
#[error("{message}")]
pub struct Error {
    /// What went wrong, for programs.
    pub kind: Kind,
    /// What went wrong, for people: what, where in the input, what to do.
    pub message: String,
}

impl Error {
    /// An error of the given kind.
    ///
    /// Every message passes here and becomes one line of at most [`LONGEST_MESSAGE`] characters without control
    /// characters, whatever the input put into it. Put a string of the input into a message as [`Quoted`].
    pub fn new(kind: Kind, message: impl Display) -> Self {
        Self { kind, message: text::one_line(&message, LONGEST_MESSAGE) }
    }

    /// A parameter that is unknown, malformed or impossible.
    pub fn parameter(message: impl Display) -> Self {
        Self::new(Kind::InvalidParameter, message)
    }

    /// A mesh that contradicts its format or cannot be clustered.
    pub fn mesh(message: impl Display) -> Self {
        Self::new(Kind::InvalidMesh, message)
    }

    /// A mesh with a feature that is not supported.
    pub fn unsupported(message: impl Display) -> Self {
        Self::new(Kind::UnsupportedMesh, message)
    }

    /// More bytes or faces than allowed.
    pub fn too_large(message: impl Display) -> Self {
        Self::new(Kind::TooLarge, message)
    }

    /// What the state of a job, or of a file, does not allow.
    pub fn conflict(message: impl Display) -> Self {
        Self::new(Kind::Conflict, message)
    }

    /// Something that does not exist.
    pub fn not_found(message: impl Display) -> Self {
        Self::new(Kind::NotFound, message)
    }

    /// A service or a resource that cannot be reached now.
    pub fn unavailable(message: impl Display) -> Self {
        Self::new(Kind::Unavailable, message)
    }

    /// A defect of this program.
    pub fn internal(message: impl Display) -> Self {
        Self::new(Kind::Internal, message)
    }

    /// What the device cannot do.
    pub fn unsuitable(message: impl Display) -> Self {
        Self::new(Kind::DeviceUnsuitable, message)
    }

    /// A file that could not be read or written.
    pub fn io(what: impl Display, error: io::Error) -> Self {
        Self::new(Kind::Io, format_args!("{what}: {error}"))
    }

    /// A file that could not be stored: for want of room, or the disk failed.
    pub fn storage(what: impl Display, error: io::Error) -> Self {
        Self::new(Kind::of_storage(&error), format_args!("{what}: {error}"))
    }

    /// Whether the disk failed, not the request: a later attempt may succeed.
    pub fn is_of_storage(&self) -> bool {
        matches!(self.kind, Kind::InsufficientStorage | Kind::Unavailable)
    }

    /// The clustering was cancelled.
    pub fn cancelled() -> Self {
        Self::new(Kind::Cancelled, "cancelled before it ended")
    }
}

/// Result with the crate's error.
pub type Result<T, E = Error> = std::result::Result<T, E>;
