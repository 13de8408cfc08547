//! What stands between a connection and a handler: tokens and tenants, limits of traffic, what errors look like, and
//! what is logged about requests.

pub mod access;
pub mod access_log;
pub mod problem;
pub mod query;
pub mod traffic;
