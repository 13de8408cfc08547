//! The binary container: a header and chunks, each of which says how long it is.
//!
//! What they say is compared with the bytes that are there; nothing is allocated.

use crate::error::{Error, Quoted, Result};
use crate::mesh::Format;

pub const MAGIC: &[u8; 4] = b"glTF";
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// The parts of a GLB file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Container<'a> {
    /// The JSON chunk.
    pub json: &'a [u8],
    /// The binary chunk, where there is one.
    pub binary: Option<&'a [u8]>,
}

/// Takes a GLB file apart.
pub fn open(bytes: &[u8]) -> Result<Container<'_>> {
    check_head(bytes, Some(bytes.len() as u64))?;
    let mut json = None;
    let mut binary = None;
    let mut rest = &bytes[HEADER..];
    let mut number = 0;
    while !rest.is_empty() {
        let Some((length, kind)) = chunk_header(rest) else {
            return Err(Error::mesh(format_args!(
                "GLB chunk {number} is truncated: its header has {CHUNK_HEADER} bytes, the file ends after {}",
                rest.len()
            )));
        };
        let data = &rest[CHUNK_HEADER..];
        let Some((data, behind)) = data.split_at_checked(length as usize) else {
            return Err(chunk_too_long(number, length, data.len() as u64));
        };
        match &kind {
            b"JSON" if number == 0 => json = Some(data),
            b"BIN\0" if binary.is_none() => binary = Some(data),
            // chunks of other kinds belong to extensions
            _ => {}
        }
        rest = behind;
        number += 1;
    }
    let json = json.ok_or_else(|| Error::mesh("GLB chunk 0 is missing: the file ends after its header"))?;
    Ok(Container { json, binary })
}

/// Refuses what is plainly no GLB file, or one whose header contradicts its length, by its first bytes.
///
/// `length` is the length of the whole file, where it is known.
pub fn check_head(head: &[u8], length: Option<u64>) -> Result<()> {
    if !head.starts_with(MAGIC) {
        return Err(
            Format::Glb.is_not("it does not begin with the magic \"glTF\", so it is of another format or damaged")
        );
    }
    let (Some(version), Some(declared)) = (word(head, 4), word(head, 8)) else {
        return Err(Error::mesh(format_args!(
            "the GLB file is truncated: a header has {HEADER} bytes, and the file ends after {}",
            head.len()
        )));
    };
    if version == 1 {
        return Err(super::head::of_version_1());
    }
    if version != 2 {
        return Err(Error::unsupported(format_args!("only version 2 of GLB is read, the header says: {version}")));
    }
    if let Some(length) = length.filter(|&length| length != u64::from(declared)) {
        let how = if length < u64::from(declared) { "truncated" } else { "longer than its header says" };
        return Err(Error::mesh(format_args!(
            "the GLB file is {how}, so copy or send it again: its header declares {declared} bytes, it has {length}"
        )));
    }
    let Some((chunk, kind)) = head.get(HEADER..).and_then(chunk_header) else {
        // too few bytes at hand, or a file without chunks, which `open` refuses
        return Ok(());
    };
    if &kind != b"JSON" {
        return Err(Error::mesh(format_args!(
            "GLB chunk 0 must be of type JSON, so the file is damaged: {}",
            Quoted(&String::from_utf8_lossy(&kind))
        )));
    }
    let there = u64::from(declared).saturating_sub((HEADER + CHUNK_HEADER) as u64);
    if u64::from(chunk) > there {
        return Err(chunk_too_long(0, chunk, there));
    }
    Ok(())
}

fn chunk_too_long(number: u32, declared: u32, there: u64) -> Error {
    Error::mesh(format_args!(
        "GLB chunk {number} is truncated: it declares {declared} bytes, the file has {there} for it"
    ))
}

/// Length and kind of the chunk that `bytes` begins with.
fn chunk_header(bytes: &[u8]) -> Option<(u32, [u8; 4])> {
    Some((word(bytes, 0)?, word(bytes, 4)?.to_le_bytes()))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|word| u32::from_le_bytes(*word))
}
