//! Polygon meshes and how they are read.
//!
//! Every format ends in the same [`PolygonMesh`]; nothing after this module depends on the format. [`mod@format`] says
//! what a new format needs.
//!
//! Reading has two steps: [`open`] checks the structure of a file and counts its faces, [`Opened::read`] builds the
//! mesh. Between the two a caller can wait for memory, choose a thread, or stop.
//!
//! Readers trust nothing: sizes are checked against the bytes that are there before anything is allocated, what a file
//! says more than once stays in proportion to its bytes (`allowance`), and an error names the line, accessor, vertex or
//! face. They open no file themselves: what a mesh refers to comes through [`Resources`].

mod allowance;
pub mod divide;
mod faces;
mod format;
mod frame;
mod gltf;
mod groups;
pub(crate) mod number;
mod obj;
mod off;
mod ply;
mod polygons;
mod resources;
mod stl;
mod text;
mod view;

pub use faces::Faces;
pub use format::Format;
pub(crate) use frame::Frame;
pub use resources::{Beside, NoResources, Resources};
pub use view::{MeshView, Positions};

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Serialize, Serializer};
use utoipa::ToSchema;

use crate::error::names::Name;
use crate::error::{Error, Quoted, Result};

/// A mesh as it was uploaded: its faces in upload order, positions not yet welded.
#[derive(Debug, Clone, PartialEq)]
pub struct PolygonMesh {
    /// The format it was read from.
    pub format: Format,
    /// Vertex positions in source units, all finite.
    pub positions: Vec<[f64; 3]>,
    /// The faces in upload order; every corner is a valid index into `positions`.
    pub faces: Faces,
    /// Where runs of faces come from; in face order, covering every face once.
    pub parts: Vec<Part>,
    /// What was skipped or is unusual, in words.
    pub warnings: Vec<String>,
    /// What the reader changed or left out.
    pub adjusted: Adjusted,
}

impl PolygonMesh {
    /// A mesh in one part, with nothing unusual.
    pub fn of_one_part(format: Format, positions: Vec<[f64; 3]>, faces: Faces) -> Self {
        let parts = vec![Part { faces: faces.len() as u64, ..Part::default() }];
        Self { format, positions, faces, parts, warnings: Vec::new(), adjusted: Adjusted::default() }
    }
}

/// What a reader changed or left out of a mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Adjusted {
    /// Vertices of the file that no face uses and that are not in `positions`.
    pub vertices_left_out: u64,
    /// Vertices that were moved to the position of a vertex of another part, which was theirs but for rounding.
    pub joined_across_parts: u64,
}

/// A run of consecutive faces with a common origin (`input.parts` of the report).
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Part {
    /// glTF: index of the node.
    pub node: Option<u32>,
    /// glTF: index of the mesh.
    pub mesh: Option<u32>,
    /// glTF: index of the primitive in its mesh.
    pub primitive: Option<u32>,
    /// glTF: index of the GPU instance.
    pub instance: Option<u32>,
    /// OBJ: object and group names, joined by a slash; glTF: the node's name; STL: the solid's.
    #[serde(serialize_with = "name")]
    #[schema(value_type = Option<String>)]
    pub group: Option<Arc<str>>,
    /// First face of the run, in upload order.
    pub first_face: u64,
    /// Number of faces in the run.
    pub faces: u64,
}

impl Part {
    /// One past the last face of the run.
    fn end(&self) -> usize {
        (self.first_face + self.faces) as usize
    }
}

/// A name for a part, cut short where it has more bytes than any sensible one: it may be repeated for every part.
fn part_name(name: &str) -> Cow<'_, str> {
    const LONGEST: usize = 255;
    if name.len() <= LONGEST {
        return Cow::Borrowed(name);
    }
    Cow::Owned(format!("{}…", &name[..name.floor_char_boundary(LONGEST)]))
}

/// Writes a shared name like one that is not.
fn name<S: Serializer>(name: &Option<Arc<str>>, serializer: S) -> Result<S::Ok, S::Error> {
    name.as_deref().serialize(serializer)
}

/// What a mesh may cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest number of bytes, the main file and its buffers together.
    pub max_bytes: u64,
    /// Largest number of faces.
    pub max_faces: u64,
    /// Largest number of faces for each byte that was sent, beyond a constant; none: only `max_faces` counts.
    pub max_faces_per_byte: Option<u64>,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_bytes: 4 << 30, max_faces: 50_000_000, max_faces_per_byte: Some(allowance::FACES_PER_BYTE) }
    }
}

impl Limits {
    /// Refuses a mesh file of `bytes` bytes that is over the limit.
    pub fn check_bytes(&self, bytes: u64) -> Result<()> {
        if bytes > self.max_bytes {
            return Err(Error::too_large(format_args!(
                "the mesh has more bytes than the limit of {} (raise it with --max-upload-bytes): {bytes}",
                self.max_bytes
            )));
        }
        Ok(())
    }

