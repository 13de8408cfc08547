//! Formats of files with points.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{npy, npz};

/// A format of files with points. All are recognised by their first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[schema(as = PointsFormat)]
pub enum Format {
    /// An array of NumPy.
    Npy,
    /// Several of them in an archive.
    Npz,
    /// An image without loss.
    Png,
    /// A photo.
    Jpeg,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 4] = [Self::Npy, Self::Npz, Self::Png, Self::Jpeg];

    /// The format of a file that begins with these bytes.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        Self::ALL.into_iter().find(|format| bytes.starts_with(format.magic()))
    }

    /// The format that a file's name suggests.
    pub fn from_file_name(name: &str) -> Option<Self> {
        let (_, extension) = name.rsplit_once('.')?;
        let extension = extension.to_ascii_lowercase();
        Self::ALL.into_iter().find(|format| match format {
            Self::Jpeg => ["jpg", "jpeg"].contains(&&extension[..]),
            format => format.name() == extension,
        })
    }

    /// The first bytes of its files.
    fn magic(self) -> &'static [u8] {
        match self {
            Self::Npy => npy::MAGIC,
            Self::Npz => npz::MAGIC,
            Self::Png => b"\x89PNG\r\n\x1a\n",
            Self::Jpeg => b"\xff\xd8\xff",
        }
    }

    /// Whether it is one of images.
    pub fn is_image(self) -> bool {
        matches!(self, Self::Png | Self::Jpeg)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Npy => "npy",
            Self::Npz => "npz",
            Self::Png => "png",
            Self::Jpeg => "jpeg",
        }
    }

    /// With its article, for messages: `a PNG`.
    pub fn noun(self) -> &'static str {
        match self {
            Self::Npy => "an .npy",
            Self::Npz => "an .npz",
            Self::Png => "a PNG",
            Self::Jpeg => "a JPEG",
        }
    }

    /// Every media type that is taken for it: one.
    pub fn media_types(self) -> &'static [&'static str] {
        match self {
            Self::Npy => &["application/x-npy"],
            Self::Npz => &["application/zip"],
            Self::Png => &["image/png"],
            Self::Jpeg => &["image/jpeg"],
        }
    }
}
