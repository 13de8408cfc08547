//! Wavefront OBJ.
//!
//! The file is cut where statements end, the pieces are read in parallel, and what one piece cannot know (how many
//! vertices came before it, whether a vertex exists) is settled when they are joined. The pieces have a fixed size, so
//! the result, errors included, does not depend on the number of threads.
//!
//! Read are vertices (`v`), faces (`f`) and names (`g`, `o`, and `usemtl` where groups are wanted). An index may refer
//! to a vertex that comes later in the file. Material libraries, texture coordinates and normals are not looked at;
//! what else there is, is skipped.
//!
//! Most of the time goes into digits, which are read eight at a time (`mesh/number.rs`). `make bench` compares it with
//! `tobj`.

mod chunk;
mod groups;
mod text;

use std::borrow::Cow;
use std::collections::HashMap;
use std::hash::BuildHasher;
use std::sync::Arc;

use self::chunk::{Chunk, Fault, Kind, What};
use self::groups::Groups;
use super::allowance::Allowance;
use super::text::{line_number, with_line_feeds};
use super::{Adjusted, Faces, Format, Limits, Opened, Part, PolygonMesh, ReadMesh, Source, part_name, without_mark};
use crate::error::{Error, Result};
use crate::parallel;

/// Bytes of a piece.
const PIECE: usize = 256 << 10;

/// Pieces whose faces one thread counts, at least.
const COUNTED_AT_ONCE: usize = 4;

/// Corners are counted in 32 bits, and a corner takes two bytes at least.
const MAX_BYTES: u64 = 2 * u32::MAX as u64;

/// Whether a file with these first bytes is an OBJ: text that begins with a comment or a known statement.
pub fn is_obj(head: &[u8]) -> bool {
    const STATEMENTS: [&[u8]; 16] = [
        b"v", b"vn", b"vt", b"vp", b"f", b"fo", b"g", b"o", b"s", b"l", b"p", b"mg", b"mtllib", b"usemtl", b"cstype",
        b"deg",
    ];
    let text = without_mark(head).trim_ascii_start();
    let keyword = text.split(|byte| byte.is_ascii_whitespace()).next().unwrap_or_default();
    (STATEMENTS.contains(&keyword) || keyword.starts_with(b"#")) && !text.contains(&0)
}

/// Refuses first bytes that are no text.
pub fn check_head(head: &[u8]) -> Result<()> {
    if head.contains(&0) {
        return Err(Format::Obj.is_not("it holds zero bytes, so it is no text"));
    }
    Ok(())
}

/// Opens an OBJ file: counts the lines that begin like a face.
pub fn open(source: Source<'_>, then: &mut dyn FnMut(Opened<'_>)) -> Result<()> {
    let Source { bytes, limits, groups, .. } = source;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Error::too_large(format_args!(
            "an OBJ file may have {MAX_BYTES} bytes (split it, or convert it to GLB): {}",
            bytes.len()
        )));
    }
    let text = with_line_feeds(without_mark(bytes));
    let pieces = text::split(&text, PIECE);
    // small files are counted by the thread that opens them
    let faces = parallel::map(pieces.len(), COUNTED_AT_ONCE, |piece| face_lines(pieces[piece])).into_iter().sum();
    then(Opened::new(faces, || {
        let parsed: Vec<Result<Chunk<'_>, Fault>> =
            parallel::map(pieces.len(), 1, |piece| chunk::parse(pieces[piece], groups));
        join(&text, &pieces, parsed, limits, groups)
    }));
    Ok(())
}

/// Lines that are faces, most likely: each takes memory as soon as it is parsed.
fn face_lines(text: &[u8]) -> u64 {
    // nearly always no line begins with blanks, and then three bytes in a row tell; few enough at a time that a byte
    // counts them, so that the compiler makes vectors of it
    const BLOCK: usize = 240;
    let is_face = |line: &&[u8]| matches!(line.trim_ascii_start(), [b'f', b' ' | b'\t', ..]);
    let mut faces = u64::from(text.starts_with(b"f ") || text.starts_with(b"f\t"));
    let mut indented = text.first().is_some_and(u8::is_ascii_whitespace);
    for at in (0..text.len()).step_by(BLOCK) {
        let block = &text[at..text.len().min(at + BLOCK + 2)];
        let (Some(second), Some(third)) = (block.get(1..), block.get(2..)) else { break };
        let (mut of_block, mut blanks) = (0u8, 0u8);
        for ((&end, &first), &next) in block.iter().zip(second).zip(third) {
            let begins = u8::from(end == b'\n');
            of_block += begins & u8::from(first == b'f') & (u8::from(next == b' ') | u8::from(next == b'\t'));
            blanks |= begins & (u8::from(first == b' ') | u8::from(first == b'\t') | u8::from(first == 0x0c));
        }
        faces += u64::from(of_block);
        indented |= blanks > 0;
    }
    if indented { text.split(|&byte| byte == b'\n').filter(is_face).count() as u64 } else { faces }
}