    /// Refuses a mesh of `faces` faces that is over the limit.
    pub fn check_faces(&self, faces: u64) -> Result<()> {
        if faces > self.max_faces {
            return Err(Error::too_large(format_args!(
                "the mesh has more faces than the limit of {} (raise it with --max-faces): {faces}",
                self.max_faces
            )));
        }
        Ok(())
    }
}

/// The text without its byte order mark.
fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// Bytes of a file that its format is recognised and checked by, before the rest is looked at.
pub const HEAD_BYTES: usize = 4096;

/// A mesh, and what else was wanted of its file.
#[derive(Debug)]
pub struct ReadMesh {
    /// The mesh.
    pub mesh: PolygonMesh,
    /// The attribute: one number a vertex.
    pub numbers: Option<Vec<f64>>,
    /// The group of each face: a number.
    pub groups: Option<Vec<u32>>,
}

impl From<PolygonMesh> for ReadMesh {
    fn from(mesh: PolygonMesh) -> Self {
        Self { mesh, numbers: None, groups: None }
    }
}

/// A mesh file and how to read it.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// The bytes of the file.
    pub bytes: &'a [u8],
    /// Their format.
    pub format: Format,
    /// Where buffers that the file refers to come from.
    pub resources: &'a dyn Resources,
    /// What the mesh may cost.
    pub limits: &'a Limits,
    /// A glTF attribute that every primitive must have: one number a vertex.
    pub attribute: Option<&'a str>,
    /// Whether the group of each face is wanted: of an OBJ its object, group and material, of a glTF its primitive.
    pub groups: bool,
}

impl<'a> Source<'a> {
    /// A mesh alone.
    pub fn new(bytes: &'a [u8], format: Format, resources: &'a dyn Resources, limits: &'a Limits) -> Self {
        Self { bytes, format, resources, limits, attribute: None, groups: false }
    }
}

/// A mesh file that was opened: its faces are counted, and nothing is built of them yet.
pub struct Opened<'b> {
    faces: u64,
    read: Box<dyn FnOnce() -> Result<ReadMesh> + Send + 'b>,
}

impl<'b> Opened<'b> {
    fn new(faces: u64, read: impl FnOnce() -> Result<ReadMesh> + Send + 'b) -> Self {
        Self { faces, read: Box::new(read) }
    }

    /// Number of faces that memory is needed for: the lines that begin like a face of an OBJ, the triangles of a glTF
    /// or an STL, the rows of a PLY or an OFF. Of triangle strips in a PLY, as many as their bytes can hold.
    pub fn faces(&self) -> u64 {
        self.faces
    }

    /// Reads the mesh. May run on another thread than [`open`].
    pub fn read(self) -> Result<ReadMesh> {
        (self.read)()
    }
}

/// The reader of a format: opens a file and passes it on, once.
type Reader = fn(Source<'_>, &mut dyn FnMut(Opened<'_>)) -> Result<()>;

/// Opens a mesh file and calls `then` with it. The opened file borrows from what its reader has decoded so far, so it
/// lives no longer than the call.
///
/// # Errors
/// The file is of another format, contradicts itself, or exceeds a limit; then `then` is not called.
pub fn open<T>(source: Source<'_>, then: impl FnOnce(Opened<'_>) -> T) -> Result<T> {
    let Source { bytes, format, attribute, .. } = source;
    source.limits.check_bytes(bytes.len() as u64)?;
    let head = &bytes[..bytes.len().min(HEAD_BYTES)];
    format.check_head(head, Some(bytes.len() as u64))?;
    if let Some(name) = attribute.filter(|_| !format.has_attributes()) {
        return Err(Error::parameter(format_args!(
            "attributes with names are read of glTF only, and this is {} file: {}",
            format.noun(),
            Quoted(name)
        )));
    }
    if source.groups && !format.has_groups() {
        return Err(Error::parameter(format_args!(
            "groups and materials are read of OBJ and glTF files, and this is {} file: leave groups out of {}",
            format.noun(),
            Name::FEATURES
        )));
    }
    let (mut then, mut result) = (Some(then), None);
    format.reader()(source, &mut |opened| result = then.take().map(|then| then(opened)))?;
    result.ok_or_else(|| Error::internal(format_args!("nothing was opened by the reader of {}", format.name())))
}

/// Reads a mesh from its bytes.
pub fn read(bytes: &[u8], format: Format, resources: &dyn Resources, limits: &Limits) -> Result<PolygonMesh> {
    Ok(open(Source::new(bytes, format, resources, limits), |opened| opened.read())??.mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_are_cut_between_characters() {
        assert_eq!(part_name(&"x".repeat(255)), "x".repeat(255));
        assert_eq!(part_name(&"x".repeat(256)), format!("{}…", "x".repeat(255)));
        assert_eq!(part_name(&"😀".repeat(255)), format!("{}…", "😀".repeat(63)));
    }

    #[test]
    fn shared_names_are_written_like_others() {
        let part = Part { group: Some("a/b".into()), faces: 7, ..Part::default() };
        let written = serde_json::to_value([part, Part::default()]).expect("JSON");
        assert_eq!(written[0]["group"], "a/b");
        assert!(written[1]["group"].is_null());
    }
}
