//! A list of numbers of clusters: `K1,K2,…` in flags and queries, that or an array in JSON.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::json;
use utoipa::openapi::schema::{ArrayBuilder, KnownFormat, ObjectBuilder, OneOfBuilder, SchemaFormat, Type};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::Name;
use crate::error::{Error, Result};

/// Numbers of clusters, in the order they were given.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Levels(pub Vec<u64>);

impl Levels {
    /// A list as it is written in flags and queries, for the description of the interface.
    pub const PATTERN: &'static str = "^[1-9][0-9]{0,17}(,[1-9][0-9]{0,17})*$";

    fn check(self) -> Result<Self> {
        match self.0.contains(&0) {
            true => Err(Error::parameter(format_args!("{} must each be at least 1, not 0", Name::LEVELS))),
            false => Ok(self),
        }
    }
}

impl fmt::Display for Levels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (nth, level) in self.0.iter().enumerate() {
            if nth > 0 {
                f.write_str(",")?;
            }
            write!(f, "{level}")?;
        }
        Ok(())
    }
}

impl FromStr for Levels {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let number = |word: &str| {
            word.parse().map_err(|_| {
                Error::parameter(format_args!("{} must be numbers of clusters, K1,K2,…, not {text:?}", Name::LEVELS))
            })
        };
        Levels(text.split(',').map(number).collect::<Result<_>>()?).check()
    }
}

impl<'de> Deserialize<'de> for Levels {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;

        impl<'de> Visitor<'de> for Either {
            type Value = Levels;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("numbers of clusters, as an array or as text K1,K2,…")
            }

            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Levels, E> {
                text.parse().map_err(E::custom)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Levels, A::Error> {
                let mut levels = Vec::new();
                while let Some(level) = items.next_element()? {
                    levels.push(level);
                }
                Levels(levels).check().map_err(serde::de::Error::custom)
            }
        }

        deserializer.deserialize_any(Either)
    }
}

impl PartialSchema for Levels {
    fn schema() -> RefOr<Schema> {
        let number = ObjectBuilder::new()
            .schema_type(Type::Integer)
            .format(Some(SchemaFormat::KnownFormat(KnownFormat::Int64)))
            .minimum(Some(1));
        let text = ObjectBuilder::new().schema_type(Type::String).pattern(Some(Self::PATTERN));
        Schema::from(
            OneOfBuilder::new()
                .item(ArrayBuilder::new().items(number))
                .item(text)
                .examples([json!([2000, 1000]), json!("2000,1000")])
                .description(Some("Numbers of clusters, as an array or as text `K1,K2,…`.")),
        )
        .into()
    }
}

impl ToSchema for Levels {
    fn name() -> Cow<'static, str> {
        "Levels".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_arrays_say_the_same() {
        let levels = Levels(vec![2000, 1000]);
        assert_eq!("2000,1000".parse(), Ok(levels.clone()));
        assert_eq!(levels.to_string(), "2000,1000");
        for json in ["[2000, 1000]", r#""2000,1000""#] {
            assert_eq!(serde_json::from_str::<Levels>(json).ok(), Some(levels.clone()), "{json}");
        }
        assert_eq!(serde_json::to_string(&levels).ok().as_deref(), Some("[2000,1000]"));
        assert_eq!(serde_json::from_str::<Levels>("[]").ok(), Some(Levels::default()));
    }

    #[test]
    fn what_is_no_list_of_numbers_is_refused() {
        for text in ["", ",", "5,", "5,,6", "0", "5,0", "-1", "1.5", "5;6", "99999999999999999999"] {
            assert!(text.parse::<Levels>().is_err(), "{text}");
        }
        for json in ["[0]", "[1.5]", "[-1]", "7", "null", "{}", r#"[["5"]]"#, r#""""#] {
            assert!(serde_json::from_str::<Levels>(json).is_err(), "{json}");
        }
    }
}