/// Joins the pieces in their order.
fn join(
    text: &[u8],
    pieces: &[&[u8]],
    parsed: Vec<Result<Chunk<'_>, Fault>>,
    limits: &Limits,
    groups: bool,
) -> Result<ReadMesh> {
    let mut chunks = Vec::with_capacity(parsed.len());
    let mut starts = vec![Start::default()];
    for (chunk, piece) in parsed.into_iter().zip(pieces) {
        let start = starts[chunks.len()];
        let chunk = chunk.map_err(|fault| start.error(text, &fault))?;
        starts.push(Start {
            byte: start.byte + piece.len(),
            vertices: start.vertices + chunk.positions.len(),
            faces: start.faces + chunk.faces.len(),
            corners: start.corners + chunk.faces.all_corners().len(),
        });
        chunks.push(chunk);
    }
    let total = starts[chunks.len()];
    limits.check_faces(total.faces as u64)?;

    let mut positions = Vec::with_capacity(total.vertices);
    let mut faces = Faces::with_capacity(total.corners / 3);
    let mut parts = Parts::default();
    let mut groups = groups.then(|| Groups::with_capacity(total.faces));
    let (mut elements, mut free_form) = (0, 0);
    for (index, mut chunk) in chunks.into_iter().enumerate() {
        let start = starts[index];
        settle(&mut chunk, start.vertices, total.vertices).map_err(|(face, message)| {
            let fault = Fault { at: chunk::face_offset(pieces[index], face), what: What::Face(face), message };
            start.error(text, &fault)
        })?;
        for name in &chunk.names {
            let face = start.faces + name.face as usize;
            parts.rename(face as u64, name);
            groups.iter_mut().for_each(|groups| groups.rename(face, name));
        }
        positions.append(&mut chunk.positions);
        faces.append(&chunk.faces);
        elements += chunk.elements;
        free_form += chunk.free_form;
    }
    let mut warnings = Vec::new();
    if elements > 0 {
        warnings.push(format!("point and line elements were skipped: {elements}"));
    }
    if free_form > 0 {
        warnings.push(format!("free-form curves and surfaces were skipped: {free_form}"));
    }
    if total.faces == 0 {
        return Err(no_faces(total.vertices, elements, free_form));
    }
    let mut parts = parts.finish(total.faces as u64);
    warnings.extend(Allowance::new(text.len() as u64).limit_names(&mut parts));
    let adjusted = Adjusted::default();
    let mesh = PolygonMesh { format: Format::Obj, positions, faces, parts, warnings, adjusted };
    Ok(ReadMesh { groups: groups.map(|groups| groups.finish(total.faces)), ..mesh.into() })
}

/// The error of a file without faces.
fn no_faces(vertices: usize, elements: u64, free_form: u64) -> Error {
    let why = if vertices == 0 {
        "the file has neither vertices (v) nor faces (f), so it may be no OBJ file".to_owned()
    } else if elements > 0 {
        format!("the file has vertices and points or lines only, and no faces (f); points and lines: {elements}")
    } else if free_form > 0 {
        format!("the file has free-form curves or surfaces, which must be meshed first: {free_form}")
    } else {
        format!("the file has vertices only, and no faces (f), as a point cloud has; vertices: {vertices}")
    };
    Error::mesh(format_args!("the mesh has no faces: {why}"))
}

/// What came before a piece.
#[derive(Debug, Clone, Copy, Default)]
struct Start {
    byte: usize,
    vertices: usize,
    faces: usize,
    corners: usize,
}

impl Start {
    /// What is wrong with a statement of this piece, with its line and number.
    fn error(&self, text: &[u8], fault: &Fault) -> Error {
        let line = line_number(text, self.byte + fault.at);
        let message = &fault.message;
        match fault.what {
            What::Vertex(vertex) => {
                Error::mesh(format_args!("line {line}: vertex {}: {message}", self.vertices + vertex + 1))
            }
            What::Face(face) => Error::mesh(format_args!("line {line}: face {}: {message}", self.faces + face + 1)),
        }
    }
}

