//! Which format a mesh is in: by media type, by file name, by content.

use serde::Serialize;
use utoipa::ToSchema;

use crate::error::{Error, Kind, Result};

/// A mesh format that is read here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0, binary container.
    Glb,
    /// glTF 2.0, JSON.
    Gltf,
}

impl Format {
    /// Every format.
    pub const ALL: [Format; 3] = [Format::Obj, Format::Glb, Format::Gltf];

    /// Short name, also the usual file extension and the value of `?format=`.
    pub fn name(self) -> &'static str {
        match self {
            Format::Obj => "obj",
            Format::Glb => "glb",
            Format::Gltf => "gltf",
        }
    }

    /// IANA media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Format::Obj => "model/obj",
            Format::Glb => "model/gltf-binary",
            Format::Gltf => "model/gltf+json",
        }
    }

    /// The format of that short name.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|format| format.name().eq_ignore_ascii_case(name))
            .ok_or_else(|| Error::parameter(format_args!("format must be one of {}, not {name:?}", names())))
    }

    /// The format of a media type (parameters after `;` are ignored), if it is one of ours.
    pub fn from_media_type(media_type: &str) -> Option<Self> {
        let essence = media_type.split(';').next().unwrap_or_default().trim();
        Self::ALL.into_iter().find(|format| format.media_type().eq_ignore_ascii_case(essence))
    }

    /// The format that a file's name suggests.
    pub fn from_file_name(name: &str) -> Option<Self> {
        let (_, extension) = name.rsplit_once('.')?;
        Self::ALL.into_iter().find(|format| format.name().eq_ignore_ascii_case(extension))
    }

    /// The format that the first bytes suggest: the GLB magic, a JSON object, or text that begins like an OBJ.
    pub fn from_content(head: &[u8]) -> Option<Self> {
        if head.starts_with(b"glTF") {
            return Some(Format::Glb);
        }
        let text = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).trim_ascii_start();
        if text.first() == Some(&b'{') {
            return Some(Format::Gltf);
        }
        let keyword = text.split(|byte| byte.is_ascii_whitespace()).next().unwrap_or_default();
        let known: [&[u8]; 13] =
            [b"v", b"vn", b"vt", b"vp", b"f", b"g", b"o", b"s", b"l", b"p", b"mtllib", b"usemtl", b"#"];
        (known.contains(&keyword) || keyword.starts_with(b"#")).then_some(Format::Obj)
    }

    /// The format of a file: by name, then by content.
    pub fn recognise(name: Option<&str>, head: &[u8]) -> Result<Self> {
        name.and_then(Self::from_file_name).or_else(|| Self::from_content(head)).ok_or_else(|| {
            Error::new(
                Kind::UnsupportedMediaType,
                format_args!("neither name nor content is that of a mesh format read here ({})", names()),
            )
        })
    }

    /// Refuses a file whose first bytes are plainly not of this format: the cheap check made before a job is accepted.
    ///
    /// `length` is the length of the whole file in bytes, where it is known.
    pub fn check_head(self, head: &[u8], length: Option<u64>) -> Result<()> {
        match self {
            Format::Glb => super::gltf::check_glb_head(head, length),
            Format::Gltf if Self::from_content(head) != Some(Format::Gltf) => {
                Err(Error::mesh("this is not a glTF JSON file: it does not begin with an object"))
            }
            Format::Obj if head.starts_with(b"glTF") => {
                Err(Error::mesh("this is not an OBJ file: it begins with the magic of a binary glTF"))
            }
            Format::Obj if head.contains(&0) => Err(Error::mesh("this is not an OBJ file: it holds zero bytes")),
            Format::Gltf | Format::Obj => Ok(()),
        }
    }
}

/// The short names of all formats, for messages.
fn names() -> String {
    Format::ALL.map(Format::name).join(", ")
}
