//! How jobs come in: bodies, parameters, repeated requests, and limits of the queue.

pub mod admission;
pub mod idempotency;
pub mod intake;
pub mod request;
pub mod upload;
