//! One piece of an OBJ file, read without knowing the others, so that all pieces can be read at once.

use super::text::{Cursor, Keyword};
use crate::error::Quoted;
use crate::mesh::{Faces, number};

/// What a piece of a file holds.
#[derive(Debug, Default)]
pub struct Chunk<'a> {
    /// Vertex positions.
    pub positions: Vec<[f64; 3]>,
    /// Faces. A corner is a vertex of the file, or, where [`relative`](Self::relative) names it, an i32 counted from
    /// the first vertex of this piece.
    pub faces: Faces,
    /// Corners (offsets into those of `faces`) that were given by a negative index.
    pub relative: Vec<u32>,
    /// Largest index given by a positive number, which counts from 1.
    pub largest: u32,
    /// Changes of name, in order.
    pub names: Vec<Name<'a>>,
    /// Number of point and line elements, which are no faces.
    pub elements: u64,
    /// Number of free-form curves and surfaces, which are not read.
    pub free_form: u64,
}

/// What a name is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `o`
    Object,
    /// `g`
    Group,
    /// `usemtl`
    Material,
}

/// An `o`, `g` or `usemtl` statement.
#[derive(Debug, Clone, Copy)]
pub struct Name<'a> {
    /// First face of the piece that it concerns.
    pub face: u32,
    /// What it names.
    pub kind: Kind,
    /// The name as it is written.
    pub text: &'a [u8],
}

/// A statement that cannot be read.
#[derive(Debug)]
pub struct Fault {
    /// Offset in the piece of the statement.
    pub at: usize,
    /// Which vertex or face of the piece the statement would be, from 0.
    pub what: What,
    /// What is wrong.
    pub message: String,
}

/// What a statement describes.
#[derive(Debug, Clone, Copy)]
pub enum What {
    /// A vertex.
    Vertex(usize),
    /// A face.
    Face(usize),
}

/// Reads a piece that begins and ends with a statement; with `materials`, names of materials too.
pub fn parse(text: &[u8], materials: bool) -> Result<Chunk<'_>, Fault> {
    let mut chunk = Chunk::default();
    let mut cursor = Cursor { text, at: 0 };
    while cursor.at < text.len() {
        cursor.skip_blanks();
        let at = cursor.at;
        match cursor.keyword() {
            Keyword::Vertex => {
                let position = vertex(&mut cursor).map_err(|message| Fault {
                    at,
                    what: What::Vertex(chunk.positions.len()),
                    message,
                })?;
                chunk.positions.push(position);
            }
            Keyword::Face => face(&mut cursor, &mut chunk).map_err(|message| Fault {
                at,
                what: What::Face(chunk.faces.len()),
                message,
            })?,
            keyword @ (Keyword::Group | Keyword::Object) => {
                let kind = if keyword == Keyword::Object { Kind::Object } else { Kind::Group };
                chunk.rename(kind, cursor.skip_statement());
            }
            // no line is joined to it: the name may be a path that ends with a backslash
            Keyword::Material if materials => chunk.rename(Kind::Material, cursor.line()),
            Keyword::Element => {
                chunk.elements += 1;
                cursor.skip_line();
            }
            Keyword::FreeForm => {
                chunk.free_form += 1;
                cursor.skip_line();
            }
            Keyword::Material | Keyword::Other => cursor.skip_line(),
        }
    }
    Ok(chunk)
}

/// The offset of the statement of face `face`.
pub fn face_offset(text: &[u8], face: usize) -> usize {
    let mut cursor = Cursor { text, at: 0 };
    let mut seen = 0;
    while cursor.at < text.len() {
        cursor.skip_blanks();
        let at = cursor.at;
        match cursor.keyword() {
            Keyword::Face if seen == face => return at,
            Keyword::Face => {
                seen += 1;
                cursor.skip_statement();
            }
            Keyword::Vertex | Keyword::Group | Keyword::Object => {
                cursor.skip_statement();
            }
            Keyword::Element | Keyword::FreeForm | Keyword::Material | Keyword::Other => cursor.skip_line(),
        }
    }
    text.len()
}

