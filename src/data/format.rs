//! Formats of files with points.

use serde::Serialize;
use utoipa::ToSchema;

use super::{npy, npz};

/// A format of files with points. All are recognised by their first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[schema(as = PointsFormat)]
pub enum Format {
    /// An array of NumPy.
    Npy,
    /// Several of them in an archive.
    Npz,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 2] = [Self::Npy, Self::Npz];

    /// The format of a file that begins with these bytes.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        Self::ALL.into_iter().find(|format| bytes.starts_with(format.magic()))
    }

    /// The first bytes of its files.
    fn magic(self) -> &'static [u8] {
        match self {
            Self::Npy => npy::MAGIC,
            Self::Npz => npz::MAGIC,
        }
    }

    /// Its name, and the extension of its files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Npy => "npy",
            Self::Npz => "npz",
        }
    }

    /// Its media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Npy => "application/x-npy",
            Self::Npz => "application/zip",
        }
    }
}
