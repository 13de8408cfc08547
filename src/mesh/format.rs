//! Which format a mesh is in: by media type, by file name, by content.

mod foreign;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::error::{Error, Kind, Result};

/// A mesh format that is read here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
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
        const STATEMENTS: [&[u8]; 16] = [
            b"v", b"vn", b"vt", b"vp", b"f", b"fo", b"g", b"o", b"s", b"l", b"p", b"mg", b"mtllib", b"usemtl",
            b"cstype", b"deg",
        ];
        if head.starts_with(b"glTF") {
            return Some(Format::Glb);
        }
        let text = without_mark(head).trim_ascii_start();
        if text.first() == Some(&b'{') {
            return Some(Format::Gltf);
        }
        let keyword = text.split(|byte| byte.is_ascii_whitespace()).next().unwrap_or_default();
        let is_obj = STATEMENTS.contains(&keyword) || keyword.starts_with(b"#");
        (is_obj && !text.contains(&0)).then_some(Format::Obj)
    }

    /// The format of a file: by name, then by content.
    pub fn recognise(name: Option<&str>, head: &[u8]) -> Result<Self> {
        if let Some(format) = name.and_then(Self::from_file_name).or_else(|| Self::from_content(head)) {
            return Ok(format);
        }
        let message = match foreign::recognise(head) {
            _ if head.is_empty() => format!("the file is empty; meshes are read as {}", names()),
            Some(foreign) => format!("this is {}, which is not read: {}", foreign.name, foreign.advice),
            None => format!("neither name nor content is that of a mesh format read here: {}", names()),
        };
        Err(Error::new(Kind::UnsupportedMediaType, message))
    }

    /// Refuses a file whose first bytes are plainly not of this format: the cheap check made before a job is accepted.
    ///
    /// `head` is the first 20 bytes at least, or the whole file; `length` is the length of the whole file in bytes, where
    /// it is known.
    pub fn check_head(self, head: &[u8], length: Option<u64>) -> Result<()> {
        let wanted = match self {
            Format::Obj => "an OBJ file",
            Format::Glb => "a GLB file",
            Format::Gltf => "a glTF JSON file",
        };
        let not = |what: &str| Err(Error::mesh(format_args!("this is not {wanted}: {what}")));
        if length == Some(0) || length.is_none() && head.is_empty() && self != Format::Obj {
            return not("it is empty");
        }
        if let Some(foreign) = foreign::recognise(head) {
            return not(&format!("it is {}; {}", foreign.name, foreign.advice));
        }
        let content = Self::from_content(head);
        match self {
            Format::Glb => super::gltf::check_glb_head(head, length),
            Format::Gltf | Format::Obj if head.starts_with(b"glTF") => {
                not("it begins like a GLB file; name it .glb, or send it as glb")
            }
            Format::Gltf if content == Some(Format::Obj) => {
                not("it begins like an OBJ file; name it .obj, or send it as obj")
            }
            Format::Gltf if content != Some(Format::Gltf) => not("it does not begin with {, as every glTF JSON does"),
            Format::Obj if head.contains(&0) => not("it holds zero bytes, so it is no text"),
            Format::Obj if content == Some(Format::Gltf) => {
                not("it begins like JSON; name it .gltf, or send it as gltf")
            }
            Format::Gltf | Format::Obj => Ok(()),
        }
    }
}

/// The text without its byte order mark.
fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// The short names of all formats, for messages.
fn names() -> String {
    Format::ALL.map(Format::name).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_media_types_lead_to_formats() {
        for format in Format::ALL {
            assert_eq!(Format::from_name(format.name()), Ok(format));
            assert_eq!(Format::from_media_type(format.media_type()), Some(format));
            let file = format!("My Mesh.v2.{}", format.name().to_uppercase());
            assert_eq!(Format::from_file_name(&file), Some(format));
        }
        let with_parameters = Format::from_media_type(" Model/OBJ ; charset=utf-8");
        assert_eq!(with_parameters, Some(Format::Obj));
        assert_eq!(Format::from_media_type("application/octet-stream"), None);
        assert_eq!(Format::from_file_name("obj"), None);
        assert_eq!(Format::from_file_name("mesh.obj.gz"), None);
        let error = Format::from_name("ply").expect_err("not read");
        assert_eq!(error.kind, Kind::InvalidParameter);
    }

    #[test]
    fn content_decides_where_the_name_does_not() {
        for (head, format) in [
            (&b"glTF\x02"[..], Format::Glb),
            (b"{}", Format::Gltf),
            (b"\xef\xbb\xbf \r\n\t{", Format::Gltf),
            (b"# comment", Format::Obj),
            (b"#comment", Format::Obj),
            (b"\n\n  v 1 2 3", Format::Obj),
            (b"\xef\xbb\xbfmtllib a.mtl\r\n", Format::Obj),
            (b"o thing\rv 1 2 3", Format::Obj),
        ] {
            assert_eq!(Format::recognise(None, head), Ok(format));
            assert_eq!(Format::recognise(Some("mesh.bin"), head), Ok(format));
            assert_eq!(format.check_head(b"", None).is_ok(), format == Format::Obj);
        }
        assert_eq!(Format::recognise(Some("a.obj"), b"{}"), Ok(Format::Obj));
        for (head, word) in [
            (&b"\x1f\x8b\x08"[..], "gzip"),
            (b"ply\nformat", "PLY"),
            (b"solid x", "STL"),
            (b"<html>", "HTML"),
            (b"PK\x03\x04", "ZIP"),
            (b"", "empty"),
            (b"voxel 1", "neither name nor content"),
            (b"v 1 2 3\0", "neither name nor content"),
        ] {
            let error = Format::recognise(None, head).expect_err("not read");
            assert_eq!(error.kind, Kind::UnsupportedMediaType);
            assert!(error.message.contains(word), "{error}");
        }
    }

    #[test]
    fn files_that_are_not_what_they_are_called_are_refused() {
        for (format, head, word) in [
            (Format::Obj, &b"glTF\x02\0\0\0"[..], "GLB"),
            (Format::Obj, b"{\"asset\":", "JSON"),
            (Format::Obj, b"\x1f\x8b\x08\x00", "gzip"),
            (Format::Obj, b"v 1 2 3\n\0", "zero bytes"),
            (Format::Gltf, b"v 1 2 3", "OBJ"),
            (Format::Gltf, b"glTF\x02\0\0\0", "GLB"),
            (Format::Gltf, b"\x1f\x8b", "gzip"),
            (Format::Glb, b"{", "magic"),
            (Format::Glb, b"\x1f\x8b", "gzip"),
        ] {
            let error = format.check_head(head, None).expect_err("refused");
            assert_eq!(error.kind, Kind::InvalidMesh);
            assert!(error.message.contains(word), "{error}");
        }
        for format in Format::ALL {
            assert!(format.check_head(b"", Some(0)).is_err());
        }
        assert_eq!(Format::Obj.check_head(b"v 1 2 3\nf 1 1 1", Some(15)), Ok(()));
        assert_eq!(Format::Gltf.check_head(b"\n{\"asset\"", None), Ok(()));
    }
}
