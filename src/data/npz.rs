//! Archives of arrays, as `numpy.savez` and `scipy.sparse.save_npz` write them.
//!
//! Entries are found by their exact names in one pass over the archive's directory, of which nothing is kept. Only the
//! arrays that are needed are inflated, together to no more bytes than the caller allows.

use std::borrow::Cow;
use std::io::Read;

use rawzip::{
    CompressionMethod, ZipArchive, ZipArchiveEntryWayfinder, ZipSliceArchive, ZipSliceEntry, ZipVerification,
};

use super::csr::Csr;
use super::npy::{self, Array, COUNTS};
use crate::error::{Error, Quoted, Result};

/// What every archive begins with, except an empty one.
pub const MAGIC: &[u8] = b"PK\x03\x04";

/// Times as many bytes as an archive has that may come of it,
const INFLATION: u64 = 100;
/// beyond these: masks and matrices of ones deflate a thousandfold.
const ANY_INFLATION: u64 = 1 << 26;

/// What [`COUNTS`] are, in words.
const COUNTS_IN_WORDS: &str = "int32, int64 or uint32, little-endian";
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

/// The first bytes of the array X, and the bytes that all arrays that are read have when they are inflated, at the
/// most.
pub(super) fn head_of_points(bytes: &[u8], limit: u64) -> Result<(Cow<'_, [u8]>, u64)> {
    let archive = Archive::open(bytes, limit)?;
    let inflated = archive.inflated(&["X", "weights", "mask", "indptr", "indices"])?;
    let x = archive.head("X")?.ok_or_else(|| archive.lacks("X"))?;
    Ok((x, inflated))
}

/// The bytes that the arrays of a matrix have when they are inflated, at the most.
pub fn inflated_of_graph(bytes: &[u8], limit: u64) -> Result<u64> {
    Archive::open(bytes, limit)?.inflated(&["format", "shape", "indptr", "indices", "data"])
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
        self.find(name)?.ok_or_else(|| self.lacks(name))
    }

    /// The error of an archive without an array.
    fn lacks(&self, name: &str) -> Error {
        let names = self.zip.entries().map_while(|entry| entry.ok()).take(8);
        let names: Vec<String> =
            names.map(|entry| String::from_utf8_lossy(entry.file_path().as_ref()).into_owned()).collect();
        let names = names.join(", ");
        Error::parameter(format_args!("the .npz file must have an entry {name}.npy; it has {}", Quoted(&names)))
    }

    /// Bytes that some arrays have when they are inflated, at the most.
    fn inflated(&self, names: &[&str]) -> Result<u64> {
        let mut sum = 0u64;
        for name in names {
            sum = sum.saturating_add(self.locate(name)?.map_or(0, |entry| entry.declared));
        }
        Ok(sum.min(self.limit))
    }

    /// An array's entry, if there is one. Of entries with the same name the last counts, as in Python.
    fn locate(&self, name: &str) -> Result<Option<Located>> {
        let mut found = None;
        for entry in self.zip.entries() {
            let entry = entry.map_err(|error| {
                Error::parameter(format_args!("the directory of the .npz file is damaged: {}", lower(&error)))
            })?;
            let path = entry.file_path();
            let path: &[u8] = path.as_ref();
            if path.strip_suffix(b".npy") == Some(name.as_bytes()) {
                found = Some(Located {
                    wayfinder: entry.wayfinder(),
                    method: entry.compression_method(),
                    is_encrypted: entry.flags().is_encrypted(),
                    declared: entry.uncompressed_size_hint(),
                });
            }
        }
        match found {
            Some(Located { is_encrypted: true, .. }) => Err(Error::parameter(format_args!(
                "the entry {name}.npy of the .npz file is encrypted, which is not read: save it without a password"
            ))),
            found => Ok(found),
        }
    }

    /// The bytes of an entry as they are stored.
    fn stored(&self, name: &str, entry: &ZipSliceEntry<'_>) -> Result<&'a [u8]> {
        let (start, end) = entry.compressed_data_range();
        let range = usize::try_from(start).ok().zip(usize::try_from(end).ok());
        range.and_then(|(start, end)| self.bytes.get(start..end)).ok_or_else(|| damaged(name, &"it ends early"))
    }

    /// The first bytes of the file of an array, as many as the longest header of one. Checks no sum.
    fn head(&self, name: &str) -> Result<Option<Cow<'a, [u8]>>> {
        let Some(Located { wayfinder, method, .. }) = self.locate(name)? else { return Ok(None) };
        let entry = self.zip.get_entry(wayfinder).map_err(|error| damaged(name, &error))?;
        let data = self.stored(name, &entry)?;
        match method {
            CompressionMethod::STORE => Ok(Some(Cow::Borrowed(&data[..data.len().min(npy::LONGEST_HEAD)]))),
            CompressionMethod::DEFLATE => {
                let mut head = Vec::new();
                let mut reader = flate2::bufread::DeflateDecoder::new(data).take(npy::LONGEST_HEAD as u64);
                reader.read_to_end(&mut head).map_err(|error| damaged(name, &error))?;
                Ok(Some(Cow::Owned(head)))
            }
            _ => Err(unknown_method(name, method)),
        }
    }

    /// The file of an array, if there is one.
    fn find(&mut self, name: &str) -> Result<Option<Cow<'a, [u8]>>> {
        let damaged = |error: &dyn std::fmt::Display| damaged(name, error);
        let Some(Located { wayfinder, method, .. }) = self.locate(name)? else { return Ok(None) };
        let entry = self.zip.get_entry(wayfinder).map_err(|error| damaged(&error))?;
        let data = self.stored(name, &entry)?;
        let verifier = entry.claim_verifier();
        let declared = verifier.uncompressed_size;
        self.left = self.left.checked_sub(declared).ok_or_else(|| {
            Error::too_large(format_args!(
                "the arrays of the .npz file may have at most {} bytes together; {name}.npy would pass that with \
                 {declared}; without compression (numpy.savez, save_npz(…, compressed=False)) there may be more",
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
            _ => Err(unknown_method(name, method)),
        }
    }
}

/// An entry that was found in the directory.
struct Located {
    wayfinder: ZipArchiveEntryWayfinder,
    method: CompressionMethod,
    is_encrypted: bool,
    /// Bytes that it has when it is inflated, as the directory says.
    declared: u64,
}

fn damaged(name: &str, error: &dyn std::fmt::Display) -> Error {
    Error::parameter(format_args!("the entry {name}.npy of the .npz file is damaged: {}", lower(error)))
}

fn unknown_method(name: &str, method: CompressionMethod) -> Error {
    Error::parameter(format_args!(
        "the entry {name}.npy of the .npz file must be stored or deflated, as numpy.savez and numpy.savez_compressed \
         do; its method is {method}"
    ))
}

/// A message of a library, as messages are here.
fn lower(error: &dyn std::fmt::Display) -> String {
    let text = error.to_string();
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |first| first.to_lowercase().chain(characters).collect())
}

#[cfg(test)]
mod tests;
