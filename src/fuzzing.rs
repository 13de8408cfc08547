//! Parsers that are not public, for the fuzzers (`fuzz/`). Tests compile them too, so that `make lint` reads them.

use crate::data::{self, Graph, Members, lay, npz};
use crate::error::{Error, Result};
use crate::export::archive::Archive;
use crate::job;
use crate::mesh::{Resources, number};

/// Bytes before and after the first `separator`; all of them before it when there is none.
pub fn split<'a>(bytes: &'a [u8], separator: &[u8]) -> (&'a [u8], &'a [u8]) {
    match bytes.windows(separator.len()).position(|window| window == separator) {
        Some(at) => (&bytes[..at], &bytes[at + separator.len()..]),
        None => (bytes, &[]),
    }
}

/// One buffer, which every URI leads to.
#[derive(Debug)]
pub struct One<'a>(pub &'a [u8]);

impl Resources for One<'_> {
    fn load(&self, uri: &str, max_bytes: u64) -> Result<Vec<u8>> {
        match self.0.len() as u64 > max_bytes {
            true => Err(Error::too_large(format_args!("more than {max_bytes}: {uri}"))),
            false => Ok(self.0.to_vec()),
        }
    }
}

/// A number, and whether the standard library reads the same; integers saturate at ±2⁴⁰.
pub fn number(bytes: &[u8]) {
    if let Some((value, length)) = number::float(bytes) {
        let text = std::str::from_utf8(&bytes[..length]).expect("a number is ASCII");
        let expected: f64 = text.parse().expect("what is read as a number is one");
        assert_eq!(value.to_bits(), expected.to_bits(), "{text}");
    }
    if let Some((value, length)) = number::integer(bytes) {
        let text = std::str::from_utf8(&bytes[..length]).expect("a number is ASCII");
        if let Ok(expected) = text.parse::<i64>() {
            assert_eq!(value, expected.clamp(-(1 << 40), 1 << 40), "{text}");
        }
    }
}

/// Lists of seeds, of weights and of labels.
pub fn lists(bytes: &[u8]) {
    let _ = job::parse_seeds(bytes);
    let _ = job::parse_weights(bytes);
    let _ = job::check_head_of_weights(bytes);
    let _ = job::parse_labels(bytes, 4);
}

/// Points as a file; as a sparse matrix; and, with separators, as the arrays of an archive whose checksums are right.
pub fn points(bytes: &[u8]) {
    const LIMIT: u64 = 1 << 24;
    let graph = [None, Some(Graph::Grid { full: true }), Some(Graph::Knn(3))];
    let graph = graph[bytes.len() % 3].clone();
    let _ = npz::graph(bytes, LIMIT);
    let mut archive = Vec::new();
    let mut writer = Archive::new(&mut archive);
    let mut rest = bytes;
    for name in ["X", "indptr", "indices", "weights", "mask", "format", "shape", "data"] {
        let (array, after) = split(rest, b"\n===\n");
        if !array.is_empty() {
            writer.add(&format!("{name}.npy"), array).expect("memory");
        }
        rest = after;
    }
    writer.finish().expect("memory");
    let _ = npz::graph(&archive, LIMIT);
    for (bytes, graph) in [(bytes, graph), (&archive, None)] {
        match data::read(bytes, graph, LIMIT) {
            Ok(set) if set.items() < 1 << 10 => {
                lay::<64>(&set, &Members::new(set.items(), set.mask.as_deref()), true).expect("few points");
            }
            _ => {}
        }
    }
}
