//! The mesh formats: one table with all that is known of each, and the lookups in it.
//!
//! The command line, `Accept-Post`, `GET /v1/formats`, the OpenAPI document and messages take names and media types
//! from here. A new format is a folder with its reader, a variant of [`Format`] and a row of [`TABLE`].

mod foreign;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Reader, gltf, obj, off, ply, stl};
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
    /// PLY, text or binary.
    Ply,
    /// STL, text or binary.
    Stl,
    /// OFF of Geomview, text.
    Off,
}

/// What is known of a format.
struct FormatRow {
    format: Format,
    /// File extensions; the first is also the short name and the value of `?format=`.
    extensions: &'static [&'static str],
    /// Media types; the first is the one registered with IANA, where one is.
    media_types: &'static [&'static str],
    /// With its article, before "file" in messages.
    noun: &'static str,
    /// What a file that begins like this format is said to begin like.
    begins_like: &'static str,
    /// Whether a file with these first bytes is of this format. Its length in bytes is given if it is known.
    is_it: fn(&[u8], Option<u64>) -> bool,
    /// What contradicts this format in the first bytes; the length as in `is_it`.
    check_head: fn(&[u8], Option<u64>) -> Result<()>,
    /// Whether a file may refer to buffers in other files.
    has_buffers: bool,
    /// Whether vertices may have attributes with names.
    has_attributes: bool,
    /// Whether faces may be of groups or materials.
    has_groups: bool,
    /// Whether no file of another kind is taken for one of this format by `is_it`.
    is_certain: bool,
    reader: Reader,
}

/// Every format, in the order of [`Format`]'s variants.
static TABLE: [FormatRow; 6] = [
    FormatRow {
        format: Format::Obj,
        extensions: &["obj"],
        media_types: &["model/obj"],
        noun: "an OBJ",
        begins_like: "an OBJ file",
        is_it: |head, _| obj::is_obj(head),
        check_head: |head, _| obj::check_head(head),
        has_buffers: false,
        has_attributes: false,
        has_groups: true,
        // a comment begins other kinds of text, too
        is_certain: false,
        // a line of four-digit numbers
        reader: obj::open,
    },
    FormatRow {
        format: Format::Glb,
        extensions: &["glb"],
        media_types: &["model/gltf-binary"],
        noun: "a GLB",
        begins_like: "a GLB file",
        is_it: |head, _| gltf::is_binary(head),
        check_head: gltf::check_binary_head,
        has_buffers: true,
        has_attributes: true,
        has_groups: true,
        is_certain: true,
        // indices of two bytes, and half a vertex, uncompressed
        reader: gltf::open_binary,
    },
    FormatRow {
        format: Format::Gltf,
        extensions: &["gltf"],
        media_types: &["model/gltf+json"],
        noun: "a glTF JSON",
        begins_like: "JSON",
        is_it: |head, _| gltf::is_json(head),
        check_head: |head, _| gltf::check_json_head(head),
        has_buffers: true,
        has_attributes: true,
        has_groups: true,
        is_certain: true,
        // as in a GLB, in buffers beside it
        reader: gltf::open_json,
    },
    FormatRow {
        format: Format::Ply,
        extensions: &["ply"],
        media_types: &["model/ply", "model/x-ply", "application/ply", "application/x-ply"],
        noun: "a PLY",
        begins_like: "a PLY file",
        is_it: |head, _| ply::is_ply(head),
        check_head: |head, _| ply::check_head(head),
        has_buffers: false,
        has_attributes: false,
        has_groups: false,
        is_certain: true,
        // an index of a strip, and half a vertex
        reader: ply::open,
    },
    FormatRow {
        format: Format::Stl,
        extensions: &["stl"],
        media_types: &[
            "model/stl",
            "model/x.stl-binary",
            "model/x.stl-ascii",
            "application/sla",
            "application/vnd.ms-pki.stl",
        ],
        noun: "an STL",
        begins_like: "an STL file",
        is_it: stl::is_stl,
        check_head: stl::check_head,
        has_buffers: false,
        has_attributes: false,
        has_groups: false,
        is_certain: true,
        // a triangle of a binary file
        reader: stl::open,
    },
    FormatRow {
        format: Format::Off,
        extensions: &["off"],
        media_types: &["model/off", "model/x-off"],
        noun: "an OFF",
        begins_like: "an OFF file",
        is_it: |head, _| off::is_off(head),
        check_head: |head, _| off::check_head(head),
        has_buffers: false,
        has_attributes: false,
        has_groups: false,
        is_certain: true,
        // a triangle of four-digit numbers
        reader: off::open,
    },
];

impl Format {
    /// Every format, in the order of the table.
    pub const ALL: [Format; TABLE.len()] = {
        let mut all = [Format::Obj; TABLE.len()];
        let mut at = 0;
        while at < all.len() {
            all[at] = TABLE[at].format;
            assert!(all[at] as usize == at, "rows are in the order of the variants");
            at += 1;
        }
        all
    };

