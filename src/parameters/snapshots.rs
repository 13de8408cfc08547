//! Which iterations' labels are kept: `N` for every N-th, or a list, `0,6,46`; in flags, queries and JSON.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::json;
use utoipa::openapi::schema::{ArrayBuilder, KnownFormat, ObjectBuilder, OneOfBuilder, SchemaFormat, Type};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::Name;
pub use crate::cluster::record::Snapshots;
use crate::error::{Error, Result};

impl Snapshots {
    /// As it is written in flags and queries, for the description of the interface.
    pub const PATTERN: &'static str = "^(0|[1-9][0-9]{0,8})(,(0|[1-9][0-9]{0,8}))*,?$";

    /// A single number: every so many; 0 for the initial growth alone.
    fn single(number: u32) -> Self {
        if number == 0 { Snapshots::At(vec![0]) } else { Snapshots::Every(number) }
    }

    fn list(mut list: Vec<u32>) -> Self {
        list.sort_unstable();
        list.dedup();
        Snapshots::At(list)
    }
}

impl fmt::Display for Snapshots {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Snapshots::Every(step) => write!(f, "{step}"),
            Snapshots::At(list) => list.iter().try_for_each(|at| write!(f, "{at},")),
        }
    }
}

impl FromStr for Snapshots {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let number = |word: &str| {
            word.parse().map_err(|_| {
                Error::parameter(format_args!(
                    "{} must be a number N, for every N-th iteration, or a list of iterations, 0,6,46 (a single one \
                     with a comma behind it), not {text:?}",
                    Name::SNAPSHOTS
                ))
            })
        };
        match text.split_once(',') {
            None => Ok(Self::single(number(text)?)),
            Some(_) => {
                let words = text.strip_suffix(',').unwrap_or(text).split(',');
                Ok(Self::list(words.map(number).collect::<Result<_>>()?))
            }
        }
    }
}

impl Serialize for Snapshots {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Snapshots::Every(step) => step.serialize(serializer),
            Snapshots::At(list) => list.serialize(serializer),
        }
    }
}

/// As it may be written in JSON, TOML and queries.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "snapshots must be a number N, for every N-th iteration, or a list of iterations, as \
                               an array or as text 0,6,46"
)]
enum Written {
    Number(u32),
    List(Vec<u32>),
    Text(String),
}

impl<'de> Deserialize<'de> for Snapshots {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Written::deserialize(deserializer)? {
            Written::Number(number) => Ok(Self::single(number)),
            Written::List(list) => Ok(Self::list(list)),
            Written::Text(text) => text.parse().map_err(serde::de::Error::custom),
        }
    }
}

impl PartialSchema for Snapshots {
    fn schema() -> RefOr<Schema> {
        let number = || {
            ObjectBuilder::new()
                .schema_type(Type::Integer)
                .format(Some(SchemaFormat::KnownFormat(KnownFormat::Int64)))
                .minimum(Some(0))
                .maximum(Some(u32::MAX))
        };
        let text = ObjectBuilder::new().schema_type(Type::String).pattern(Some(Self::PATTERN));
        Schema::from(
            OneOfBuilder::new()
                .item(number())
                .item(ArrayBuilder::new().items(number()))
                .item(text)
                .examples([json!(10), json!([0, 6, 46]), json!("0,6,46")])
                .description(Some(
                    "Iterations whose labels are kept: a number `N` for every N-th, or a list, as an array or as text \
                     `0,6,46` (a single one with a comma behind it); 0 is the initial growth.",
                )),
        )
        .into()
    }
}

impl ToSchema for Snapshots {
    fn name() -> Cow<'static, str> {
        "Snapshots".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_numbers_and_arrays_say_the_same() {
        let at = |list: &[u32]| Snapshots::At(list.to_vec());
        for (text, json, expected) in [
            ("10", "10", Snapshots::Every(10)),
            ("0", "0", at(&[0])),
            ("6,", "[6]", at(&[6])),
            ("46,0,6,6", "[0,6,46]", at(&[0, 6, 46])),
        ] {
            assert_eq!(text.parse(), Ok(expected.clone()));
            assert_eq!(expected.to_string().parse(), Ok(expected.clone()));
            assert_eq!(serde_json::from_str::<Snapshots>(json).ok(), Some(expected.clone()));
            assert_eq!(serde_json::from_str::<Snapshots>(&format!("{text:?}")).ok(), Some(expected.clone()));
            let written = serde_json::to_string(&expected).expect("JSON");
            assert_eq!(serde_json::from_str::<Snapshots>(&written).ok(), Some(expected), "{written}");
        }
        for text in ["", ",", "x", "-1", "1.5", "1,,2", "1;2", "4294967296", "1,x"] {
            assert!(text.parse::<Snapshots>().is_err(), "{text}");
        }
        for json in ["-1", "1.5", "null", "{}", r#"["1"]"#, "[-1]", "4294967296", r#""""#] {
            assert!(serde_json::from_str::<Snapshots>(json).is_err(), "{json}");
        }
    }
}