/// Makes the relative corners of a chunk absolute and checks that all vertices exist: there are `total`, `before` of
/// them before this chunk. The error is the face and what is wrong with it.
fn settle(chunk: &mut Chunk<'_>, before: usize, total: usize) -> Result<(), (usize, String)> {
    let corners = chunk.faces.all_corners_mut();
    let mut outside = None;
    for &at in &chunk.relative {
        let corner = &mut corners[at as usize];
        let vertex = before as i64 + i64::from(*corner as i32);
        match u32::try_from(vertex) {
            Ok(vertex) => *corner = vertex,
            Err(_) => {
                outside = Some((at as usize, vertex));
                break;
            }
        }
    }
    let mut message = None;
    if let Some((at, vertex)) = outside {
        message =
            Some((at, format!("a negative index goes back beyond the first vertex by: {}", vertex.unsigned_abs())));
    }
    if chunk.largest as usize > total {
        // relative corners that are not settled yet are behind the one noted above
        let end = outside.map_or(corners.len(), |(at, _)| at);
        let beyond = corners[..end].iter().position(|&corner| corner as usize >= total);
        if let Some(at) = beyond {
            message = Some((
                at,
                format!(
                    "there is no such vertex, the file has {total}; add its v line, or correct the index: {}",
                    u64::from(corners[at]) + 1
                ),
            ));
        }
    }
    message.map_or(Ok(()), |(at, message)| Err((chunk.faces.face_of_corner(at), message)))
}

/// Runs of faces under one object and group name.
#[derive(Debug, Default)]
struct Parts {
    parts: Vec<Part>,
    object: Option<String>,
    group: Option<String>,
    first_face: u64,
    /// Names of parts so far by their hashes, which growth of the map needs: names are far apart in memory.
    names: HashMap<u64, Arc<str>>,
}

impl Parts {
    /// From face `face` on, faces are called otherwise. Parts have no names of materials.
    fn rename(&mut self, face: u64, name: &chunk::Name<'_>) {
        if name.kind == Kind::Material {
            return;
        }
        self.close(face);
        let text = String::from_utf8_lossy(name.text).replace("\\\r\n", " ").replace("\\\n", " ");
        let text = text.trim();
        let name_of = (!text.is_empty()).then(|| part_name(text).into_owned());
        match name.kind {
            Kind::Object => self.object = name_of,
            Kind::Group => self.group = name_of,
            Kind::Material => {}
        }
    }

    /// Ends the run before face `end`.
    fn close(&mut self, end: u64) {
        let faces = end - self.first_face;
        if faces == 0 {
            return;
        }
        let group = match (&self.object, &self.group) {
            (Some(object), Some(group)) => Some(Cow::Owned(format!("{object}/{group}"))),
            (object, group) => object.as_deref().or(group.as_deref()).map(Cow::Borrowed),
        };
        let group = group.map(|name| {
            let hash = self.names.hasher().hash_one(&*name);
            match self.names.get(&hash) {
                Some(known) if **known == *name => Arc::clone(known),
                _ => {
                    let name: Arc<str> = name.into();
                    self.names.insert(hash, Arc::clone(&name));
                    name
                }
            }
        });
        match self.parts.last_mut() {
            Some(last) if last.group == group => last.faces += faces,
            _ => self.parts.push(Part { group, first_face: self.first_face, faces, ..Part::default() }),
        }
        self.first_face = end;
    }

    fn finish(mut self, faces: u64) -> Vec<Part> {
        self.close(faces);
        self.parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_are_faces_are_counted_wherever_they_are() {
        let lines = ["f 1 2 3", "f\t1 2 3", "fo 1 2 3", "v 1 f 3", "#f 1 2", "", "ff ", "f", "g f "];
        for indent in ["", " ", "\t", "\x0c "] {
            let (mut text, mut faces) = (String::new(), 0);
            for repeat in 0..200 {
                let line = lines[repeat % lines.len()];
                let end = if repeat % 7 == 0 { "\r\n" } else { "\n" };
                text += &format!("{indent}{line}{end}");
                faces += u64::from(line.starts_with("f ") || line.starts_with("f\t"));
                assert_eq!(face_lines(text.as_bytes()), faces, "{text:?}");
            }
        }
    }
}
