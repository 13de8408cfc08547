//! Formats of all that jobs are on: meshes and points.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};
use utoipa::openapi::{ObjectBuilder, RefOr, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use crate::artifacts::{Artifact, Need};
use crate::data::Format as PointsFormat;
use crate::error::{Error, Quoted, Result};
use crate::mesh::Format as MeshFormat;

/// The format of a file that a job is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Format {
    /// Of meshes.
    Mesh(MeshFormat),
    /// Of points.
    Points(PointsFormat),
}

impl Format {
    /// Every format, meshes first.
    pub fn all() -> impl Iterator<Item = Self> {
        MeshFormat::ALL.into_iter().map(Self::Mesh).chain(PointsFormat::ALL.into_iter().map(Self::Points))
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mesh(format) => format.name(),
            Self::Points(format) => format.name(),
        }
    }

    /// With its article, for messages.
    pub fn noun(self) -> &'static str {
        match self {
            Self::Mesh(format) => format.noun(),
            Self::Points(format) => format.noun(),
        }
    }

    /// Every media type that is taken for it, the usual one first.
    pub fn media_types(self) -> &'static [&'static str] {
        match self {
            Self::Mesh(format) => format.media_types(),
            Self::Points(format) => format.media_types(),
        }
    }

    /// The usual media type.
    pub fn media_type(self) -> &'static str {
        self.media_types()[0]
    }

    /// Whether it is one of points.
    pub fn is_of_points(self) -> bool {
        matches!(self, Self::Points(_))
    }

    /// Whether it is one of images.
    pub fn is_image(self) -> bool {
        matches!(self, Self::Points(format) if format.is_image())
    }

    /// What an output is made of, if jobs on files of this format do not have it: for messages.
    pub fn lacks(self, artifact: &Artifact) -> Option<&'static str> {
        if artifact.needs(Need::Image) && !self.is_image() {
            return Some("an image, and this is none");
        }
        (artifact.is_of_meshes_alone() && self.is_of_points()).then_some("a mesh, and these are points")
    }

    /// Whether a file may refer to buffers in other files.
    pub fn has_buffers(self) -> bool {
        matches!(self, Self::Mesh(format) if format.has_buffers())
    }

    /// The format of that name.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::all().find(|format| format.name().eq_ignore_ascii_case(name)).ok_or_else(|| {
            let names: Vec<&str> = Self::all().map(Self::name).collect();
            Error::parameter(format_args!("format must be one of {}, not {}", names.join(", "), Quoted(name)))
        })
    }

    /// The format of a media type (parameters after `;` are ignored), if it is one of ours.
    pub fn from_media_type(media_type: &str) -> Option<Self> {
        let essence = media_type.split(';').next().unwrap_or_default().trim();
        Self::all().find(|format| format.media_types().iter().any(|known| known.eq_ignore_ascii_case(essence)))
    }

    /// The format of a file: that of points by its first bytes, that of a mesh by name, then by its first bytes and its
    /// length in bytes, where that is known.
    pub fn recognise(name: Option<&str>, head: &[u8], length: Option<u64>) -> Result<Self> {
        if let Some(format) = PointsFormat::of(head) {
            return Ok(Self::Points(format));
        }
        match name.and_then(PointsFormat::from_file_name) {
            Some(format) => Self::Points(format).check_head(head, length).map(|()| Self::Points(format)),
            None => MeshFormat::recognise(name, head, length).map(Self::Mesh),
        }
    }

    /// Refuses a file whose first bytes are plainly not of this format. Lengths are as in
    /// [`MeshFormat::check_head`].
    pub fn check_head(self, head: &[u8], length: Option<u64>) -> Result<()> {
        match self {
            Self::Mesh(format) => format.check_head(head, length),
            Self::Points(format) if PointsFormat::of(head) == Some(format) => Ok(()),
            Self::Points(format) if head.is_empty() => {
                Err(Error::parameter(format_args!("this is not {} file: it is empty", format.noun())))
            }
            Self::Points(format) => Err(Error::parameter(format_args!(
                "this is not {} file: its first bytes are {}",
                format.noun(),
                Quoted(&String::from_utf8_lossy(&head[..head.len().min(8)]))
            ))),
        }
    }
}

impl PartialSchema for Format {
    fn schema() -> RefOr<Schema> {
        let names = Some(Self::all().map(Self::name));
        ObjectBuilder::new().schema_type(Type::String).enum_values(names).into()
    }
}

impl ToSchema for Format {
    fn name() -> Cow<'static, str> {
        "InputFormat".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_media_types_lead_to_one_format_each() {
        for format in Format::all() {
            assert_eq!(Format::from_name(format.name()), Ok(format));
            assert_eq!(Format::from_media_type(format.media_type()), Some(format));
            // in stored jobs
            let name = serde_json::to_value(format).expect("JSON");
            assert_eq!(name, format.name());
            assert_eq!(serde_json::from_value::<Format>(name).expect("a format"), format);
        }
        assert!(Format::from_name("tiff").expect_err("unknown").message.contains("jpeg"));
    }

    #[test]
    fn points_are_recognised_by_their_first_bytes_whatever_their_name() {
        let png = b"\x89PNG\r\n\x1a\n....";
        assert_eq!(Format::recognise(Some("a.obj"), png, None), Ok(Format::Points(PointsFormat::Png)));
        let error = Format::recognise(Some("x.NPZ"), b"PK\x05\x06", None).expect_err("an empty archive");
        assert!(error.message.starts_with("this is not an .npz file"), "{error}");
        assert_eq!(Format::recognise(Some("a.obj"), b"v 0 0 0", None), Ok(Format::Mesh(MeshFormat::Obj)));
        assert!(Format::Points(PointsFormat::Jpeg).check_head(png, None).is_err());
        assert_eq!(Format::Points(PointsFormat::Png).check_head(png, None), Ok(()));
    }
}
