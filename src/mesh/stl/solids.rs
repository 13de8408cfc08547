//! STL as text: facets, and the solids they belong to.
//!
//! ```text
//! solid NAME
//!   facet normal 0 0 1
//!     outer loop
//!       vertex 0 0 0
//!       vertex 1 0 0
//!       vertex 0 1 0
//!     endloop
//!   endfacet
//! endsolid NAME
//! ```
//!
//! Words may be in any case, and names any bytes but a line end. The text is cut where facets begin, and the pieces are
//! read in parallel; they have a fixed size, so the result, errors included, does not depend on the number of threads.

use crate::error::{Error, Quoted, Result};
use crate::mesh::allowance::Allowance;
use crate::mesh::text::{self, Words, line_number};
use crate::mesh::{Part, part_name};
use crate::parallel;

/// Bytes of a piece.
const PIECE: usize = 256 << 10;

/// The words of a facet after its normal. `vertex` is followed by three coordinates.
const FACET: [&[u8]; 7] = [b"outer", b"loop", b"vertex", b"vertex", b"vertex", b"endloop", b"endfacet"];

/// What a piece of a file holds.
#[derive(Debug, Default)]
struct Chunk<'a> {
    /// The corners of the facets, three each.
    positions: Vec<[f64; 3]>,
    /// The lines that begin and end solids.
    borders: Vec<Border<'a>>,
}

/// A line that begins or ends a solid.
#[derive(Debug, Clone, Copy)]
struct Border<'a> {
    /// Number of facets of the piece before it.
    facets: usize,
    /// The name of a solid that begins; none: the solid ends.
    name: Option<&'a [u8]>,
}

/// A line that cannot be read.
#[derive(Debug)]
struct Fault {
    /// Offset in the piece.
    at: usize,
    /// Number of facets of the piece before the one that it belongs to; none where it belongs to no facet.
    facet: Option<usize>,
    message: String,
}

/// Cuts a text where lines begin a facet.
pub fn split(text: &[u8]) -> Vec<&[u8]> {
    text::pieces(text, PIECE, begins_with_facet)
}

/// Number of lines that begin a facet. Each facet that is read begins a line.
pub fn count_facets(text: &[u8]) -> u64 {
    let mut lines = 0;
    let mut at = 0;
    while at < text.len() {
        lines += u64::from(begins_with_facet(&text[at..]));
        at = text::line_end(text, at) + 1;
    }
    lines
}

/// Whether the first line begins a facet.
fn begins_with_facet(text: &[u8]) -> bool {
    let mut words = Words { text, at: 0 };
    words.skip_blanks();
    words.word().eq_ignore_ascii_case(b"facet")
}

/// The corners of all facets, the solids, and warnings.
type Facets = (Vec<[f64; 3]>, Vec<Part>, Vec<String>);

/// Reads the pieces of a text.
pub fn read(text: &[u8], pieces: &[&[u8]]) -> Result<Facets> {
    let parsed: Vec<Result<Chunk<'_>, Fault>> = parallel::map(pieces.len(), 1, |piece| parse(pieces[piece]));
    let mut positions = Vec::new();
    let mut solids = Solids::default();
    let mut at = 0;
    for (chunk, piece) in parsed.into_iter().zip(pieces) {
        let facets = positions.len() / 3;
        let mut chunk = chunk.map_err(|fault| {
            let line = line_number(text, at + fault.at);
            let facet = fault.facet.map(|facet| format!("facet {} (from 0): ", facets + facet)).unwrap_or_default();
            Error::mesh(format_args!("line {line}: {facet}{}", fault.message))
        })?;
        positions.append(&mut chunk.positions);
        for border in &chunk.borders {
            solids.add((facets + border.facets) as u64, border.name);
        }
        at += piece.len();
    }
    solids.close((positions.len() / 3) as u64);
    let mut warnings = Vec::new();
    if solids.unended > 0 {
        warnings.push(format!("solids without endsolid, so the file may be truncated: {}", solids.unended));
    }
    warnings.extend(Allowance::new(text.len() as u64).limit_names(&mut solids.parts));
    Ok((positions, solids.parts, warnings))
}

