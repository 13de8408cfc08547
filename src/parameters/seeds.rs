//! Where clusters start, as text: a name, or a file on the command line.

use std::ffi::OsString;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{Name, names};
pub use crate::cluster::seeds::Seeds;
use crate::error::{Error, Result};

impl fmt::Display for Seeds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Seeds::Coarse => f.write_str("coarse"),
            Seeds::Merged => f.write_str("merged"),
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
            "coarse" => Ok(Seeds::Coarse),
            "merged" => Ok(Seeds::Merged),
            "morton" => Ok(Seeds::Morton),
            "random" => Ok(Seeds::Random),
            "listed" => Ok(Seeds::Listed),
            _ => match text.strip_prefix("file:") {
                Some(path) if !path.is_empty() => Ok(Seeds::File(path.into())),
                _ => Err(Error::parameter(format_args!(
                    "{} must be coarse, merged, morton, random or {}, not {text:?}",
                    Name::SEEDS,
                    if names::are_flags() { "file:PATH" } else { "listed (a part named seeds)" }
                ))),
            },
        }
    }
}

impl Seeds {
    /// Seeds as an argument of the command line, where a path may have any bytes.
    pub(crate) fn from_argument(argument: OsString) -> Result<Self> {
        if let Some(text) = argument.to_str() {
            return text.parse();
        }
        #[cfg(unix)]
        {
            use std::os::unix::ffi::{OsStrExt, OsStringExt};
            if let Some(path) = argument.as_bytes().strip_prefix(b"file:") {
                return Ok(Seeds::File(OsString::from_vec(path.to_vec()).into()));
            }
        }
        argument.to_string_lossy().parse()
    }
}

impl Serialize for Seeds {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Seeds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}
