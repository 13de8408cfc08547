//! How jobs come in: bodies, parameters and repeated requests.

pub mod idempotency;
pub mod intake;
pub mod request;
pub mod upload;