/// The solids of a file, in their order.
#[derive(Debug, Default)]
struct Solids<'a> {
    parts: Vec<Part>,
    /// The name of the solid that has begun and not ended.
    open: Option<&'a [u8]>,
    first_face: u64,
    unended: u64,
}

impl<'a> Solids<'a> {
    /// Takes a line that begins or ends a solid, before facet `facet`.
    fn add(&mut self, facet: u64, name: Option<&'a [u8]>) {
        match name {
            Some(_) => self.close(facet),
            None => self.part(facet),
        }
        self.open = name;
    }

    /// Ends a solid without a line that says so.
    fn close(&mut self, facet: u64) {
        self.part(facet);
        self.unended += u64::from(self.open.is_some());
    }

    /// Makes a part of the facets up to `end`, if there are any.
    fn part(&mut self, end: u64) {
        if end == self.first_face {
            return;
        }
        let name = String::from_utf8_lossy(self.open.unwrap_or_default());
        let name = name.trim();
        let group = (!name.is_empty()).then(|| part_name(name).into());
        let faces = end - self.first_face;
        self.parts.push(Part { group, first_face: self.first_face, faces, ..Part::default() });
        self.first_face = end;
    }
}

/// Reads a piece that begins with a facet or at the beginning of the file.
fn parse(text: &[u8]) -> Result<Chunk<'_>, Fault> {
    let mut chunk = Chunk::default();
    let mut words = Words { text, at: 0 };
    loop {
        words.skip_space();
        if words.is_at_end() {
            return Ok(chunk);
        }
        let facets = chunk.positions.len() / 3;
        let begin = words.at;
        let word = words.word();
        if word.eq_ignore_ascii_case(b"facet") {
            words.line();
            facet(&mut words, &mut chunk.positions).map_err(|(at, message)| Fault {
                at,
                facet: Some(facets),
                message,
            })?;
        } else if word.eq_ignore_ascii_case(b"solid") {
            chunk.borders.push(Border { facets, name: Some(words.line()) });
        } else if word.eq_ignore_ascii_case(b"endsolid") {
            words.line();
            chunk.borders.push(Border { facets, name: None });
        } else {
            let message = format!("facet, solid or endsolid must come next, not {}", quoted(word));
            return Err(Fault { at: begin, facet: None, message });
        }
    }
}

/// Reads a facet after its normal; an error has the offset of the line that it is about.
#[inline]
fn facet(words: &mut Words<'_>, positions: &mut Vec<[f64; 3]>) -> Result<(), (usize, String)> {
    for expected in FACET {
        words.skip_space();
        let at = words.at;
        if !words.word().eq_ignore_ascii_case(expected) {
            return Err((at, unexpected(Words { at, ..*words }, expected)));
        }
        if expected == b"vertex" {
            positions.push(vertex(words).map_err(|message| (at, message))?);
        }
    }
    words.skip_blanks();
    match words.is_at_line_end() {
        true => Ok(()),
        false => Err((words.at, format!("the line must end after endfacet, not go on with {}", quoted(words.word())))),
    }
}

/// Reads the coordinates of a vertex.
#[inline]
fn vertex(words: &mut Words<'_>) -> Result<[f64; 3], String> {
    let mut position = [0.0; 3];
    for (axis, coordinate) in position.iter_mut().enumerate() {
        words.skip_blanks();
        if words.is_at_line_end() {
            return Err(format!("three coordinates are needed, there are {axis}"));
        }
        *coordinate = words.coordinate()?;
    }
    Ok(position)
}

#[cold]
fn unexpected(mut words: Words<'_>, expected: &[u8]) -> String {
    let expected = String::from_utf8_lossy(expected);
    match words.is_at_end() {
        true => format!("the file is truncated: it ends before the {expected} of this facet"),
        false => format!("a facet has three vertices, so {expected} must come next, not {}", quoted(words.word())),
    }
}

fn quoted(word: &[u8]) -> String {
    Quoted(&String::from_utf8_lossy(word)).to_string()
}
