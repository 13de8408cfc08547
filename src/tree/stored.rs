//! The file that a hierarchy is kept in, `.tsr`.
//!
//! All numbers are little-endian, floats are IEEE 754 binary64. Sizes in bytes:
//!
//! | at | size | |
//! |---|---|---|
//! | 0 | 8 | `89 54 53 52 0D 0A 1A 0A`: no text, and spoilt by whatever spoils line ends |
//! | 8 | 4 | version of the format: 1 |
//! | 12 | 4 | H, the length of the header |
//! | 16 | 4 | F, the number of faces, 1 … 2³¹ |
//! | 20 | 4 | M, the number of merges, less than F |
//! | 24 | 4 | R, the number of rounds |
//! | 28 | 4 | 0 |
//! | 32 | 8 | V, the number of moves |
//! | 40 | H | header: a JSON object in UTF-8, see [`Header`] |
//! | | 24·R | rounds: clusters left u32, end of its merges u32, end of its moves u64, energy f64 |
//! | | 60·M | merges: into u32, from u32, faces u32, cost f64, energy f64, weight f64, proxy 3 × f64 |
//! | | 8·V | moves: face u32, the cluster it goes to u32 |
//! | | 32 | SHA-256 of everything before |
//!
//! What the numbers mean is said at [`Round`], [`Merge`] and [`FaceMove`]. Nothing follows.

use std::io::{self, Write};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::{FaceMove, Merge, Round, Tree};
use crate::error::{Error, Kind, Result};

/// The first bytes of the file.
pub const MAGIC: [u8; 8] = *b"\x89TSR\r\n\x1a\n";

const VERSION: u32 = 1;
const FIXED: usize = 40;
const ROUND: usize = 24;
const MERGE: usize = 60;
const MOVE: usize = 8;
const SUM: usize = 32;

/// Longest header that is read, in bytes.
const MAX_HEADER: usize = 1 << 20;

/// A hierarchy and where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Stored {
    /// Where it comes from.
    pub header: Header,
    /// The hierarchy.
    pub tree: Tree,
}

/// Where a hierarchy comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the program that made it.
    #[serde(rename = "tesserae")]
    pub version: String,
    /// The algorithm, as in parameters.
    pub algorithm: String,
    /// The parameters it ran with, defaults filled in.
    pub parameters: Map<String, Value>,
    /// The mesh: `format`, `vertices`, `faces`, `components`.
    pub input: Value,
}

impl Header {
    /// Connected components of the mesh, where the header says.
    pub fn components(&self) -> Option<u64> {
        self.input.get("components").and_then(Value::as_u64)
    }
}

impl Stored {
    /// Writes the file, a piece at a time.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let Tree { faces, merges, moves, rounds } = &self.tree;
        let header = serde_json::to_vec(&self.header)?;
        let mut out = Summing { out, sum: Sha256::new(), piece: Vec::with_capacity(2 * PIECE) };
        out.put(&MAGIC)?;
        for number in [VERSION, header.len() as u32, *faces, merges.len() as u32, rounds.len() as u32, 0] {
            out.put(&number.to_le_bytes())?;
        }
        out.put(&(moves.len() as u64).to_le_bytes())?;
        out.put(&header)?;
        for round in rounds {
            out.put(&round.clusters.to_le_bytes())?;
            out.put(&round.merges_end.to_le_bytes())?;
            out.put(&round.moves_end.to_le_bytes())?;
            out.put(&round.energy.to_le_bytes())?;
        }
        for merge in merges {
            for number in [merge.into, merge.from, merge.faces] {
                out.put(&number.to_le_bytes())?;
            }
            let [x, y, z] = merge.proxy;
            for number in [merge.cost, merge.energy, merge.weight, x, y, z] {
                out.put(&number.to_le_bytes())?;
            }
        }
        for moved in moves {
            out.put(&moved.face.to_le_bytes())?;
            out.put(&moved.to.to_le_bytes())?;
        }
        out.finish()
    }

    /// Reads a file that is whole in memory. Every size is checked against its length before anything is allocated, and
    /// the tree is checked before it is given out. The number of faces, which a short file can state too, is checked
    /// against `max_faces`.
    pub fn read(bytes: &[u8], max_faces: u64) -> Result<Self> {
        if !bytes.starts_with(&MAGIC) {
            return malformed("it is no hierarchy file (.tsr)");
        }
        let Some((fixed, rest)) = bytes.split_first_chunk::<FIXED>() else {
            return malformed("it ends early");
        };
        let version = u32_at(fixed, 8);
        if version != VERSION {
            return malformed(format_args!("only version {VERSION} is read, not {version}"));
        }
        let [header, faces, merges, rounds] = [12, 16, 20, 24].map(|at| u32_at(fixed, at));
        let sizes = [
            u128::from(header),
            u128::from(rounds) * ROUND as u128,
            u128::from(merges) * MERGE as u128,
            u128::from(u64_at(fixed, 32)) * MOVE as u128,
            SUM as u128,
        ];
        let expected: u128 = sizes.iter().sum();
        if rest.len() as u128 != expected {
            let expected = expected + FIXED as u128;
            return malformed(format_args!("it should have {expected} bytes, but has {}", bytes.len()));
        }
        if header as usize > MAX_HEADER || u32_at(fixed, 28) != 0 {
            return malformed("its first bytes are not those of a hierarchy");
        }
        if u64::from(faces) > max_faces {
            return Err(Error::too_large(format_args!(
                "the hierarchy has more faces than the limit of {max_faces}: {faces}"
            )));
        }
        // They sum to the length of a slice, so each fits.
        let [header, rounds, merges, moves, _] = sizes.map(|size| size as usize);
        let (header, rest) = rest.split_at(header);
        let (rounds, rest) = rest.split_at(rounds);
        let (merges, rest) = rest.split_at(merges);
        let (moves, sum) = rest.split_at(moves);
        let whole = &bytes[..bytes.len() - SUM];
        let (actual, tree) = rayon::join(
            || Sha256::digest(whole),
            || Tree {
                faces,
                merges: merges.chunks_exact(MERGE).map(merge_of).collect(),
                moves: moves.chunks_exact(MOVE).map(move_of).collect(),
                rounds: rounds.chunks_exact(ROUND).map(round_of).collect(),
            },
        );
        if actual[..] != *sum {
            return malformed("it was changed or damaged: its checksum is wrong");
        }
        let header = serde_json::from_slice(header)
            .map_err(|error| Error::new(Kind::BadRequest, format_args!("the hierarchy cannot be read: {error}")))?;
        tree.check()?;
        Ok(Self { header, tree })
    }
}

