//! What makes points neighbours, as a parameter.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::data::{Graph, MOST_NEIGHBOURS, USUAL_NEIGHBOURS};
use crate::error::names::{self, Name};
use crate::error::{Error, Quoted, Result};

/// What makes points neighbours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Neighbours {
    /// Being among the nearest of the other.
    Nearest(u32),
    /// Places in a grid; in a full one corners count, too.
    Grid {
        /// Whether corners count.
        full: bool,
    },
    /// A file with a sparse matrix; on the command line only.
    File(PathBuf),
}

impl Neighbours {
    /// The graph, unless it is in a file.
    pub fn graph(&self) -> Option<Graph> {
        match *self {
            Self::Nearest(nearest) => Some(Graph::Knn(nearest)),
            Self::Grid { full } => Some(Graph::Grid { full }),
            Self::File(_) => None,
        }
    }
}

impl fmt::Display for Neighbours {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nearest(nearest) => write!(f, "knn:{nearest}"),
            Self::Grid { full: false } => f.write_str("grid"),
            Self::Grid { full: true } => f.write_str("grid:full"),
            Self::File(path) => write!(f, "{}", path.display()),
        }
    }
}

impl FromStr for Neighbours {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "knn" => return Ok(Self::Nearest(USUAL_NEIGHBOURS)),
            "grid" => return Ok(Self::Grid { full: false }),
            "grid:full" => return Ok(Self::Grid { full: true }),
            _ => {}
        }
        if let Some(nearest) = text.strip_prefix("knn:").and_then(|number| number.parse().ok()) {
            return match nearest {
                1..=MOST_NEIGHBOURS => Ok(Self::Nearest(nearest)),
                _ => Err(Error::parameter(format_args!(
                    "the number of nearest neighbours must be from 1 to {MOST_NEIGHBOURS}, not {nearest}"
                ))),
            };
        }
        let is_file = text.len() > 4 && text.to_ascii_lowercase().ends_with(".npz");
        if names::are_flags() && is_file {
            return Ok(Self::File(text.into()));
        }
        Err(Error::parameter(format_args!(
            "{} must be knn, knn:Q, grid, grid:full or {}, not {}",
            Name::GRAPH,
            if names::are_flags() { "FILE.npz" } else { "left out, with a part named graph" },
            Quoted(text)
        )))
    }
}

impl Serialize for Neighbours {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Neighbours {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}
