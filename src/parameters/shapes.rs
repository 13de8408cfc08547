//! Which shapes clusters may have, and below which distance they all are alike.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::json;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::Name;
use crate::error::{Error, Quoted, Result};
use crate::shapes::kind::Kind;

/// Types of shapes that clusters may have, planes among them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shapes(pub Vec<Kind>);

impl Default for Shapes {
    fn default() -> Self {
        Self(Kind::USUAL.to_vec())
    }
}

impl Shapes {
    /// Planes alone.
    pub fn planes() -> Self {
        Self(vec![Kind::Plane])
    }
}

impl fmt::Display for Shapes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.iter().map(|kind| kind.name()).collect::<Vec<_>>().join(","))
    }
}

impl FromStr for Shapes {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            let all = Self(Kind::ALL.to_vec());
            Error::parameter(format_args!("{} must be some of {all}, not {}", Name::SHAPES, Quoted(text)))
        };
        let mut kinds = vec![Kind::Plane];
        for word in text.split(',') {
            kinds.push(Kind::ALL.into_iter().find(|kind| kind.name() == word).ok_or_else(wrong)?);
        }
        kinds.sort_unstable();
        kinds.dedup();
        Ok(Self(kinds))
    }
}

/// A length: a share of the diagonal of the bounding box, or with a `u` behind it a length of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Length {
    /// Of the diagonal.
    Share(f64),
    /// In units of the file.
    Units(f64),
}

impl Length {
    /// As a share of a diagonal.
    pub fn share_of(self, diagonal: f64) -> f64 {
        match self {
            Length::Share(share) => share,
            Length::Units(length) => length / diagonal,
        }
    }

    /// The length divided by a number.
    pub fn over(self, by: f64) -> Self {
        match self {
            Length::Share(share) => Length::Share(share / by),
            Length::Units(length) => Length::Units(length / by),
        }
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (number, unit) = match self {
            Length::Share(share) => (share, ""),
            Length::Units(length) => (length, "u"),
        };
        match (1e-6..1e16).contains(number) {
            true => write!(f, "{number}{unit}"),
            false => write!(f, "{number:e}{unit}"),
        }
    }
}

impl FromStr for Length {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let number = |text: &str| text.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0);
        let length = match text.strip_suffix('u') {
            Some(text) => number(text).map(Length::Units),
            None => number(text).filter(|&share| share <= 1.0).map(Length::Share),
        };
        length.ok_or_else(|| {
            Error::parameter(format_args!(
                "{} and {} must be a share of the diagonal of the mesh, above 0 and at most 1, or a length as 0.5u, \
                 not {}",
                Name::RESOLUTION,
                Name::TOLERANCE,
                Quoted(text)
            ))
        })
    }
}

/// As a length may be written in JSON and queries.
#[derive(Deserialize)]
#[serde(untagged, expecting = "resolution and tolerance must be a share of the diagonal, or a length as 0.5u")]
enum Written {
    Share(f64),
    Text(String),
}

impl<'de> Deserialize<'de> for Length {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = match Written::deserialize(deserializer)? {
            Written::Share(share) => share.to_string(),
            Written::Text(text) => text,
        };
        text.parse().map_err(serde::de::Error::custom)
    }
}

impl Serialize for Length {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Length::Share(share) => serializer.serialize_f64(*share),
            Length::Units(_) => serializer.collect_str(self),
        }
    }
}

impl<'de> Deserialize<'de> for Shapes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

impl Serialize for Shapes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl PartialSchema for Shapes {
    fn schema() -> RefOr<Schema> {
        let one = format!("({})", Kind::ALL.map(|kind| kind.name()).join("|"));
        ObjectBuilder::new()
            .schema_type(Type::String)
            .pattern(Some(format!("^{one}(,{one})*$")))
            .examples([json!("plane,sphere,cylinder"), json!("plane,sphere,cylinder,cone")])
            .description(Some("Types of shapes that clusters may have; planes always."))
            .into()
    }
}

impl ToSchema for Shapes {
    fn name() -> Cow<'static, str> {
        "Shapes".into()
    }
}

impl PartialSchema for Length {
    fn schema() -> RefOr<Schema> {
        let share = ObjectBuilder::new().schema_type(Type::Number).exclusive_minimum(Some(0)).maximum(Some(1));
        let text = ObjectBuilder::new().schema_type(Type::String).pattern(Some(r"^[0-9.]+(e-?[0-9]+)?u?$"));
        let about = "A share of the diagonal of the bounding box; with `u` behind it, a length in units of the file.";
        Schema::from(
            OneOfBuilder::new()
                .item(share)
                .item(text)
                .examples([json!(0.0003), json!("0.5u")])
                .description(Some(about)),
        )
        .into()
    }
}

impl ToSchema for Length {
    fn name() -> Cow<'static, str> {
        "Length".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_have_planes_and_an_order() {
        for (text, list) in [
            ("plane", "plane"),
            ("cylinder", "plane,cylinder"),
            ("cone,cylinder,plane,sphere,plane", "plane,sphere,cylinder,cone"),
        ] {
            let shapes: Shapes = text.parse().expect(text);
            assert_eq!(shapes.to_string(), list);
            assert_eq!(serde_json::from_value::<Shapes>(json!(text)).expect("JSON"), shapes);
        }
        for text in ["", "torus", "plane,", "Plane", "plane sphere"] {
            let error = text.parse::<Shapes>().expect_err(text);
            assert!(error.message.contains("plane,sphere,cylinder,cone") && error.message.contains(text), "{error}");
        }
    }

    #[test]
    fn lengths_are_shares_or_have_a_unit() {
        for (text, length, share) in [
            ("0.0003", Length::Share(0.0003), 0.0003),
            ("1", Length::Share(1.0), 1.0),
            ("0.5u", Length::Units(0.5), 0.125),
            ("2e3u", Length::Units(2000.0), 500.0),
        ] {
            assert_eq!(text.parse(), Ok(length));
            assert_eq!(length.share_of(4.0), share);
            let value = serde_json::to_value(length).expect("JSON");
            assert_eq!(serde_json::from_value::<Length>(value).expect("JSON"), length);
        }
        assert_eq!(
            ["1e-300u", "0.00004u", "3e200u"].map(|text| text.parse::<Length>().expect(text).to_string()),
            ["1e-300u", "0.00004u", "3e200u"]
        );
        for text in ["", "0", "-1", "1.5", "u", "0u", "nan", "infu", "1 u", "1mm"] {
            let error = text.parse::<Length>().expect_err(text);
            assert!(error.message.contains("0.5u"), "{error}");
        }
    }
}
