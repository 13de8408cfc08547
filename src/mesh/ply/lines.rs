//! Rows as text: every line that is not blank is a row.
//!
//! The text is cut into pieces at line ends. Once the lines of each piece are counted, a piece knows its first row, so
//! all pieces are read in parallel. They have a fixed size, so the result, errors included, does not depend on the
//! number of threads.

use super::header::{Element, Header, Property, shown};
use super::roles::Role;
use super::{Contents, fault};
use crate::error::{Error, Result};
use crate::mesh::text::{self, Words, is_space, line_number};
use crate::parallel;

/// Bytes of a piece.
const PIECE: usize = 256 << 10;

/// Pieces whose lines one thread counts, at least.
const COUNTED_AT_ONCE: usize = 4;

/// The rows of a file.
pub struct Lines<'a> {
    text: &'a [u8],
    pieces: Vec<Piece<'a>>,
    /// The elements that have lines, in their order.
    runs: Vec<Run<'a>>,
    /// Lines after the last row.
    unread: u64,
}

/// Lines that one thread reads.
struct Piece<'a> {
    text: &'a [u8],
    /// Offset of the piece in the text.
    at: usize,
    /// Number of rows before it.
    first_row: u64,
}

/// The lines of an element.
struct Run<'a> {
    element: &'a Element<'a>,
    role: Role,
    /// Number of rows before it, and up to its end.
    first_row: u64,
    end: u64,
}

/// What is wrong with a line.
struct Fault {
    /// Offset of the line in its piece.
    at: usize,
    error: Error,
}

impl<'a> Lines<'a> {
    /// Counts the lines; `roles` has the role of each element.
    ///
    /// # Errors
    /// There are fewer lines than rows.
    pub fn open(header: &'a Header<'a>, roles: &[Role], text: &'a [u8]) -> Result<Self> {
        let cut = text::pieces(text, PIECE, |_| true);
        // small files are counted by the thread that opens them
        let counts: Vec<u64> = parallel::map(cut.len(), COUNTED_AT_ONCE, |piece| filled_lines(cut[piece]));
        let (mut at, mut lines) = (0, 0);
        let pieces = cut.into_iter().zip(counts).map(|(text, count)| {
            let piece = Piece { text, at, first_row: lines };
            (at, lines) = (at + text.len(), lines + count);
            piece
        });
        let pieces = pieces.collect();
        let mut rows = 0;
        let mut runs = Vec::new();
        for (element, &role) in header.elements.iter().zip(roles) {
            // a row without values has no line
            if element.rows == 0 || element.properties.is_empty() {
                continue;
            }
            let left = lines - rows;
            if element.rows > left {
                return Err(Error::mesh(format_args!(
                    "the PLY file is truncated, so copy or write it again: element {} has {} rows, the file has {left} \
                     lines for it",
                    shown(element.name),
                    element.rows
                )));
            }
            runs.push(Run { element, role, first_row: rows, end: rows + element.rows });
            rows += element.rows;
        }
        Ok(Self { text, pieces, runs, unread: lines - rows })
    }

    /// Reads all rows of a file with so many vertices, the first of which is on the line after `lines_before`.
    pub fn read(&self, vertices: u64, lines_before: u64) -> Result<Contents> {
        let parsed: Vec<Result<Contents, Fault>> =
            parallel::map(self.pieces.len(), 1, |piece| self.parse(&self.pieces[piece], vertices));
        let mut contents = Contents::new(vertices, 0);
        contents.positions.reserve_exact(vertices as usize);
        for (parsed, piece) in parsed.into_iter().zip(&self.pieces) {
            let mut parsed = parsed.map_err(|Fault { at, error }| {
                let line = lines_before + line_number(self.text, piece.at + at);
                Error::new(error.kind, format_args!("line {line}: {error}"))
            })?;
            contents.positions.append(&mut parsed.positions);
            contents.polygons.append(&parsed.polygons).map_err(Error::mesh)?;
        }
        if self.unread > 0 {
            contents.warning = Some(format!("lines after the last row were ignored: {}", self.unread));
        }
        Ok(contents)
    }