fn malformed<T>(what: impl std::fmt::Display) -> Result<T> {
    Err(Error::new(Kind::BadRequest, format_args!("the hierarchy cannot be read: {what}")))
}

/// A number at an offset within a record, whose length the caller knows.
fn u32_at(record: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
}

fn u64_at(record: &[u8], at: usize) -> u64 {
    u64::from(u32_at(record, at)) | u64::from(u32_at(record, at + 4)) << 32
}

fn f64_at(record: &[u8], at: usize) -> f64 {
    f64::from_bits(u64_at(record, at))
}

fn round_of(record: &[u8]) -> Round {
    Round {
        clusters: u32_at(record, 0),
        merges_end: u32_at(record, 4),
        moves_end: u64_at(record, 8),
        energy: f64_at(record, 16),
    }
}

fn merge_of(record: &[u8]) -> Merge {
    Merge {
        into: u32_at(record, 0),
        from: u32_at(record, 4),
        faces: u32_at(record, 8),
        cost: f64_at(record, 12),
        energy: f64_at(record, 20),
        weight: f64_at(record, 28),
        proxy: [36, 44, 52].map(|at| f64_at(record, at)),
    }
}

fn move_of(record: &[u8]) -> FaceMove {
    FaceMove { face: u32_at(record, 0), to: u32_at(record, 4) }
}

/// Bytes that are summed and passed on at once.
const PIECE: usize = 1 << 16;

/// Passes bytes on and sums them on the way.
struct Summing<'a> {
    out: &'a mut dyn Write,
    sum: Sha256,
    piece: Vec<u8>,
}

impl Summing<'_> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.piece.extend_from_slice(bytes);
        if self.piece.len() >= PIECE { self.pass_on() } else { Ok(()) }
    }

    fn pass_on(&mut self) -> io::Result<()> {
        self.sum.update(&self.piece);
        self.out.write_all(&self.piece)?;
        self.piece.clear();
        Ok(())
    }

    fn finish(mut self) -> io::Result<()> {
        self.pass_on()?;
        self.out.write_all(&self.sum.finalize())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

    fn file() -> Vec<u8> {
        let mut bytes = Vec::new();
        small().write(&mut bytes).expect("a vector takes everything");
        bytes
    }

    /// A file with the right checksum.
    fn summed(mut bytes: Vec<u8>) -> Vec<u8> {
        let end = bytes.len() - SUM;
        let sum = Sha256::digest(&bytes[..end]);
        bytes[end..].copy_from_slice(&sum);
        bytes
    }

    #[test]
    fn what_was_written_is_read() {
        assert_eq!(Stored::read(&file(), 7), Ok(small()));
    }

    #[test]
    fn a_file_that_ends_early_or_late_is_refused() {
        let bytes = file();
        for length in 0..bytes.len() {
            assert!(Stored::read(&bytes[..length], 7).is_err(), "{length} bytes");
        }
        assert!(Stored::read(&[bytes, vec![0]].concat(), 7).is_err());
    }

    #[test]
    fn a_flipped_bit_is_noticed_wherever_it_is() {
        let bytes = file();
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut flipped = bytes.clone();
                flipped[at] ^= 1 << bit;
                assert!(Stored::read(&flipped, 1000).is_err(), "bit {bit} of byte {at}");
            }
        }
    }

    #[test]
    fn a_hostile_file_with_a_right_checksum_is_refused_or_harmless() {
        let bytes = file();
        let (mut refused, mut read) = (0, 0);
        for at in 0..bytes.len() - SUM {
            for value in [0, 1, 2, 6, 7, 0x7f, 0x80, 0xff] {
                let mut changed = bytes.clone();
                changed[at] = value;
                match Stored::read(&summed(changed), 1000) {
                    Err(_) => refused += 1,
                    Ok(stored) => {
                        read += 1;
                        for clusters in 0..9 {
                            let _ = stored.tree.labels_at(clusters);
                        }
                        let mut out = Vec::new();
                        stored.write_json(&mut out, Default::default()).expect("a vector takes everything");
                        serde_json::from_slice::<Value>(&out).expect("JSON");
                        let _ = stored.linkage();
                    }
                }
            }
        }
        assert!(refused > 500 && read > 500, "{refused} refused, {read} read");
    }

    #[test]
    fn more_faces_than_allowed_are_refused() {
        let error = Stored::read(&file(), 6).expect_err("too many");
        assert_eq!(error.kind, Kind::TooLarge);
    }

    #[test]
    fn counts_beyond_the_file_allocate_nothing() {
        for (at, size) in [(12, 4), (16, 4), (20, 4), (24, 4), (32, 8)] {
            let mut bytes = file();
            bytes[at..at + size].fill(0xff);
            let error = Stored::read(&summed(bytes), 1000).expect_err("too much");
            assert!(error.message.contains("bytes") || error.message.contains("faces"), "{error}");
        }
    }
}
