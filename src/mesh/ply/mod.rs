//! PLY, the polygon file format, as text and as bytes in either order.
//!
//! ```text
//! header ─→ roles of elements ─→ rows (binary, lines) ─→ positions, polygons
//! ```
//!
//! A file holds elements of any names, each a number of rows with the same properties. Read are `x`, `y` and `z` of
//! `vertex`, and the lists `vertex_indices` or `vertex_index` of `face` and `tristrips`; all others are skipped,
//! wherever they stand. Properties may have any types, but the corners and the lengths of lists are integers. Doubles
//! keep their precision.
//!
//! Rows become faces in their order, a strip as many as it has triangles. A face of fewer than three corners keeps its
//! place as a degenerate triangle, so that label i belongs to row i.
//!
//! What the header declares is compared with the bytes or lines that are there before anything is allocated, so memory
//! is in proportion to the file: a byte of it becomes at most 16 (an empty face beside polygons).

mod binary;
mod header;
mod lines;
mod roles;
mod value;

pub use header::is_ply;

use self::header::{Element, Encoding, Header, shown};
use self::lines::Lines;
use self::roles::Role;
use super::polygons::Polygons;
use super::text::with_line_feeds;
use super::{Adjusted, Format, Limits, Opened, Part, PolygonMesh, ReadMesh, Source};
use crate::error::{Error, Result};

/// Fewest bytes of an index in a text: a digit and a blank.
const LEAST_BYTES_OF_TEXT: u64 = 2;

/// First bytes by which text and numbers are distinguished.
const SAMPLE: usize = 256;

/// Refuses what begins like no PLY file.
pub fn check_head(head: &[u8]) -> Result<()> {
    if !is_ply(head) {
        return Err(Format::Ply.is_not("its first line is not \"ply\""));
    }
    Ok(())
}

/// What the rows of a file, or of a part of it, hold.
struct Contents {
    positions: Vec<[f64; 3]>,
    polygons: Polygons,
    /// What was ignored after the last row.
    warning: Option<String>,
}

impl Contents {
    /// Nothing yet, of a file with so many vertices; with room for so many triangles.
    fn new(vertices: u64, triangles: usize) -> Self {
        Self { positions: Vec::new(), polygons: Polygons::new(vertices, triangles), warning: None }
    }
}

/// Opens a PLY file: reads its header, and compares what it declares with what follows.
pub fn open(source: Source<'_>, then: &mut dyn FnMut(Opened<'_>)) -> Result<()> {
    let Source { bytes, limits, .. } = source;
    let header = header::parse(bytes)?;
    let data = &bytes[header.bytes..];
    match header.encoding {
        Encoding::Binary(order) => {
            let of_text = |error| if is_text(data) { says_binary(header.encoding) } else { error };
            let spare = binary::check(&header, data).map_err(of_text)?;
            let (roles, vertices) = roles::roles(&header)?;
            let faces = most_faces(&header, &roles, spare, limits)?;
            then(Opened::new(faces, || {
                let contents = binary::read(&header, order, &roles, vertices, data).map_err(of_text)?;
                finish(contents, &header, &roles, limits)
            }));
        }
        Encoding::Text => {
            if memchr::memchr(0, data).is_some() {
                return Err(Error::mesh(
                    "the PLY header says format ascii, but zero bytes follow it as in a binary file: correct its \
                     format line, or write the file again",
                ));
            }
            let text = with_line_feeds(data);
            let (roles, vertices) = roles::roles(&header)?;
            let lines = Lines::open(&header, &roles, &text)?;
            let faces = most_faces(&header, &roles, data.len() as u64, limits)?;
            then(Opened::new(faces, || finish(lines.read(vertices, header.lines)?, &header, &roles, limits)));
        }
    }
    Ok(())
}

/// Faces that the file has at most, of which `spare` bytes may be indices of strips.
fn most_faces(header: &Header<'_>, roles: &[Role], spare: u64, limits: &Limits) -> Result<u64> {
    let (mut polygons, mut of_strips) = (0u64, 0);
    for (element, role) in header.elements.iter().zip(roles) {
        match *role {
            Role::Polygons(_) => polygons += element.rows,
            Role::Strips(list) => {
                let index = match header.encoding {
                    Encoding::Text => LEAST_BYTES_OF_TEXT,
                    Encoding::Binary(_) => element.properties[list].value.size() as u64,
                };
                of_strips = spare / index;
            }
            Role::Vertices(_) | Role::Skipped => {}
        }
    }
    limits.check_faces(polygons)?;
    Ok(polygons + of_strips)
}

/// Makes the mesh.
fn finish(contents: Contents, header: &Header<'_>, roles: &[Role], limits: &Limits) -> Result<ReadMesh> {
    let Contents { positions, polygons: Polygons { faces, short, .. }, warning } = contents;
    if faces.is_empty() {
        return Err(Error::mesh("the mesh has no faces: no strip of the PLY file has three corners"));
    }
    limits.check_faces(faces.len() as u64)?;
    let mut warnings = Vec::new();
    let others = header.elements.iter().zip(roles).filter(|(_, role)| **role == Role::Skipped);
    let skipped: u64 = others.map(|(element, _)| element.rows).fold(0, u64::saturating_add);
    if skipped > 0 {
        warnings.push(format!("rows of elements other than vertex, face and tristrips were skipped: {skipped}"));
    }
    if short > 0 {
        warnings.push(format!("faces of fewer than 3 corners were kept as degenerate triangles: {short}"));
    }
    warnings.extend(warning);
    let parts = vec![Part { faces: faces.len() as u64, ..Part::default() }];
    let adjusted = Adjusted::default();
    Ok(PolygonMesh { format: Format::Ply, positions, faces, parts, warnings, adjusted }.into())
}

/// What is wrong with a row of an element.
fn fault(element: &Element<'_>, row: u64, message: &str) -> Error {
    Error::mesh(format_args!("row {row} (from 0) of element {}: {message}", shown(element.name)))
}

/// Whether rows that should be bytes are text.
fn is_text(data: &[u8]) -> bool {
    let sample = &data[..data.len().min(SAMPLE)];
    !sample.is_empty() && sample.iter().all(|byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace())
}

/// The error of a file whose rows are text, but not by its header.
fn says_binary(encoding: Encoding) -> Error {
    Error::mesh(format_args!(
        "the PLY header says format {}, but text follows it: correct its format line, or write the file again",
        encoding.name()
    ))
}