    fn parse(&self, piece: &Piece<'_>, vertices: u64) -> Result<Contents, Fault> {
        let mut contents = Contents::new(vertices, 0);
        let mut words = Words { text: piece.text, at: 0 };
        let mut indices = Vec::new();
        let first = self.runs.partition_point(|run| run.end <= piece.first_row);
        let mut row = piece.first_row;
        for run in &self.runs[first..] {
            while row < run.end {
                words.skip_space();
                if words.is_at_end() {
                    return Ok(contents);
                }
                let at = words.at;
                read_row(run, &mut words, &mut indices, &mut contents)
                    .map_err(|message| Fault { at, error: fault(run.element, row - run.first_row, &message) })?;
                row += 1;
            }
        }
        Ok(contents)
    }
}

/// Lines that are not blank.
fn filled_lines(text: &[u8]) -> u64 {
    let lines = text.split(|&byte| byte == b'\n');
    lines.filter(|line| line.iter().any(|&byte| !is_space(byte))).count() as u64
}

/// Reads a line.
fn read_row(
    run: &Run<'_>,
    words: &mut Words<'_>,
    indices: &mut Vec<i64>,
    contents: &mut Contents,
) -> Result<(), String> {
    match run.role {
        Role::Vertices(axes) => {
            let mut position = [0.0; 3];
            for (at, property) in run.element.properties.iter().enumerate() {
                match axes.iter().position(|&axis| axis == at) {
                    Some(axis) => {
                        to_value(words)?;
                        position[axis] = words.coordinate()?;
                    }
                    None => skip(words, property)?,
                }
            }
            contents.positions.push(position);
        }
        Role::Polygons(list) => {
            read_list(run, list, words, indices)?;
            contents.polygons.polygon(indices.iter().copied())?;
        }
        Role::Strips(list) => {
            read_list(run, list, words, indices)?;
            contents.polygons.strip(indices.iter().copied())?;
        }
        Role::Skipped => {
            words.line();
            return Ok(());
        }
    }
    words.skip_blanks();
    match words.is_at_line_end() {
        true => Ok(()),
        false => {
            Err(format!("the line goes on after the last value that the header declares: {}", shown(words.word())))
        }
    }
}

/// Reads the values of a line, of which only a list of integers is kept.
fn read_list(run: &Run<'_>, list: usize, words: &mut Words<'_>, indices: &mut Vec<i64>) -> Result<(), String> {
    indices.clear();
    for (at, property) in run.element.properties.iter().enumerate() {
        if at != list {
            skip(words, property)?;
            continue;
        }
        for _ in 0..count(words, property)? {
            to_value(words)?;
            let index = words.integer();
            indices.push(index.ok_or_else(|| format!("a vertex index is not an integer: {}", shown(words.word())))?);
        }
    }
    Ok(())
}

/// Leaves out the values of a property.
fn skip(words: &mut Words<'_>, property: &Property<'_>) -> Result<(), String> {
    for _ in 0..count(words, property)? {
        to_value(words)?;
        words.word();
    }
    Ok(())
}

/// The number of values of a property on this line.
fn count(words: &mut Words<'_>, property: &Property<'_>) -> Result<u64, String> {
    if property.count.is_none() {
        return Ok(1);
    }
    to_value(words)?;
    let count = { *words }.integer().and_then(|count| u64::try_from(count).ok());
    let word = words.word();
    count.ok_or_else(|| format!("the number of values of a list is an integer from 0 on: {}", shown(word)))
}

/// Moves to the next value of the line.
#[inline]
fn to_value(words: &mut Words<'_>) -> Result<(), String> {
    words.skip_blanks();
    match words.is_at_line_end() {
        true => Err("the line ends before the last value that the header declares".to_owned()),
        false => Ok(()),
    }
}
