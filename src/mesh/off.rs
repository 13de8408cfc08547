//! OFF, the object file format of Geomview, as text.
//!
//! ```text
//! COFF                 letters before OFF: more numbers follow the coordinates of a vertex
//! 4 2 0                vertices, faces, edges
//! 0 0 0 255 0 0 255    a vertex a line
//! …
//! 3 0 1 2 0.5 0.5 0.5  a face a line: corners, their vertices, perhaps a colour
//! ```
//!
//! Read are the coordinates of vertices and the corners of faces; normals, colours and texture coordinates are skipped,
//! as is what follows `#` on a line. Rows become faces in their order, and a face of fewer than three corners keeps its
//! place as a degenerate triangle, as in PLY.
//!
//! The lines after the header are cut into pieces, which are read in parallel once their lines are counted. They have a
//! fixed size, so the result, errors included, does not depend on the number of threads. What the header declares is
//! compared with the lines before anything is allocated.

use super::polygons::Polygons;
use super::text::{self, Words, line_number, with_line_feeds};
use super::{Format, Limits, Opened, PolygonMesh, ReadMesh, Source, without_mark};
use crate::error::{Error, Quoted, Result};
use crate::parallel;

/// Bytes of a piece.
const PIECE: usize = 256 << 10;

/// Pieces whose lines one thread counts, at least.
const COUNTED_AT_ONCE: usize = 4;

/// Whether a file with these first bytes is an OFF.
pub fn is_off(head: &[u8]) -> bool {
    let mut words = Words { text: without_mark(head), at: 0 };
    to_word(&mut words);
    Keyword::parse(words.word()).is_some()
}

/// Refuses what begins like no OFF file.
pub fn check_head(head: &[u8]) -> Result<()> {
    if !is_off(head) {
        return Err(Format::Off.is_not("it does not begin with \"OFF\""));
    }
    Ok(())
}

/// Opens an OFF file: reads its header, and compares what it declares with the lines that follow.
pub fn open(source: Source<'_>, then: &mut dyn FnMut(Opened<'_>)) -> Result<()> {
    let Source { bytes, limits, .. } = source;
    let text = with_line_feeds(without_mark(bytes));
    let header = Header::parse(&text)?;
    if memchr::memchr(0, &text).is_some() {
        return Err(Error::mesh(
            "the OFF file holds zero bytes, so it is no text: binary OFF is not read; write it as text",
        ));
    }
    let rows = Rows::open(&header, &text)?;
    limits.check_faces(header.faces)?;
    then(Opened::new(header.faces, || rows.read(limits)));
    Ok(())
}

/// The word that a file begins with.
struct Keyword<'a> {
    /// Letters that say what vertices have besides three coordinates.
    letters: &'a [u8],
    /// The number of vertices, where no blank separates it.
    rest: &'a [u8],
}

impl<'a> Keyword<'a> {
    fn parse(word: &'a [u8]) -> Option<Self> {
        let at = word.windows(3).position(|three| three == b"OFF")?;
        let (letters, rest) = (&word[..at], &word[at + 3..]);
        let are_known = letters.iter().all(|letter| matches!(letter, b'S' | b'T' | b'C' | b'N' | b'4' | b'n'));
        (are_known && rest.iter().all(u8::is_ascii_digit)).then_some(Self { letters, rest })
    }
}

/// What a file declares.
struct Header {
    vertices: u64,
    faces: u64,
    /// Where the line after it begins.
    end: usize,
}

