//! Arrays in NumPy's `.npy` format, versions 1 to 3.
//!
//! No memory is taken for elements before the header and the length of the data agree.

mod literal;

use std::borrow::Cow;

use self::literal::Literal;
use crate::error::{Error, Result};

/// What every such file begins with.
pub const MAGIC: &[u8] = b"\x93NUMPY";

/// Element types of whole numbers that count or number things.
pub const COUNTS: [&str; 3] = ["<i4", "<i8", "<u4"];

/// Bytes of a header. NumPy writes some 100; version 1 has no more.
const LONGEST_HEADER: usize = 1 << 16;
/// First bytes of a file that are enough to read its header.
pub(super) const LONGEST_HEAD: usize = 12 + LONGEST_HEADER;

/// An array whose bytes are there, in C order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Array<'a> {
    /// The element type that was found, of those that were allowed.
    pub kind: &'static str,
    /// The length of each dimension; their product is the number of elements.
    pub shape: Vec<usize>,
    /// The elements, one after the other.
    pub data: Cow<'a, [u8]>,
}

/// Opens an array; `what` names it in messages. `kinds` are the allowed element types, as `<f4`, with the bytes of an
/// element as their last character; `wanted` says the same in words.
pub fn parse<'a>(bytes: &'a [u8], what: &str, kinds: &[&'static str], wanted: &str) -> Result<Array<'a>> {
    let (header, data) = split(bytes, what)?;
    let header = header.trim();
    let malformed = || malformed(what, header);
    let literal = Literal::read(header).ok_or_else(malformed)?;
    let kind = match literal.get("descr").ok_or_else(malformed)? {
        Literal::Text(found) => kinds.iter().copied().find(|kind| kind == found),
        // the fields of a structure
        _ => None,
    };
    let Some(kind) = kind else {
        return Err(Error::parameter(format_args!(
            "the .npy {what} must hold {wanted}, as numpy's astype makes them: {header}"
        )));
    };
    let shape = shape_of(&literal).ok_or_else(malformed)?;
    let Some(&Literal::Truth(is_fortran)) = literal.get("fortran_order") else { return Err(malformed()) };
    if is_fortran && shape.len() > 1 {
        return Err(Error::parameter(format_args!(
            "the .npy {what} is in Fortran order: save numpy.ascontiguousarray of it: {header}"
        )));
    }
    let width = width(kind);
    let count = shape.iter().try_fold(1usize, |count, &length| count.checked_mul(length));
    if count.and_then(|count| count.checked_mul(width)) != Some(data.len()) {
        let count = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(" × ");
        let count = if count.is_empty() { "1".to_owned() } else { count };
        return Err(Error::parameter(format_args!(
            "the .npy {what} should hold {count} numbers of {width} bytes, but its data has bytes: {}",
            data.len()
        )));
    }
    Ok(Array { kind, shape, data: data.into() })
}

/// The shape that the header says, whatever follows it; `what` as in [`parse`].
pub(super) fn shape(head: &[u8], what: &str) -> Result<Vec<usize>> {
    let (header, _) = split(head, what)?;
    let header = header.trim();
    Literal::read(header).as_ref().and_then(shape_of).ok_or_else(|| malformed(what, header))
}

fn malformed(what: &str, header: &str) -> Error {
    Error::parameter(format_args!("the .npy {what} has a header that cannot be read: {header}"))
}

fn shape_of(literal: &Literal) -> Option<Vec<usize>> {
    let Some(Literal::Tuple(shape)) = literal.get("shape") else { return None };
    let length = |literal: &Literal| match literal {
        Literal::Number(length) => usize::try_from(*length).ok(),
        _ => None,
    };
    shape.iter().map(length).collect()
}

/// Opens an array of one dimension, as [`parse`] does.
pub fn parse_flat<'a>(bytes: &'a [u8], what: &str, kinds: &[&'static str], wanted: &str) -> Result<Array<'a>> {
    let array = parse(bytes, what, kinds, wanted)?;
    array.flat(what)
}

/// The header and what follows it.
fn split<'a>(bytes: &'a [u8], what: &str) -> Result<(Cow<'a, str>, &'a [u8])> {
    let ends_early = || Error::parameter(format_args!("the .npy {what} ends early"));
    if !bytes.starts_with(MAGIC) {
        return Err(Error::parameter(format_args!("the {what} is no .npy array, as numpy.save writes it")));
    }
    let (length_bytes, start) = match bytes.get(6).ok_or_else(ends_early)? {
        1 => (2, 10),
        2 | 3 => (4, 12),
        version => {
            return Err(Error::parameter(format_args!("the .npy {what} is of an unknown version: {version}")));
        }
    };
    let length = bytes.get(8..8 + length_bytes).ok_or_else(ends_early)?;
    let length = length.iter().rev().fold(0usize, |length, &byte| length << 8 | usize::from(byte));
    if length > LONGEST_HEADER {
        return Err(Error::parameter(format_args!(
            "the .npy {what} has a header of more than {LONGEST_HEADER} bytes: {length}"
        )));
    }
    let (header, data) = bytes[start..].split_at_checked(length).ok_or_else(ends_early)?;
    Ok((String::from_utf8_lossy(header), data))
}

/// Bytes of an element: the last character of its type.
fn width(kind: &str) -> usize {
    kind.bytes().last().map_or(1, |digit| usize::from(digit.saturating_sub(b'0')).max(1))
}

impl Array<'_> {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.data.len() / width(self.kind)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Bytes of an element.
    pub fn width(&self) -> usize {
        width(self.kind)
    }

    /// The array, if it has one dimension; `what` names it in the error.
    pub fn flat(self, what: &str) -> Result<Self> {
        match self.shape.len() {
            1 => Ok(self),
            _ => Err(Error::parameter(format_args!(
                "the .npy {what} must have one dimension, not the shape: {:?}",
                self.shape
            ))),
        }
    }

    /// Floats of 4 or 8 bytes.
    pub fn floats(&self) -> Vec<f64> {
        match self.kind {
            "<f4" => self.data.as_chunks().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect(),
            _ => self.data.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect(),
        }
    }

    /// Whole numbers of 4 or 8 bytes; those above 2⁶³ − 1 become that.
    pub fn whole_numbers(&self) -> Box<dyn ExactSizeIterator<Item = i64> + '_> {
        let (fours, eights) = (self.data.as_chunks().0, self.data.as_chunks().0);
        let saturated = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
        match self.kind {
            "<u4" => Box::new(fours.iter().map(|bytes| u32::from_le_bytes(*bytes).into())),
            "<i4" => Box::new(fours.iter().map(|bytes| i32::from_le_bytes(*bytes).into())),
            "<u8" => Box::new(eights.iter().map(move |bytes| saturated(u64::from_le_bytes(*bytes)))),
            _ => Box::new(eights.iter().map(|bytes| i64::from_le_bytes(*bytes))),
        }
    }

    /// Which elements are not 0, whatever their type.
    pub fn is_set(&self) -> impl Iterator<Item = bool> + '_ {
        let width = self.width();
        // a float whose sign alone is set is 0, too
        let sign = if self.kind.starts_with("<f") { 0x7f } else { 0xff };
        self.data.chunks_exact(width).map(move |bytes| {
            let (last, others) = bytes.split_last().unwrap_or((&0, &[]));
            last & sign != 0 || others.iter().any(|&byte| byte != 0)
        })
    }
}

#[cfg(test)]
mod tests;
