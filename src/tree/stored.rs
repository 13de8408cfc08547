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

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::check::check_rounds;
use super::replay::{CutPlan, Replay, check_range};
use super::{Cut, FaceMove, Merge, Round, Tree};
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

/// Bytes of records that are read at once.
const READ_AT_ONCE: usize = 1 << 20;

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
    /// Connected components of what was clustered, where the header says.
    pub fn components(&self) -> Option<u64> {
        match self.parameters.get("bridge_components") {
            Some(Value::Bool(true)) => Some(1),
            _ => self.input.get("components").and_then(Value::as_u64),
        }
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

    /// Reads a file of `length` bytes. Every size is checked against that before anything is allocated, and the tree is
    /// checked before it is given out. The number of faces, which a short file can state too, is checked against
    /// `max_faces`.
    pub fn read(from: impl Read, length: u64, max_faces: u64) -> Result<Self> {
        let mut reader = Reader::new(from);
        let sizes = reader.sizes(length, max_faces)?;
        let header = reader.header(&sizes)?;
        let rounds = reader.all(sizes.rounds, round_of)?;
        let merges = reader.all(sizes.merges, merge_of)?;
        let moves = reader.all(sizes.moves, move_of)?;
        reader.finish()?;
        let tree = Tree { faces: sizes.faces, merges, moves, rounds };
        tree.check()?;
        Ok(Self { header, tree })
    }
}

/// A cut of a hierarchy in a file, without the tree ever being in memory; see [`Tree::labels_at`] and [`Stored::read`].
pub fn cut(from: impl Read, length: u64, max_faces: u64, clusters: u64) -> Result<(Header, Cut)> {
    let mut reader = Reader::new(from);
    let sizes = reader.sizes(length, max_faces)?;
    let header = reader.header(&sizes)?;
    let rounds = reader.all(sizes.rounds, round_of)?;
    check_rounds(sizes.faces, sizes.merges, sizes.moves, &rounds)?;
    check_range(sizes.faces, rounds.last().map_or(sizes.faces, |round| round.clusters), clusters)?;
    let plan = CutPlan::of(&rounds, sizes.faces, clusters as u32);
    let mut replay = Replay::new(sizes.faces, plan);
    let mut left = plan.merges();
    reader.each::<MERGE>(sizes.merges, |records| {
        let used = records.iter().take(left);
        left -= used.len();
        used.map(merge_of).try_for_each(|merge| replay.merge(merge.into, merge.from, merge.cost))
    })?;
    let mut left = plan.moves;
    reader.each::<MOVE>(sizes.moves, |records| {
        let used = records.iter().take(left);
        left -= used.len();
        used.map(move_of).try_for_each(|moved| replay.give(moved))
    })?;
    reader.finish()?;
    Ok((header, replay.finish()?))
}

/// What the first bytes say; all of it together is as long as the file.
#[derive(Debug, Clone, Copy)]
struct Sizes {
    header: usize,
    faces: u32,
    rounds: u64,
    merges: u64,
    moves: u64,
}

/// Reads a file from its start to its end and sums it on the way.
struct Reader<R> {
    from: R,
    sum: Sha256,
    piece: Vec<u8>,
}

impl<R: Read> Reader<R> {
    fn new(from: R) -> Self {
        Self { from, sum: Sha256::new(), piece: Vec::new() }
    }