impl<'a> Chunk<'a> {
    /// Notes a name. One that no face carries is forgotten, so that names cannot outgrow the faces.
    fn rename(&mut self, kind: Kind, text: &'a [u8]) {
        let name = Name { face: self.faces.len() as u32, kind, text };
        let tail = self.names.len().saturating_sub(3);
        let unused = self.names[tail..].iter_mut().find(|last| last.face == name.face && last.kind == kind);
        match unused {
            Some(last) => *last = name,
            None => self.names.push(name),
        }
    }
}

/// Reads what follows `v`: three coordinates, then perhaps a weight or a colour, which are not read.
#[inline]
fn vertex(cursor: &mut Cursor<'_>) -> Result<[f64; 3], String> {
    let mut position = [0.0; 3];
    for (axis, coordinate) in position.iter_mut().enumerate() {
        cursor.skip_blanks();
        if cursor.at_statement_end() {
            return Err(format!("three coordinates are needed, there are {axis}"));
        }
        let Some((value, length)) = number::float(cursor.rest()) else {
            return Err(bad_coordinate(cursor));
        };
        let end = Cursor { at: cursor.at + length, ..*cursor };
        if !end.at_boundary() || !value.is_finite() {
            return Err(bad_coordinate(cursor));
        }
        *coordinate = value;
        *cursor = end;
    }
    cursor.skip_blanks();
    if cursor.at_statement_end() {
        cursor.skip_line();
    } else {
        cursor.skip_statement();
    }
    Ok(position)
}

#[cold]
fn bad_coordinate(cursor: &Cursor<'_>) -> String {
    format!("a coordinate {}", number::complaint(cursor.token()))
}

/// Reads what follows `f`: corners, each with a vertex index and perhaps indices of a texture coordinate and a normal.
#[inline]
fn face(cursor: &mut Cursor<'_>, chunk: &mut Chunk<'_>) -> Result<(), String> {
    let first = chunk.faces.all_corners().len();
    loop {
        cursor.skip_blanks();
        if cursor.at_statement_end() {
            break;
        }
        let (index, length) = match number::integer(cursor.rest()) {
            Some((index, length)) if index != 0 && index.abs() <= i64::from(i32::MAX) => (index, length),
            _ => return Err(bad_corner(cursor)),
        };
        let mut end = Cursor { at: cursor.at + length, ..*cursor };
        for _ in 0..2 {
            if end.peek() == b'/' {
                end.at += 1;
                end.at += number::integer(end.rest()).map_or(0, |(_, length)| length);
            }
        }
        if !end.at_boundary() {
            return Err(bad_corner(cursor));
        }
        *cursor = end;
        if index > 0 {
            chunk.largest = chunk.largest.max(index as u32);
            chunk.faces.push_corner(index as u32 - 1);
        } else {
            let corner = chunk.faces.all_corners().len();
            chunk.relative.push(corner as u32);
            let vertex = chunk.positions.len() as i64 + index;
            chunk.faces.push_corner(vertex as i32 as u32);
        }
    }
    let corners = chunk.faces.all_corners().len() - first;
    if corners < 3 {
        return Err(format!("at least 3 corners are needed, there are {corners}"));
    }
    chunk.faces.close(first);
    cursor.skip_line();
    Ok(())
}

#[cold]
fn bad_corner(cursor: &Cursor<'_>) -> String {
    let token = String::from_utf8_lossy(cursor.token());
    let token = Quoted(&token);
    match number::integer(cursor.rest()) {
        Some((0, _)) => format!("vertex indices count from 1 (or from -1 backwards): {token}"),
        Some((index, _)) if index.abs() > i64::from(i32::MAX) => {
            format!("there is no such vertex: {token}")
        }
        _ => format!("a corner is not of the form v, v/vt, v//vn or v/vt/vn: {token}"),
    }
}
