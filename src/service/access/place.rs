//! Where tokens are kept: in a file, or in a store of jobs that services share.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use serde_json::{Map, Value};

use super::tokens::{TokenFile, Tokens};
use crate::error::{Error, Result, wrong_json_at};
use crate::service::blocking::blocking;
use crate::service::store::{TokenRows, TokenStore};

/// Where tokens are kept.
#[derive(Debug, Clone)]
pub(super) enum Place {
    File(PathBuf),
    Store(Arc<dyn TokenStore>),
}

/// What changes when the tokens do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Stamp {
    File(Option<(Option<SystemTime>, u64)>),
    Store(u64),
}

impl Place {
    /// Its name for the log.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) => path.display().to_string(),
            Self::Store(_) => "the tokens of the store of jobs".to_owned(),
        }
    }

    /// The stamp of the tokens as they are now; none while the store cannot be read.
    pub async fn stamp(&self) -> Option<Stamp> {
        match self {
            Self::File(path) => {
                let path = path.clone();
                blocking(move || Stamp::File(stamp(&path))).await.ok()
            }
            Self::Store(store) => store.token_version().await.ok().map(Stamp::Store),
        }
    }

    /// The tokens.
    pub async fn read(&self) -> Result<Tokens> {
        match self {
            Self::File(path) => {
                let path = path.clone();
                blocking(move || Tokens::read(&path)).await.flatten()
            }
            Self::Store(store) => Tokens::of(&TokenFile::from_rows(store.token_rows().await?)?),
        }
    }
}

fn stamp(path: &Path) -> Option<(Option<SystemTime>, u64)> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok(), metadata.len()))
}

impl TokenFile {
    /// The tenants of a store.
    pub(in crate::service) fn from_rows(rows: TokenRows) -> Result<Self> {
        let tenants: Map<String, Value> = rows.into_iter().collect();
        let file = Value::Object(Map::from_iter([("tenants".to_owned(), Value::Object(tenants))]));
        serde_json::from_value(file).map_err(|error| {
            Error::parameter(format_args!("the tokens in the store of jobs are not valid: {}", wrong_json_at(&error)))
        })
    }

    /// The tenants as a store keeps them.
    #[cfg(feature = "postgres")]
    pub(in crate::service) fn to_rows(&self) -> Result<TokenRows> {
        let row = |(name, entry): (&String, _)| Ok((name.clone(), serde_json::to_value(entry)?));
        self.tenants.iter().map(row).collect::<serde_json::Result<_>>().map_err(|error| {
            Error::new(crate::Kind::Internal, format_args!("tokens cannot be written as JSON: {error}"))
        })
    }
}
