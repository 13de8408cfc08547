//! Archives of arrays, as `numpy.savez` and `scipy.sparse.save_npz` write them.
//!
//! Entries are found by their exact names in one pass over the archive's directory, of which nothing is kept. Only the
//! arrays that are needed are inflated, together to no more bytes than the caller allows.

use std::borrow::Cow;
use std::io::Read;

use rawzip::{CompressionMethod, ZipArchive, ZipSliceArchive, ZipVerification};

use super::csr::Csr;
use super::npy::{self, Array, COUNTS};
use crate::error::{Error, Quoted, Result};

/// What every archive begins with, except an empty one.
pub const MAGIC: &[u8] = b"PK\x03\x04";

/// Times as many bytes as an archive has that may come of it,
const INFLATION: u64 = 100;
/// beyond these: small arrays may be very regular.
const ANY_INFLATION: u64 = 1 << 20;

/// What [`COUNTS`] are, in words.
const COUNTS_IN_WORDS: &str = "little-endian whole numbers of 4 or 8 bytes";
/// Element types of a matrix.
const NUMBERS: [&str; 11] = ["<f4", "<f8", "|b1", "|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8"];

/// The arrays of points in an archive, inflated, and their edges.
pub(super) struct Npz<'a> {
    pub x: Cow<'a, [u8]>,
    pub weights: Option<Cow<'a, [u8]>>,
    pub mask: Option<Cow<'a, [u8]>>,
    pub csr: Option<Csr>,
}

/// Opens an archive with arrays X and, if they are there, weights, mask, indptr and indices.
pub(super) fn open(bytes: &[u8], limit: u64) -> Result<Npz<'_>> {
    let mut archive = Archive::open(bytes, limit)?;
    let x = archive.take("X")?;
    let (indptr, indices) = (archive.find("indptr")?, archive.find("indices")?);
    let csr = match (indptr, indices) {
        (Some(indptr), Some(indices)) => Some(rows(&indptr, &indices)?),
        (None, None) => None,
        (indptr, _) => {
            let (there, missing) = if indptr.is_some() { ("indptr", "indices") } else { ("indices", "indptr") };
            return Err(Error::parameter(format_args!(
                "the .npz file has an array {there}, so it must have another: {missing}"
            )));
        }
    };
    Ok(Npz { x, weights: archive.find("weights")?, mask: archive.find("mask")?, csr })
}

/// A matrix that `scipy.sparse.save_npz` wrote, as edges: its entries other than 0. Rows or columns, it is the same:
/// edges have no direction. `limit` bounds the bytes that are inflated.
pub fn graph(bytes: &[u8], limit: u64) -> Result<Csr> {
    let mut archive = Archive::open(bytes, limit)?;
    let format = archive.take("format")?;
    let format = npy::parse(&format, "array format", &["|S3"], "three letters, as scipy.sparse.save_npz writes them")?;
    if !matches!(&format.data[..], b"csr" | b"csc") {
        return Err(Error::parameter(format_args!(
            "the sparse matrix must have compressed rows or columns: save_npz of graph.tocsr(); its format is {}",
            Quoted(&String::from_utf8_lossy(&format.data))
        )));
    }
    let shape = archive.take("shape")?;
    let shape = npy::parse_flat(&shape, "array shape", &COUNTS, COUNTS_IN_WORDS)?;
    let shape: Vec<i64> = shape.whole_numbers().collect();
    let csr = rows(&archive.take("indptr")?, &archive.take("indices")?)?;
    if shape.len() != 2 || shape.iter().any(|&length| length != csr.items() as i64) {
        return Err(Error::parameter(format_args!(
            "the sparse matrix must be square, and indptr has {} rows; its shape is {shape:?}",
            csr.items()
        )));
    }
    let data = archive.take("data")?;
    let data = npy::parse_flat(&data, "array data", &NUMBERS, "numbers")?;
    if data.len() != csr.entries() {
        return Err(Error::parameter(format_args!(
            "the sparse matrix must have as many entries as indices, {}, not {}",
            csr.entries(),
            data.len()
        )));
    }
    Ok(csr.filtered(data.is_set()))
}

fn rows(indptr: &[u8], indices: &[u8]) -> Result<Csr> {
    let indptr = npy::parse_flat(indptr, "array indptr", &COUNTS, COUNTS_IN_WORDS)?;
    let indices = npy::parse_flat(indices, "array indices", &COUNTS, COUNTS_IN_WORDS)?;
    let numbers = Array::whole_numbers;
    Csr::new(numbers(&indptr), numbers(&indices))
}

