//! The header: the encoding of what follows, and which elements with which properties it holds.
//!
//! ```text
//! ply
//! format binary_little_endian 1.0
//! element vertex 8
//! property float x
//! …
//! element face 6
//! property list uchar int vertex_indices
//! end_header
//! ```
//!
//! Its lines end at line feeds, or at carriage returns where the first line does. The data begin right after the line
//! `end_header`: the next byte is data, even if it is a line feed.

use super::value::{Order, Type};
use crate::error::{Error, Quoted, Result};
use crate::mesh::text::is_space;

/// Longest header that is read, in bytes.
const LONGEST: usize = 1 << 20;

/// Most elements of a file.
const MAX_ELEMENTS: usize = 64;

/// Most properties of all elements of a file.
const MAX_PROPERTIES: usize = 256;

/// What a header says.
#[derive(Debug)]
pub struct Header<'a> {
    /// How values are written.
    pub encoding: Encoding,
    /// The elements in the order of their rows in the file.
    pub elements: Vec<Element<'a>>,
    /// Bytes of the header.
    pub bytes: usize,
    /// Lines of the header.
    pub lines: u64,
}

/// How values are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// As text, a line a row.
    Text,
    /// As bytes.
    Binary(Order),
}

impl Encoding {
    /// Its name in the header.
    pub fn name(self) -> &'static str {
        match self {
            Self::Text => "ascii",
            Self::Binary(Order::Little) => "binary_little_endian",
            Self::Binary(Order::Big) => "binary_big_endian",
        }
    }
}

/// A kind of rows.
#[derive(Debug)]
pub struct Element<'a> {
    /// Its name.
    pub name: &'a [u8],
    /// Number of rows that the header declares.
    pub rows: u64,
    /// The values of a row.
    pub properties: Vec<Property<'a>>,
}

/// A value or a list of values in every row of an element.
#[derive(Debug)]
pub struct Property<'a> {
    /// Its name.
    pub name: &'a [u8],
    /// Type of the number of values of a list; none for a single value.
    pub count: Option<Type>,
    /// Type of its values.
    pub value: Type,
}

/// Whether a file with these first bytes is a PLY: its first line is `ply`.
pub fn is_ply(head: &[u8]) -> bool {
    let rest = head.strip_prefix(b"ply").unwrap_or_default();
    rest.iter().find(|byte| !matches!(byte, b' ' | b'\t')).is_some_and(|end| matches!(end, b'\n' | b'\r'))
}

/// Reads the header of a file that [is a PLY](is_ply).
pub fn parse(bytes: &[u8]) -> Result<Header<'_>> {
    let head = &bytes[..bytes.len().min(LONGEST)];
    let end = line_end(head);
    let mut encoding = None;
    let mut elements = Vec::new();
    let mut properties = 0;
    let (mut at, mut lines) = (0, 0);
    while at < head.len() {
        let length = match memchr::memchr(end, &head[at..]) {
            Some(length) => length,
            None if head.len() < bytes.len() => break,
            None => head.len() - at,
        };
        let line = &head[at..at + length];
        at = head.len().min(at + length + 1);
        lines += 1;
        if add_line(line, lines, &mut encoding, &mut elements, &mut properties)? {
            let encoding = encoding.ok_or_else(|| {
                Error::mesh("the PLY header has no format line, such as: format binary_little_endian 1.0")
            })?;
            return Ok(Header { encoding, elements, bytes: at, lines });
        }
    }
    Err(Error::mesh(format_args!(
        "the PLY header does not end: there is no line end_header in the first bytes of the file: {}",
        head.len()
    )))
}

/// The byte that lines end with.
fn line_end(head: &[u8]) -> u8 {
    let first = head.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
    match first.and_then(|at| head.get(at..at + 2)) {
        Some([b'\r', b'\n']) | None => b'\n',
        Some(end) => end[0],
    }
}

/// Takes a line of the header; whether it is the last.
fn add_line<'a>(
    line: &'a [u8],
    number: u64,
    encoding: &mut Option<Encoding>,
    elements: &mut Vec<Element<'a>>,
    properties: &mut usize,
) -> Result<bool> {
    let fault = |what: &str, word: &[u8]| {
        let word = String::from_utf8_lossy(word);
        Error::mesh(format_args!("line {number} of the PLY header: {what}: {}", Quoted(&word)))
    };
    let type_of = |name: &[u8]| {
        let what = "a type is one of char, uchar, short, ushort, int, uint, float and double";
        Type::of(name).ok_or_else(|| fault(what, name))
    };
    let mut all = line.split(|&byte| is_space(byte)).filter(|word| !word.is_empty());
    let words: [&[u8]; 6] = std::array::from_fn(|_| all.next().unwrap_or_default());
    match words {
        [b"ply", ..] if number == 1 => {}
        [b"" | b"comment" | b"obj_info", ..] => {}
        [b"end_header", ..] => return Ok(true),
        [b"format", ..] if encoding.is_some() => return Err(fault("the format is given twice", words[1])),
        [b"format", name, version, b"", ..] => {
            if version != b"1.0" {
                return Err(fault("only version 1.0 of PLY is read", version));
            }
            *encoding = Some(match name {
                b"ascii" => Encoding::Text,
                b"binary_little_endian" => Encoding::Binary(Order::Little),
                b"binary_big_endian" => Encoding::Binary(Order::Big),
                _ => {
                    return Err(fault("the format is one of ascii, binary_little_endian and binary_big_endian", name));
                }
            });
        }
        [b"element", name, rows, b"", ..] if !rows.is_empty() => {
            let digits = std::str::from_utf8(rows).ok().filter(|rows| rows.bytes().all(|digit| digit.is_ascii_digit()));
            let Some(rows) = digits.and_then(|rows| rows.parse().ok()) else {
                return Err(fault("the number of rows of an element is an integer from 0 to 2^64 - 1", rows));
            };
            if elements.len() == MAX_ELEMENTS {
                return Err(fault(&format!("there are more elements than the limit of {MAX_ELEMENTS}"), name));
            }
            elements.push(Element { name, rows, properties: Vec::new() });
        }
        [b"property", ..] => {
            let Some(element) = elements.last_mut() else {
                return Err(fault("a property comes before the first element", line.trim_ascii()));
            };
            *properties += 1;
            if *properties > MAX_PROPERTIES {
                let what = format!("there are more properties than the limit of {MAX_PROPERTIES}");
                return Err(fault(&what, line.trim_ascii()));
            }
            element.properties.push(match words {
                [_, b"list", count, value, name, b""] if !name.is_empty() => {
                    let count = type_of(count)?;
                    if !count.is_integer() {
                        let what = format!("the number of values of the list {} must be an integer", shown(name));
                        return Err(fault(&what, words[2]));
                    }
                    Property { name, count: Some(count), value: type_of(value)? }
                }
                [_, value, name, b"", ..] if !name.is_empty() => Property { name, count: None, value: type_of(value)? },
                _ => {
                    let what = "a property is written as \"property TYPE NAME\" or \"property list TYPE TYPE NAME\"";
                    return Err(fault(what, line.trim_ascii()));
                }
            });
        }
        _ => {
            let what = "a line is one of format, comment, obj_info, element, property and end_header";
            return Err(fault(what, line.trim_ascii()));
        }
    }
    Ok(false)
}

/// A name, for messages.
pub fn shown(name: &[u8]) -> String {
    Quoted(&String::from_utf8_lossy(name)).to_string()
}
