//! What a glTF JSON says first: that it is glTF, and of which version.
//!
//! Each way in which `asset` is wrong has its own message, since files of version 1.0, and JSON that is no glTF at all,
//! are sent often.

use std::fmt;

use serde::de::{Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{Brief, Error, Quoted, Result, wrong_json};

/// The parts of the JSON that tell its version.
#[derive(Debug, Deserialize)]
struct Head {
    asset: Option<Value>,
    #[serde(default)]
    meshes: Container,
}

/// What holds the meshes: an array, or in version 1.0 an object.
#[derive(Debug, Default, PartialEq, Eq)]
enum Container {
    #[default]
    Other,
    Object,
}

impl<'de> Deserialize<'de> for Container {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Of;
        impl<'de> Visitor<'de> for Of {
            type Value = Container;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("meshes")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Container, A::Error> {
                while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(Container::Object)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut array: A) -> Result<Container, A::Error> {
                while array.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Container::Other)
            }
        }
        deserializer.deserialize_any(Of)
    }
}

/// Refuses what is not glTF 2.0.
pub fn check(json: &[u8]) -> Result<()> {
    if json.trim_ascii_start().first() != Some(&b'{') {
        return Err(Error::mesh("the glTF JSON must be an object, and does not begin with {"));
    }
    let head: Head = serde_json::from_slice(json).map_err(|error| unreadable::<Head>(json, error))?;
    let Some(asset) = head.asset else {
        if head.meshes == Container::Object {
            return Err(of_version_1());
        }
        return Err(Error::mesh(
            "the JSON is not glTF, or not complete: it has no asset; a glTF file has \"asset\": {\"version\": \"2.0\"}",
        ));
    };
    if !asset.is_object() {
        return Err(Error::mesh(format_args!(
            "asset must be an object such as {{\"version\": \"2.0\"}}: {}",
            short(&asset)
        )));
    }
    let version = text(&asset, "version")?;
    let least = text(&asset, "minVersion")?;
    if version.is_some_and(|version| version == "1" || version.starts_with("1."))
        || version.is_none() && head.meshes == Container::Object
    {
        return Err(of_version_1());
    }
    let Some(version) = version else {
        return Err(Error::mesh("asset has no version, which must be \"2.0\""));
    };
    if version.is_empty() {
        return Err(Error::mesh("asset.version is empty, and must be \"2.0\""));
    }
    let (name, wanted, is_read) = match least {
        Some(least) => ("minVersion", least, least == "2.0"),
        None => ("version", version, version.split('.').next() == Some("2")),
    };
    if is_read {
        return Ok(());
    }
    Err(Error::unsupported(format_args!(
        "only glTF 2.0 is read: export the mesh as glTF 2.0; asset.{name} is {}",
        Quoted(wanted)
    )))
}

/// A file of version 1.0.
pub fn of_version_1() -> Error {
    Error::unsupported(
        "this is glTF 1.0, and only glTF 2.0 is read: convert it, for example with gltf-pipeline or by exporting it \
         again",
    )
}

/// The string that a field of `asset` must be; none where it is missing.
fn text<'a>(asset: &'a Value, field: &str) -> Result<Option<&'a str>> {
    match asset.get(field) {
        None => Ok(None),
        Some(Value::String(text)) => Ok(Some(text)),
        Some(other) => {
            Err(Error::mesh(format_args!("asset.{field} must be a string such as \"2.0\": {}", short(other))))
        }
    }
}

/// A JSON value in a message.
fn short(value: &impl Serialize) -> String {
    Brief(serde_json::to_string(value).unwrap_or_default()).to_string()
}

/// Why the JSON cannot be read as a `T`: where, by line and by path, and what.
pub fn unreadable<'de, T: Deserialize<'de>>(json: &'de [u8], error: serde_json::Error) -> Error {
    let (line, column) = (error.line(), error.column());
    let what = wrong_json(&error);
    let place = format!("line {line}, column {column}");
    if error.is_eof() {
        return Error::mesh(format_args!("the glTF JSON is truncated: it ends in the middle of a value at {place}"));
    }
    if !error.is_data() {
        return Error::mesh(format_args!("the glTF JSON is damaged at {place}: {}", Brief(what)));
    }
    // read once more, now noting the path, which costs time
    let path = serde_path_to_error::deserialize::<_, T>(&mut serde_json::Deserializer::from_slice(json));
    let path = path.err().map(|error| error.path().to_string()).unwrap_or_default();
    Error::mesh(format_args!("the glTF JSON has a wrong value at {place}, {}: {}", Quoted(&path), Brief(what)))
}