/// An archive of which entries are read one by one.
struct Archive<'a> {
    zip: ZipSliceArchive<&'a [u8]>,
    bytes: &'a [u8],
    limit: u64,
    left: u64,
}

impl<'a> Archive<'a> {
    fn open(bytes: &'a [u8], limit: u64) -> Result<Self> {
        let zip = ZipArchive::from_slice(bytes).map_err(|error| {
            Error::parameter(format_args!("the file is no .npz archive, as numpy.savez writes it: {}", lower(&error)))
        })?;
        let limit = limit.min(ANY_INFLATION.saturating_add(INFLATION.saturating_mul(bytes.len() as u64)));
        Ok(Self { zip, bytes, limit, left: limit })
    }

    /// The file of an array that must be there.
    fn take(&mut self, name: &str) -> Result<Cow<'a, [u8]>> {
        self.find(name)?.ok_or_else(|| {
            let names = self.zip.entries().map_while(|entry| entry.ok()).take(8);
            let names: Vec<String> =
                names.map(|entry| String::from_utf8_lossy(entry.file_path().as_ref()).into_owned()).collect();
            let names = names.join(", ");
            Error::parameter(format_args!("the .npz file must have an entry {name}.npy; it has {}", Quoted(&names)))
        })
    }

    /// The file of an array, if there is one. Of entries with the same name the last counts, as in Python.
    fn find(&mut self, name: &str) -> Result<Option<Cow<'a, [u8]>>> {
        let damaged = |error: &dyn std::fmt::Display| {
            Error::parameter(format_args!("the entry {name}.npy of the .npz file is damaged: {}", lower(error)))
        };
        let mut found = None;
        for entry in self.zip.entries() {
            let entry = entry.map_err(|error| {
                Error::parameter(format_args!("the directory of the .npz file is damaged: {}", lower(&error)))
            })?;
            let path = entry.file_path();
            let path: &[u8] = path.as_ref();
            if path.strip_suffix(b".npy") == Some(name.as_bytes()) {
                found = Some((entry.wayfinder(), entry.compression_method()));
            }
        }
        let Some((wayfinder, method)) = found else { return Ok(None) };
        let entry = self.zip.get_entry(wayfinder).map_err(|error| damaged(&error))?;
        let (start, end) = entry.compressed_data_range();
        let data = usize::try_from(start).ok().zip(usize::try_from(end).ok());
        let data = data.and_then(|(start, end)| self.bytes.get(start..end)).ok_or_else(|| damaged(&"it ends early"))?;
        let verifier = entry.claim_verifier();
        let declared = verifier.uncompressed_size;
        self.left = self.left.checked_sub(declared).ok_or_else(|| {
            Error::too_large(format_args!(
                "the arrays of the .npz file may have at most {} bytes together; {name}.npy would pass that with \
                 {declared}",
                self.limit
            ))
        })?;
        match method {
            CompressionMethod::STORE => {
                let actual = ZipVerification { crc: rawzip::crc32(data), uncompressed_size: data.len() as u64 };
                verifier.valid(actual).map_err(|error| damaged(&error))?;
                Ok(Some(Cow::Borrowed(data)))
            }
            CompressionMethod::DEFLATE => {
                let mut inflated = Vec::new();
                let decoder = flate2::bufread::DeflateDecoder::new(data);
                // one byte more shows that there are more than declared
                let mut reader = entry.verifying_reader(decoder).take(declared.saturating_add(1));
                reader.read_to_end(&mut inflated).map_err(|error| damaged(&error))?;
                if inflated.len() as u64 != declared {
                    return Err(damaged(&"it has more bytes than its directory says"));
                }
                Ok(Some(Cow::Owned(inflated)))
            }
            _ => Err(Error::parameter(format_args!(
                "the entry {name}.npy of the .npz file must be stored or deflated, as numpy.savez and \
                 numpy.savez_compressed do; its method is {method}"
            ))),
        }
    }
}

/// A message of a library, as messages are here.
fn lower(error: &dyn std::fmt::Display) -> String {
    let text = error.to_string();
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |first| first.to_lowercase().chain(characters).collect())
}

#[cfg(test)]
mod tests;
