//! What stands between a connection and a handler: tokens and tenants, limits of traffic, what errors look like.

pub mod access;
pub mod problem;
pub mod query;
pub mod traffic;