impl Header {
    fn parse(text: &[u8]) -> Result<Self> {
        let mut words = Words { text, at: 0 };
        to_word(&mut words);
        let start = words.at;
        let Some(Keyword { letters, rest }) = Keyword::parse(words.word()) else {
            return Err(Format::Off.is_not("it does not begin with \"OFF\""));
        };
        if letters.iter().any(|letter| matches!(letter, b'4' | b'n')) {
            return Err(Error::mesh(format_args!(
                "the vertices of the OFF file have other than three coordinates, which is not read: {}",
                Quoted(&String::from_utf8_lossy(&text[start..words.at]))
            )));
        }
        words.at -= rest.len();
        to_word(&mut words);
        if { words }.word() == b"BINARY" {
            return Err(Error::mesh("binary OFF is not read: write the file as text, or convert it to PLY or GLB"));
        }
        let vertices = Self::number(&mut words, "vertices")?;
        to_word(&mut words);
        let faces = Self::number(&mut words, "faces")?;
        // the number of edges, which some files leave out, and nothing needs
        words.skip_blanks();
        words.integer();
        words.skip_blanks();
        if !ends(&words) {
            let line = line_number(text, words.at);
            return Err(Error::mesh(format_args!(
                "line {line}: the line of the OFF file goes on after its numbers of vertices, faces and edges: {}",
                shown(words.word())
            )));
        }
        words.line();
        Ok(Self { vertices, faces, end: words.at })
    }

    fn number(words: &mut Words<'_>, what: &str) -> Result<u64> {
        let line = line_number(words.text, words.at);
        let number = { *words }.integer().and_then(|number| u64::try_from(number).ok());
        let word = words.word();
        number.ok_or_else(|| {
            Error::mesh(format_args!("line {line}: the number of {what} is an integer from 0 on: {}", shown(word)))
        })
    }
}

/// The lines after the header that are not blank.
struct Rows<'a> {
    text: &'a [u8],
    vertices: u64,
    faces: u64,
    pieces: Vec<Piece<'a>>,
    /// Lines after the last face.
    unread: u64,
}

/// Lines that one thread reads.
struct Piece<'a> {
    text: &'a [u8],
    /// Offset of the piece in the file.
    at: usize,
    /// Number of rows before it.
    first_row: u64,
}

/// What the lines of a piece hold.
struct Contents {
    positions: Vec<[f64; 3]>,
    polygons: Polygons,
}

/// A line that cannot be read.
struct Fault {
    /// Offset of the line in its piece.
    at: usize,
    message: String,
}

impl<'a> Rows<'a> {
    /// Counts the lines.
    ///
    /// # Errors
    /// There are fewer than the header declares.
    fn open(header: &Header, text: &'a [u8]) -> Result<Self> {
        let &Header { vertices, faces, end } = header;
        let cut = text::pieces(&text[end..], PIECE, |_| true);
        // small files are counted by the thread that opens them
        let counts: Vec<u64> = parallel::map(cut.len(), COUNTED_AT_ONCE, |piece| rows_of(cut[piece]));
        let (mut at, mut lines) = (end, 0);
        let pieces = cut.into_iter().zip(counts).map(|(text, count)| {
            let piece = Piece { text, at, first_row: lines };
            (at, lines) = (at + text.len(), lines + count);
            piece
        });
        let pieces = pieces.collect();
        // each is at most 2⁴⁰
        let declared = vertices + faces;
        if declared > lines {
            return Err(Error::mesh(format_args!(
                "the OFF file is truncated, so copy or write it again: its header counts {vertices} vertices and \
                 {faces} faces, one a line, and {lines} lines follow"
            )));
        }
        Ok(Self { text, vertices, faces, pieces, unread: lines - declared })
    }

    fn read(&self, limits: &Limits) -> Result<ReadMesh> {
        let parsed: Vec<Result<Contents, Fault>> =
            parallel::map(self.pieces.len(), 1, |piece| self.parse(&self.pieces[piece]));
        let mut positions = Vec::with_capacity(self.vertices as usize);
        let mut polygons = Polygons::new(self.vertices, 0);
        for (parsed, piece) in parsed.into_iter().zip(&self.pieces) {
            let mut parsed = parsed.map_err(|Fault { at, message }| {
                Error::mesh(format_args!("line {}: {message}", line_number(self.text, piece.at + at)))
            })?;
            positions.append(&mut parsed.positions);
            polygons.append(&parsed.polygons).map_err(Error::mesh)?;
        }
        self.finish(positions, polygons, limits)
    }

