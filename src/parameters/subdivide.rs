//! How often faces are divided before they are clustered: `N` or `auto`, in flags, queries and JSON.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::Name;
use crate::error::{Error, Result};
use crate::mesh::divide::faces_after;

/// How often every triangle is divided into four.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub enum Subdivide {
    /// Until there are [`ENOUGH`](Self::ENOUGH) faces a cluster.
    Auto,
    /// So often.
    Times(u32),
}

impl Subdivide {
    /// Faces a cluster that are enough.
    pub const ENOUGH: u64 = 30;

    /// Divisions at most: a million parts of a triangle.
    pub const MOST: u32 = 10;

    /// How often triangles are divided for so many clusters.
    pub fn times(self, triangles: u64, clusters: u64) -> u32 {
        match self {
            Self::Times(times) => times,
            Self::Auto => {
                let is_enough = |&times: &u32| faces_after(triangles, times) >= Self::ENOUGH.saturating_mul(clusters);
                (0..Self::MOST).find(is_enough).unwrap_or(Self::MOST)
            }
        }
    }

    fn checked(times: u64) -> Option<Self> {
        u32::try_from(times).ok().filter(|&times| times <= Self::MOST).map(Self::Times)
    }
}

impl fmt::Display for Subdivide {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Times(times) => write!(f, "{times}"),
        }
    }
}

impl FromStr for Subdivide {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let times = text.parse().ok().and_then(Self::checked);
        times.ok_or_else(|| {
            Error::parameter(format_args!(
                "{} must be from 0 to {}, or auto, not {text:?}",
                Name::SUBDIVIDE,
                Self::MOST
            ))
        })
    }
}

/// As it is written in JSON and queries.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "subdivide must be a number from 0 to 10, or auto")]
enum Written {
    Number(u64),
    Text(String),
}

impl TryFrom<Written> for Subdivide {
    type Error = Error;

    fn try_from(written: Written) -> Result<Self> {
        match written {
            Written::Number(times) => times.to_string().parse(),
            Written::Text(text) => text.parse(),
        }
    }
}

impl From<Subdivide> for Written {
    fn from(subdivide: Subdivide) -> Self {
        match subdivide {
            Subdivide::Auto => Self::Text("auto".to_owned()),
            Subdivide::Times(times) => Self::Number(times.into()),
        }
    }
}

impl PartialSchema for Subdivide {
    fn schema() -> RefOr<Schema> {
        let times = ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(0)).maximum(Some(Self::MOST));
        let auto = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(["auto"]));
        Schema::from(
            OneOfBuilder::new()
                .item(times)
                .item(auto)
                .examples([json!(2), json!("auto")])
                .description(Some("How often every triangle is divided into four before it is clustered.")),
        )
        .into()
    }
}

impl ToSchema for Subdivide {
    fn name() -> Cow<'static, str> {
        "Subdivide".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_written_as_it_is_read() {
        for (text, json, value) in [("auto", json!("auto"), Subdivide::Auto), ("3", json!(3), Subdivide::Times(3))] {
            assert_eq!((text.parse(), value.to_string()), (Ok(value), text.to_owned()));
            assert_eq!(serde_json::to_value(value).expect("JSON"), json);
            assert_eq!(serde_json::from_value::<Subdivide>(json).expect("JSON"), value);
            assert_eq!(serde_json::from_value::<Subdivide>(json!(text)).expect("JSON"), value);
        }
        for text in ["11", "-1", "2.5", "", "often"] {
            let error = text.parse::<Subdivide>().expect_err(text);
            assert!(error.message.contains("auto") && error.message.contains(text), "{error}");
            assert!(serde_json::from_value::<Subdivide>(json!(text)).is_err());
        }
    }

    #[test]
    fn auto_ends_with_enough_faces_a_cluster() {
        let times = |triangles, clusters| Subdivide::Auto.times(triangles, clusters);
        assert_eq!((times(3000, 100), times(2999, 100), times(1, 1), times(0, 5)), (0, 1, 3, Subdivide::MOST));
        assert_eq!(times(69_451, 10_000), 2);
    }
}