    fn row(self) -> &'static FormatRow {
        &TABLE[self as usize]
    }

    /// Short name, also the usual file extension and the value of `?format=`.
    pub fn name(self) -> &'static str {
        self.row().extensions[0]
    }

    /// The usual media type.
    pub fn media_type(self) -> &'static str {
        self.row().media_types[0]
    }

    /// Every media type that is taken for this format.
    pub fn media_types(self) -> &'static [&'static str] {
        self.row().media_types
    }

    /// With its article, for messages: `an OBJ`.
    pub fn noun(self) -> &'static str {
        self.row().noun
    }

    /// Whether a file may refer to buffers in other files.
    pub fn has_buffers(self) -> bool {
        self.row().has_buffers
    }

    /// Whether vertices may have attributes with names.
    pub fn has_attributes(self) -> bool {
        self.row().has_attributes
    }

    /// Whether faces may be of groups or materials.
    pub fn has_groups(self) -> bool {
        self.row().has_groups
    }

    /// What opens a file of this format.
    pub(super) fn reader(self) -> Reader {
        self.row().reader
    }

    /// The short names of all formats as a choice, each after `prefix`: `.obj, .glb or .gltf`.
    pub fn choice(prefix: &str) -> String {
        let [first @ .., last] = Self::ALL.map(|format| format!("{prefix}{}", format.name()));
        format!("{} or {last}", first.join(", "))
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
        Self::listing(|row| row.media_types, media_type.split(';').next().unwrap_or_default().trim())
    }

    /// The format that a file's name suggests.
    pub fn from_file_name(name: &str) -> Option<Self> {
        Self::listing(|row| row.extensions, name.rsplit_once('.')?.1)
    }

    /// The format that lists this name, in any case.
    fn listing(names: fn(&FormatRow) -> &'static [&'static str], name: &str) -> Option<Self> {
        let lists = |row: &&FormatRow| names(row).iter().any(|known| known.eq_ignore_ascii_case(name));
        TABLE.iter().find(lists).map(|row| row.format)
    }

    /// The format that the first bytes suggest; `length` is the length of the whole file in bytes, where it is known.
    pub fn from_content(head: &[u8], length: Option<u64>) -> Option<Self> {
        TABLE.iter().find(|row| (row.is_it)(head, length)).map(|row| row.format)
    }

    /// The format of a file: by name, then by its first bytes and its length in bytes, where that is known.
    pub fn recognise(name: Option<&str>, head: &[u8], length: Option<u64>) -> Result<Self> {
        if let Some(format) = name.and_then(Self::from_file_name).or_else(|| Self::from_content(head, length)) {
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
    /// `head` is the first [`HEAD_BYTES`](super::HEAD_BYTES), or the whole file; `length` is the length of the whole
    /// file in bytes, where it is known.
    pub fn check_head(self, head: &[u8], length: Option<u64>) -> Result<()> {
        if head.is_empty() || length == Some(0) {
            return Err(self.is_not("it is empty"));
        }
        let FormatRow { is_it, is_certain, check_head, .. } = self.row();
        let is_own = is_it(head, length);
        if let Some(foreign) = foreign::recognise(head).filter(|_| !(is_own && *is_certain)) {
            return Err(self.is_not(&format!("it is {}; {}", foreign.name, foreign.advice)));
        }
        if let Some(other) = Self::from_content(head, length).filter(|_| !is_own) {
            let (like, name) = (other.row().begins_like, other.name());
            return Err(self.is_not(&format!("it begins like {like}; name it .{name}, or send it as {name}")));
        }
        check_head(head, length)
    }

    /// The error of a file that is not of this format, and why.
    pub(super) fn is_not(self, why: &str) -> Error {
        Error::mesh(format_args!("this is not {} file: {why}", self.noun()))
    }
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
            // in stored jobs and in reports
            assert_eq!(serde_json::to_value(format).expect("JSON"), format.name());
        }
        assert_eq!(
            (Format::choice(""), Format::choice(".")),
            ("obj, glb, gltf, ply, stl or off".into(), ".obj, .glb, .gltf, .ply, .stl or .off".into())
        );
        let with_parameters = Format::from_media_type(" Model/OBJ ; charset=utf-8");
        assert_eq!(with_parameters, Some(Format::Obj));
        assert_eq!(Format::from_media_type("application/octet-stream"), None);
        assert_eq!(Format::from_file_name("obj"), None);
        assert_eq!(Format::from_file_name("mesh.obj.gz"), None);
        let error = Format::from_name("3mf").expect_err("not read");
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
            (b"ply\nformat", Format::Ply),
            (b"ply\r\nformat", Format::Ply),
            (b"solid x", Format::Stl),
            (b"SOLID\n", Format::Stl),
            (b"COFF\n3 1 0\n", Format::Off),
        ] {
            assert_eq!(Format::recognise(None, head, None), Ok(format));
            assert_eq!(Format::recognise(Some("mesh.bin"), head, None), Ok(format));
            assert!(format.check_head(b"", None).is_err());
        }
        assert_eq!(Format::recognise(Some("a.obj"), b"{}", None), Ok(Format::Obj));
        for (head, word) in [
            (&b"\x1f\x8b\x08"[..], "gzip"),
            (b"plywood", "neither name nor content"),
            (b"solidity", "neither name nor content"),
            (b"<html>", "HTML"),
            (b"PK\x03\x04", "ZIP"),
            (b"", "empty"),
            (b"voxel 1", "neither name nor content"),
            (b"v 1 2 3\0", "neither name nor content"),
        ] {
            let error = Format::recognise(None, head, None).expect_err("not read");
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
            (Format::Obj, b"ply\n", "PLY"),
            (Format::Gltf, b"solid x", "STL"),
            (Format::Glb, b"{", "JSON"),
            (Format::Glb, b"g\0lTF", "magic"),
            (Format::Glb, b"\x1f\x8b", "gzip"),
            (Format::Ply, b"plywood", "first line"),
            (Format::Ply, b"solid x", "STL"),
            (Format::Stl, b"v 1 2 3", "OBJ"),
            (Format::Stl, b"ply\n", "PLY"),
            (Format::Off, b"v 1 2 3", "OBJ"),
            (Format::Off, b"OFFSET", "begin with"),
            (Format::Obj, b"OFF\n3 1 0", "OFF"),
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
