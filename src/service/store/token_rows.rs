//! Tenants and their tokens as a shared store keeps them: rows of JSON, which `access` reads.

use std::collections::BTreeMap;
use std::fmt;

use async_trait::async_trait;
use serde_json::Value;

use crate::error::Result;

/// The rows by the names of the tenants.
pub(in crate::service) type TokenRows = BTreeMap<String, Value>;

/// Keeps tenants and their tokens.
#[async_trait]
pub(in crate::service) trait TokenStore: fmt::Debug + Send + Sync {
    /// A number that every change of the rows raises.
    async fn token_version(&self) -> Result<u64>;

    /// The rows.
    async fn token_rows(&self) -> Result<TokenRows>;
}
