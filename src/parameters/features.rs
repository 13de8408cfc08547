//! Which edges clusters do not cross: `ANGLE`, `groups`, or both, in flags, queries and JSON.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize, Serializer};
use serde_json::json;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::Name;
use crate::error::{Error, Quoted, Result};

/// Which edges clusters do not cross. At least one of the two is there.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "Written")]
pub struct Features {
    /// Those at which the normals of two faces differ by more than this, in degrees.
    pub angle: Option<f64>,
    /// Those at which groups or materials meet.
    pub groups: bool,
}

/// As text, for the description of the interface; an angle above 180 is refused.
const PATTERN: &str = r"^([0-9]+(\.[0-9]+)?(,groups)?|groups(,[0-9]+(\.[0-9]+)?)?)$";

/// The word for groups and materials.
const GROUPS: &str = "groups";

impl fmt::Display for Features {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.angle, self.groups) {
            (Some(angle), true) => write!(f, "{angle},{GROUPS}"),
            (Some(angle), false) => write!(f, "{angle}"),
            (None, _) => f.write_str(GROUPS),
        }
    }
}

impl FromStr for Features {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let mut features = Self { angle: None, groups: false };
        for word in text.split(',') {
            let is_new = match word {
                GROUPS => !std::mem::replace(&mut features.groups, true),
                _ => {
                    let angle = word.parse().ok().filter(|angle| (0.0..=180.0).contains(angle));
                    features.angle.replace(angle.ok_or_else(|| wrong(text))?).is_none()
                }
            };
            if !is_new {
                return Err(wrong(text));
            }
        }
        Ok(features)
    }
}

fn wrong(text: &str) -> Error {
    Error::parameter(format_args!(
        "{} must be an angle from 0 to 180 degrees (40 is safe), {GROUPS}, or both, as 40,{GROUPS}, not {}",
        Name::FEATURES,
        Quoted(text)
    ))
}

impl Serialize for Features {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// As it may be written in JSON and queries.
#[derive(Deserialize)]
#[serde(untagged, expecting = "features must be an angle in degrees, groups, or both, as 40,groups")]
enum Written {
    Angle(f64),
    Text(String),
}

impl TryFrom<Written> for Features {
    type Error = Error;

    fn try_from(written: Written) -> Result<Self> {
        match written {
            Written::Angle(angle) => angle.to_string().parse(),
            Written::Text(text) => text.parse(),
        }
    }
}

impl PartialSchema for Features {
    fn schema() -> RefOr<Schema> {
        let angle = ObjectBuilder::new().schema_type(Type::Number).minimum(Some(0)).maximum(Some(180));
        let text = ObjectBuilder::new().schema_type(Type::String).pattern(Some(PATTERN));
        Schema::from(
            OneOfBuilder::new()
                .item(angle)
                .item(text)
                .examples([json!(40), json!("40,groups")])
                .description(Some("Which edges clusters do not cross: an angle in degrees, `groups`, or both.")),
        )
        .into()
    }
}

impl ToSchema for Features {
    fn name() -> Cow<'static, str> {
        "Features".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_written_as_it_is_read() {
        let of = |angle, groups| Features { angle, groups };
        for (text, features) in [
            ("40", of(Some(40.0), false)),
            ("0", of(Some(0.0), false)),
            ("22.5,groups", of(Some(22.5), true)),
            ("groups", of(None, true)),
        ] {
            assert_eq!((text.parse(), features.to_string()), (Ok(features), text.to_owned()));
            assert_eq!(serde_json::to_value(features).expect("JSON"), text);
            assert_eq!(serde_json::from_value::<Features>(json!(text)).expect("JSON"), features);
        }
        assert_eq!("groups,180".parse(), Ok(of(Some(180.0), true)));
        assert_eq!(serde_json::from_value::<Features>(json!(40)).expect("JSON"), of(Some(40.0), false));
    }

    #[test]
    fn what_is_no_angle_and_not_groups_is_refused_with_an_example() {
        for text in ["", "181", "-1", "nan", "inf", "30,", ",groups", "30,40", "groups,groups", "group", "30 groups"] {
            let error = text.parse::<Features>().expect_err(text);
            assert!(error.message.contains("40,groups") && error.message.contains(text), "{error}");
            assert!(serde_json::from_value::<Features>(json!(text)).is_err());
        }
        for json in [json!(180.5), json!(-1), json!(true), json!(["groups"])] {
            assert!(serde_json::from_value::<Features>(json).is_err());
        }
    }
}
