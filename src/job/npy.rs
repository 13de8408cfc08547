//! One-dimensional arrays in NumPy's `.npy` format, versions 1 to 3.

use crate::error::{Error, Result};

/// What every such file begins with.
pub const MAGIC: &[u8] = b"\x93NUMPY";

/// An array whose bytes are there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Array<'a> {
    /// The element type that was found, of those that were allowed.
    pub kind: &'static str,
    /// The elements, one after the other.
    pub data: &'a [u8],
}

/// Opens an array; `what` names it in messages. `kinds` are the allowed element types, as `<f4`, with the bytes of an
/// element as their last character; `wanted` says the same in words.
pub fn parse<'a>(bytes: &'a [u8], what: &str, kinds: &[&'static str], wanted: &str) -> Result<Array<'a>> {
    let malformed = || Error::parameter(format_args!("the .npy {what} ends early"));
    let (length_bytes, start) = match bytes.get(6).ok_or_else(malformed)? {
        1 => (2, 10),
        2 | 3 => (4, 12),
        version => {
            return Err(Error::parameter(format_args!("the .npy {what} is of an unknown version: {version}")));
        }
    };
    let mut length = 0usize;
    for &byte in bytes.get(8..8 + length_bytes).ok_or_else(malformed)?.iter().rev() {
        length = length << 8 | usize::from(byte);
    }
    let header = bytes.get(start..).and_then(|rest| rest.get(..length)).ok_or_else(malformed)?;
    let header = String::from_utf8_lossy(header);
    let data = &bytes[start + length..];
    let kind = kinds.iter().copied().find(|kind| header.contains(&format!("'{kind}'")));
    let Some(kind) = kind else {
        return Err(Error::parameter(format_args!("the .npy {what} must hold {wanted}: {}", header.trim())));
    };
    let shape = header
        .split_once("'shape':")
        .and_then(|(_, rest)| rest.split_once('('))
        .and_then(|(_, rest)| rest.split_once(')'));
    let count: Option<usize> = shape.and_then(|(inside, _)| inside.trim().trim_end_matches(',').trim().parse().ok());
    let Some(count) = count else {
        return Err(Error::parameter(format_args!("the .npy {what} must have one dimension: {}", header.trim())));
    };
    let width = if kind.ends_with('8') { 8 } else { 4 };
    if !data.len().is_multiple_of(width) || data.len() / width != count {
        return Err(Error::parameter(format_args!(
            "the .npy {what} should hold {count} numbers of {width} bytes, but its data has bytes: {}",
            data.len()
        )));
    }
    Ok(Array { kind, data })
}