    fn parse(&self, piece: &Piece<'_>) -> Result<Contents, Fault> {
        let mut contents = Contents { positions: Vec::new(), polygons: Polygons::new(self.vertices, 0) };
        let mut words = Words { text: piece.text, at: 0 };
        let mut indices = Vec::new();
        for row in piece.first_row..self.vertices + self.faces {
            to_word(&mut words);
            if words.is_at_end() {
                break;
            }
            let at = words.at;
            let of_vertex = |message| format!("vertex {row} (from 0): {message}");
            let of_face = |message| format!("face {} (from 0): {message}", row - self.vertices);
            let read = if row < self.vertices {
                position(&mut words).map(|position| contents.positions.push(position)).map_err(of_vertex)
            } else {
                let read = corners(&mut words, &mut indices);
                read.and_then(|()| contents.polygons.polygon(indices.iter().copied())).map_err(of_face)
            };
            read.map_err(|message| Fault { at, message })?;
            words.line();
        }
        Ok(contents)
    }

    fn finish(&self, positions: Vec<[f64; 3]>, polygons: Polygons, limits: &Limits) -> Result<ReadMesh> {
        let Polygons { faces, short, .. } = polygons;
        if faces.is_empty() {
            return Err(no_faces(self.vertices));
        }
        limits.check_faces(faces.len() as u64)?;
        if self.vertices == 0 {
            return Err(Error::mesh("the OFF file has faces without corners only, since it has no vertices"));
        }
        let mut warnings = Vec::new();
        if short > 0 {
            warnings.push(format!("faces of fewer than 3 corners were kept as degenerate triangles: {short}"));
        }
        if self.unread > 0 {
            warnings.push(format!("lines after the last face were ignored: {}", self.unread));
        }
        Ok(PolygonMesh { warnings, ..PolygonMesh::of_one_part(Format::Off, positions, faces) }.into())
    }
}

fn no_faces(vertices: u64) -> Error {
    Error::mesh(format_args!(
        "the mesh has no faces: the header of the OFF file counts none, as of a point cloud; vertices: {vertices}"
    ))
}

/// Moves to the next word that is in no comment, on this line or a later one.
fn to_word(words: &mut Words<'_>) {
    words.skip_space();
    while words.text.get(words.at) == Some(&b'#') {
        words.line();
        words.skip_space();
    }
}

/// Whether no word follows on the line; blanks must have been skipped.
fn ends(words: &Words<'_>) -> bool {
    words.is_at_line_end() || words.text.get(words.at) == Some(&b'#')
}

/// Lines that hold a word outside comments.
fn rows_of(text: &[u8]) -> u64 {
    let is_row = |line: &&[u8]| line.iter().find(|&&byte| !text::is_space(byte)).is_some_and(|&byte| byte != b'#');
    text.split(|&byte| byte == b'\n').filter(is_row).count() as u64
}

/// Reads the coordinates of a vertex.
fn position(words: &mut Words<'_>) -> Result<[f64; 3], String> {
    let mut position = [0.0; 3];
    for coordinate in &mut position {
        words.skip_blanks();
        if ends(words) {
            return Err("the line ends before its third coordinate".to_owned());
        }
        *coordinate = words.coordinate()?;
    }
    Ok(position)
}

/// Reads the corners of a face.
fn corners(words: &mut Words<'_>, indices: &mut Vec<i64>) -> Result<(), String> {
    indices.clear();
    let count = { *words }.integer().and_then(|count| u64::try_from(count).ok());
    let word = words.word();
    let count = count.ok_or_else(|| format!("the number of corners is an integer from 0 on: {}", shown(word)))?;
    for _ in 0..count {
        words.skip_blanks();
        if ends(words) {
            return Err(format!("the line ends before the last of its corners, {count}"));
        }
        let index = words.integer();
        indices.push(index.ok_or_else(|| format!("a vertex index is not an integer: {}", shown(words.word())))?);
    }
    Ok(())
}

/// A word as messages show it.
fn shown(word: &[u8]) -> String {
    Quoted(&String::from_utf8_lossy(word)).to_string()
}
