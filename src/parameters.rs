//! What a caller may ask of a clustering: defined once, for the command line, the query string and the JSON part.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::error::{Error, Result};

/// The parameters of a job. Flags, query parameters and JSON members have the same names and meanings.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// How to cluster: bb, boundary-based clustering (Parallel Mesh Clustering, section 3)
    #[arg(long, value_enum, default_value_t)]
    pub algorithm: Algorithm,

    /// Number of clusters; may be left out when seeds are listed
    #[arg(long, short = 'k', value_name = "K")]
    #[schema(minimum = 1)]
    pub clusters: Option<u64>,

    /// Where clusters start: morton (stratified by area along a Morton curve), random, or file:PATH with a list of face numbers
    #[arg(long, default_value_t, value_name = "morton|random|file:PATH")]
    #[schema(value_type = String, example = "morton")]
    pub seeds: Seeds,

    /// Number that the random choices are drawn from
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,

    /// Stop after this many iterations, converged or not; unlimited when left out
    #[arg(long, value_name = "N")]
    pub max_iterations: Option<u32>,

    /// Refine what boundary-based clustering ends with by exact gains (lower energy), or leave it as it is
    #[arg(long, value_enum, default_value_t)]
    pub refine: Refine,

    /// Accept clusters in several pieces, as the optimisation left them
    #[arg(long)]
    pub allow_disconnected: bool,
}

impl Parameters {
    /// Checks what can be checked without the mesh. `listed` says whether seeds come as a list.
    pub fn check(&self, listed: bool) -> Result<()> {
        if self.seeds == Seeds::Listed && !listed {
            return Err(Error::parameter("seeds are said to be listed, but no list came with the request"));
        }
        match self.clusters {
            Some(0) => Err(Error::parameter("clusters must be at least 1, not 0")),
            None if !listed => Err(Error::parameter("clusters is missing: say how many clusters you want")),
            _ => Ok(()),
        }
    }
}

/// A clustering algorithm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// Boundary-based clustering (Parallel Mesh Clustering, section 3)
    #[default]
    Bb,
}

/// Whether to refine after boundary-based clustering.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Refine {
    /// Refine
    #[default]
    On,
    /// Boundary-based clustering alone
    None,
}

/// Where clusters start.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Seeds {
    /// One random face in each of k strata of equal area along a Morton curve.
    #[default]
    Morton,
    /// Random faces, all equally likely (P§5.3).
    Random,
    /// A file with a list of face numbers; on the command line only.
    File(PathBuf),
    /// Face numbers that came with the request.
    Listed,
}

impl fmt::Display for Seeds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Seeds::Morton => f.write_str("morton"),
            Seeds::Random => f.write_str("random"),
            Seeds::File(path) => write!(f, "file:{}", path.display()),
            Seeds::Listed => f.write_str("listed"),
        }
    }
}

impl FromStr for Seeds {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "morton" => Ok(Seeds::Morton),
            "random" => Ok(Seeds::Random),
            "listed" => Ok(Seeds::Listed),
            _ => match text.strip_prefix("file:") {
                Some(path) if !path.is_empty() => Ok(Seeds::File(path.into())),
                _ => Err(Error::parameter(format_args!("seeds must be morton, random or file:PATH, not {text:?}"))),
            },
        }
    }
}

impl Serialize for Seeds {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Seeds {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}