    /// The next bytes, which go into the sum.
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.from.read_exact(&mut bytes).map_err(cannot_read)?;
        self.sum.update(bytes);
        Ok(bytes)
    }

    fn sizes(&mut self, length: u64, max_faces: u64) -> Result<Sizes> {
        if length < FIXED as u64 {
            return malformed("it is no hierarchy file (.tsr), or ends early");
        }
        let fixed: [u8; FIXED] = self.bytes()?;
        if !fixed.starts_with(&MAGIC) {
            return malformed("it is no hierarchy file (.tsr)");
        }
        let version = u32_at(&fixed, 8);
        if version != VERSION {
            return malformed(format_args!("only version {VERSION} is read, not {version}"));
        }
        let [header, faces, merges, rounds] = [12, 16, 20, 24].map(|at| u32_at(&fixed, at));
        let moves = u64_at(&fixed, 32);
        let expected = [
            (u64::from(header), 1),
            (u64::from(rounds), ROUND),
            (u64::from(merges), MERGE),
            (moves, MOVE),
            (1, FIXED + SUM),
        ]
        .iter()
        .map(|&(count, size)| u128::from(count) * size as u128)
        .sum::<u128>();
        if u128::from(length) != expected {
            return malformed(format_args!("it should have {expected} bytes, but has {length}"));
        }
        if header as usize > MAX_HEADER || u32_at(&fixed, 28) != 0 {
            return malformed("its first bytes are not those of a hierarchy");
        }
        if u64::from(faces) > max_faces {
            return Err(Error::too_large(format_args!(
                "the hierarchy has more faces than the limit of {max_faces}: {faces}"
            )));
        }
        let header = header as usize;
        Ok(Sizes { header, faces, rounds: rounds.into(), merges: merges.into(), moves })
    }

    fn header(&mut self, sizes: &Sizes) -> Result<Header> {
        let mut json = vec![0; sizes.header];
        self.from.read_exact(&mut json).map_err(cannot_read)?;
        self.sum.update(&json);
        serde_json::from_slice(&json)
            .map_err(|error| Error::new(Kind::BadRequest, format_args!("the hierarchy cannot be read: {error}")))
    }

    /// Gives the next `count` records of N bytes to `apply`, many at a time, which are summed meanwhile.
    fn each<const N: usize>(
        &mut self,
        count: u64,
        mut apply: impl FnMut(&[[u8; N]]) -> Result<()> + Send,
    ) -> Result<()> {
        let at_once = (READ_AT_ONCE / N) as u64;
        let mut left = count;
        while left > 0 {
            let records = left.min(at_once);
            left -= records;
            self.piece.resize(records as usize * N, 0);
            self.from.read_exact(&mut self.piece).map_err(cannot_read)?;
            let (sum, piece) = (&mut self.sum, &self.piece);
            let (_, applied) = rayon::join(|| sum.update(piece), || apply(piece.as_chunks().0));
            applied?;
        }
        Ok(())
    }

    /// The next `count` records of N bytes.
    fn all<const N: usize, T: Send>(&mut self, count: u64, record: impl Fn(&[u8; N]) -> T + Sync) -> Result<Vec<T>> {
        let too_much =
            |_| Error::new(Kind::TooLarge, format_args!("the hierarchy does not fit into memory: {count} records"));
        let mut all = Vec::new();
        all.try_reserve_exact(usize::try_from(count).unwrap_or(usize::MAX)).map_err(too_much)?;
        self.each(count, |records| {
            all.extend(records.iter().map(&record));
            Ok(())
        })?;
        Ok(all)
    }

    /// Compares the sums.
    fn finish(mut self) -> Result<()> {
        let actual = self.sum.finalize();
        let mut stated = [0; SUM];
        self.from.read_exact(&mut stated).map_err(cannot_read)?;
        if actual[..] != stated {
            return malformed("it was changed or damaged: its checksum is wrong");
        }
        Ok(())
    }
}

fn cannot_read(error: io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => Error::new(Kind::BadRequest, "the hierarchy cannot be read: it ends early"),
        _ => Error::io("the hierarchy cannot be read", error),
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

fn round_of(record: &[u8; ROUND]) -> Round {
    Round {
        clusters: u32_at(record, 0),
        merges_end: u32_at(record, 4),
        moves_end: u64_at(record, 8),
        energy: f64_at(record, 16),
    }
}

fn merge_of(record: &[u8; MERGE]) -> Merge {
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

fn move_of(record: &[u8; MOVE]) -> FaceMove {
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
mod tests;
