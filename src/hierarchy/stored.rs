//! The file that a hierarchy is kept in, `.tsr`.
//!
//! All numbers are little-endian, floats are IEEE 754 binary64. The content, sizes in bytes:
//!
//! | at | size | |
//! |---|---|---|
//! | 0 | 8 | `89 54 53 52 0D 0A 1A 0A`: no text, and spoilt by whatever spoils line ends |
//! | 8 | 4 | version of the format: 2 |
//! | 12 | 4 | H, the length of the header |
//! | 16 | 4 | F, the number of faces, 1 … 2³¹ |
//! | 20 | 4 | M, the number of merges, less than F |
//! | 24 | 4 | R, the number of rounds |
//! | 28 | 4 | C, the number of checkpoints |
//! | 32 | 8 | V, the number of moves |
//! | 40 | H | header: a JSON object in UTF-8, see [`Header`] |
//! | | 32·R | the rounds |
//! | | 16·M + 8·V + 4·F·C | for each round its merges, its moves and its checkpoint, if it has one |
//! | | 44·M | the clusters that merges made: faces u32, energy f64, weight f64, proxy 3 × f64 |
//!
//! A round is: clusters left u32, end of its merges u32, end of its moves u64, energy f64, 1 as u32 if a checkpoint
//! follows it and else 0, 0 u32. A merge is: into u32, from u32, cost f64. A move is: face u32, the cluster it goes to
//! u32. A checkpoint has for each face the living cluster that it is in, u32.
//!
//! What the numbers mean is said at [`Round`], [`super::Merge`] and [`super::FaceMove`]. The file is this content in
//! blocks, each with a checksum ([`blocks`]), and nothing else.
//!
//! # Why checkpoints
//!
//! A cut starts at the last checkpoint before it and reads only what lies between: however long the run was, that is
//! one label a face and records of fewer than [`BETWEEN_CHECKPOINTS`] bytes a face and of one round more. Besides it
//! reads the list of rounds, which is short for parallel hierarchies, and has 32 bytes a face for those that merge one
//! pair a round. Blocks before and after are not read.

use std::io::{self, Write};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use self::blocks::{BlockReader, BlockWriter, Unreadable, framed};
use self::records::{LABEL, MOVE, NODE, PAIR, Pair, ROUND, u32_at, u64_at};
use super::check::check_rounds;
use super::replay::{CutPlan, Replay, check_range};
use super::{Cut, Round, Tree, contradiction};
use crate::error::{Error, Kind, Result};

pub use self::blocks::Input;

mod blocks;
mod records;

/// The first bytes of the file.
pub const MAGIC: [u8; 8] = *b"\x89TSR\r\n\x1a\n";

const VERSION: u32 = 2;
const FIXED: usize = 40;

/// Longest header that is read, in bytes.
const MAX_HEADER: usize = 1 << 20;

/// Bytes of records that are read at once.
const READ_AT_ONCE: usize = 1 << 20;

/// A round has a checkpoint when the records since the last one have as many bytes for each face. So checkpoints make
/// up no more than a third of all of them.
const BETWEEN_CHECKPOINTS: u64 = 8;

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
    /// Writes the file, a piece at a time. Beside the tree, 8 bytes a face are taken for the checkpoints.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let Tree { faces, merges, moves, rounds } = &self.tree;
        let header = serde_json::to_vec(&self.header)?;
        let mut out = BlockWriter::new(out);
        let has_checkpoint = self.checkpoints();
        let checkpoints = has_checkpoint.iter().filter(|&&has| has).count();
        out.put(&MAGIC)?;
        let [header_length, merge_count, round_count] = [header.len(), merges.len(), rounds.len()].map(|n| n as u32);
        for number in [VERSION, header_length, *faces, merge_count, round_count, checkpoints as u32] {
            out.put(&number.to_le_bytes())?;
        }
        out.put(&(moves.len() as u64).to_le_bytes())?;
        out.put(&header)?;
        for (round, &has_checkpoint) in rounds.iter().zip(&has_checkpoint) {
            out.put(&records::round_bytes(round, has_checkpoint))?;
        }
        let mut replay = Replay::new(*faces);
        for (round, &has_checkpoint) in has_checkpoint.iter().enumerate() {
            let (merges, moves) = self.tree.records_of(round);
            merges.iter().try_for_each(|merge| out.put(&Pair::bytes(merge)))?;
            moves.iter().try_for_each(|moved| out.put(&records::move_bytes(moved)))?;
            self.tree.replay(round, &mut replay).map_err(io::Error::other)?;
            if has_checkpoint {
                replay.clusters().iter().try_for_each(|cluster| out.put(&cluster.to_le_bytes()))?;
            }
        }
        merges.iter().try_for_each(|merge| out.put(&records::node_bytes(merge)))?;
        out.finish()
    }

    /// Length of the file in bytes.
    pub fn bytes(&self) -> u64 {
        let Tree { faces, merges, moves, rounds } = &self.tree;
        let header = serde_json::to_vec(&self.header).map_or(MAX_HEADER, |header| header.len());
        let checkpoints = self.checkpoints().iter().filter(|&&has| has).count();
        let records = rounds.len() * ROUND + merges.len() * (PAIR + NODE) + moves.len() * MOVE;
        let content = FIXED + header + records + *faces as usize * LABEL * checkpoints;
        u64::try_from(framed(content as u128)).unwrap_or(u64::MAX)
    }

    /// Which rounds have checkpoints.
    fn checkpoints(&self) -> Vec<bool> {
        let mut since = 0;
        let has_checkpoint = |round| {
            let (merges, moves) = self.tree.records_of(round);
            since += (merges.len() * PAIR + moves.len() * MOVE) as u64;
            let is_far = since >= BETWEEN_CHECKPOINTS * u64::from(self.tree.faces);
            if is_far {
                since = 0;
            }
            is_far
        };
        (0..self.tree.rounds.len()).map(has_checkpoint).collect()
    }

    /// Reads a file of `length` bytes. Every size is checked against that before anything is allocated, and the tree is
    /// checked before it is given out. The number of faces, which a short file can state too, is checked against
    /// `max_faces`.
    pub fn read(from: impl Input, length: u64, max_faces: u64) -> Result<Self> {
        let mut reader = Reader(BlockReader::new(from, length));
        let sizes = reader.sizes(length, max_faces)?;
        let header = reader.header(&sizes)?;
        let (rounds, has_checkpoint) = reader.rounds(&sizes)?;
        let mut tree = Tree { faces: sizes.faces, merges: room(sizes.merges)?, moves: room(sizes.moves)?, rounds };
        // up to the last checkpoint, for which there are as many bytes in the file
        let mut replay = (sizes.checkpoints > 0).then(|| Replay::new(sizes.faces));
        let last = has_checkpoint.iter().rposition(|&has| has);
        for (round, &has_checkpoint) in has_checkpoint.iter().enumerate() {
            let (merges, moves) = extent(&tree.rounds, round);
            reader.append(&mut tree.merges, merges, |record| Pair::of(record).merge())?;
            reader.append(&mut tree.moves, moves, records::move_of)?;
            let Some(replay) = replay.as_mut().filter(|_| last >= Some(round)) else { continue };
            tree.replay(round, replay)?;
            if has_checkpoint {
                let mut expected = replay.clusters().iter();
                reader.each::<LABEL>(sizes.faces.into(), |labels| {
                    match labels.iter().all(|label| Some(&u32::from_le_bytes(*label)) == expected.next()) {
                        true => Ok(()),
                        false => contradiction("checkpoint of round", round + 1),
                    }
                })?;
            }
        }
        drop(replay);
        let mut merges = tree.merges.iter_mut();
        reader.each::<NODE>(sizes.merges, |nodes| {
            nodes.iter().zip(&mut merges).for_each(|(node, merge)| records::complete(merge, node));
            Ok(())
        })?;
        tree.check()?;
        Ok(Self { header, tree })
    }
}

/// A cut of a hierarchy in a file, without the tree ever being in memory; see [`Tree::labels_at`] and [`Stored::read`].
/// Only what the cut needs is read, and only that is compared with its checksums. Whether a checkpoint is what the
/// merges and moves before it make, only [`Stored::read`] looks.
pub fn cut(from: impl Input, length: u64, max_faces: u64, clusters: u64) -> Result<(Header, Cut)> {
    let mut reader = Reader(BlockReader::new(from, length));
    let sizes = reader.sizes(length, max_faces)?;
    let header = reader.header(&sizes)?;
    let (rounds, has_checkpoint) = reader.rounds(&sizes)?;
    check_range(sizes.faces, rounds.last().map_or(sizes.faces, |round| round.clusters), clusters)?;
    let plan = CutPlan::of(&rounds, sizes.faces, clusters as u32);
    let (start, mut replay) = match has_checkpoint[..plan.rounds].iter().rposition(|&has| has) {
        None => (0, Replay::new(sizes.faces)),
        Some(last) => {
            let checkpoints = has_checkpoint[..last].iter().filter(|&&has| has).count() as u64;
            let round @ Round { merges_end, moves_end, .. } = &rounds[last];
            let labels = checkpoints * u64::from(sizes.faces) * LABEL as u64;
            reader.skip(u64::from(*merges_end) * PAIR as u64 + moves_end * MOVE as u64 + labels)?;
            let mut clusters = room(sizes.faces.into())?;
            reader.append::<LABEL, _>(&mut clusters, sizes.faces.into(), |label| u32::from_le_bytes(*label))?;
            (last + 1, Replay::starting_from(clusters, round)?)
        }
    };
    for round in start..plan.rounds {
        let (merges, moves) = extent(&rounds, round);
        reader.each::<PAIR>(merges, |pairs| {
            pairs.iter().map(Pair::of).try_for_each(|pair| replay.merge(pair.into, pair.from))
        })?;
        reader
            .each::<MOVE>(moves, |moves| moves.iter().map(records::move_of).try_for_each(|moved| replay.give(moved)))?;
    }
    let mut energy = plan.energy;
    reader.each::<PAIR>(plan.extra_merges as u64, |pairs| {
        pairs.iter().map(Pair::of).try_for_each(|pair| {
            energy += pair.cost;
            replay.merge(pair.into, pair.from)
        })
    })?;
    Ok((header, plan.finish(replay, energy)?))
}

/// Merges and moves of a round.
fn extent(rounds: &[Round], round: usize) -> (u64, u64) {
    let before = round.checked_sub(1).map_or(Round::default(), |before| rounds[before]);
    (u64::from(rounds[round].merges_end - before.merges_end), rounds[round].moves_end - before.moves_end)
}

/// An empty list with room for so many records.
fn room<T>(records: u64) -> Result<Vec<T>> {
    let too_much =
        |_| Error::new(Kind::TooLarge, format_args!("the hierarchy does not fit into memory: {records} records"));
    let mut all = Vec::new();
    all.try_reserve_exact(usize::try_from(records).unwrap_or(usize::MAX)).map_err(too_much)?;
    Ok(all)
}

/// What the first bytes say; all of it together is as long as the file.
#[derive(Debug, Clone, Copy)]
struct Sizes {
    header: usize,
    faces: u32,
    rounds: u64,
    merges: u64,
    moves: u64,
    checkpoints: u64,
}

/// Reads the parts of a file, in their order.
struct Reader<R>(BlockReader<R>);

impl<R: Input> Reader<R> {
    fn sizes(&mut self, length: u64, max_faces: u64) -> Result<Sizes> {
        // what it is comes before whether it is whole, for the sake of the message
        let first: &[u8] = self.0.peek::<FIXED>().map_err(cannot_read)?;
        if !first.starts_with(&MAGIC) {
            return malformed("it is no hierarchy file (.tsr)");
        }
        if first.len() < FIXED {
            return malformed("it ends early");
        }
        let version = u32_at(first, 8);
        if version != VERSION {
            return malformed(format_args!(
                "only version {VERSION} of the format is read, make the hierarchy again: it has version {version}"
            ));
        }
        let [header, faces, merges, rounds, checkpoints] = [12, 16, 20, 24, 28].map(|at| u32_at(first, at));
        let moves = u64_at(first, 32);
        let content = [
            (1, FIXED as u64),
            (1, u64::from(header)),
            (rounds, ROUND as u64),
            (merges, (PAIR + NODE) as u64),
            (checkpoints, u64::from(faces) * LABEL as u64),
        ]
        .iter()
        .map(|&(count, size)| u128::from(count) * u128::from(size))
        .sum::<u128>();
        let expected = framed(content + u128::from(moves) * MOVE as u128);
        if u128::from(length) != expected {
            return malformed(format_args!("it should have {expected} bytes, but has {length}"));
        }
        if header as usize > MAX_HEADER {
            return malformed("its first bytes are not those of a hierarchy");
        }
        if u64::from(faces) > max_faces {
            return Err(Error::too_large(format_args!(
                "the hierarchy has more faces than the limit of {max_faces}: {faces}"
            )));
        }
        self.skip(FIXED as u64)?;
        Ok(Sizes {
            header: header as usize,
            faces,
            rounds: rounds.into(),
            merges: merges.into(),
            moves,
            checkpoints: checkpoints.into(),
        })
    }

    fn header(&mut self, sizes: &Sizes) -> Result<Header> {
        let json = self.0.some(sizes.header, sizes.header).map_err(unreadable)?;
        serde_json::from_slice(json)
            .map_err(|error| Error::new(Kind::BadRequest, format_args!("the hierarchy cannot be read: {error}")))
    }

    /// The rounds, and which of them have checkpoints.
    fn rounds(&mut self, sizes: &Sizes) -> Result<(Vec<Round>, Vec<bool>)> {
        let (mut rounds, mut has_checkpoint) = (room(sizes.rounds)?, room(sizes.rounds)?);
        self.each::<ROUND>(sizes.rounds, |records| {
            for record in records {
                let Some((round, has)) = records::round_of(record) else {
                    return contradiction("round", rounds.len() + 1);
                };
                rounds.push(round);
                has_checkpoint.push(has);
            }
            Ok(())
        })?;
        check_rounds(sizes.faces, sizes.merges, sizes.moves, &rounds)?;
        let checkpoints = has_checkpoint.iter().filter(|&&has| has).count() as u64;
        if checkpoints != sizes.checkpoints {
            return contradiction("checkpoints", checkpoints);
        }
        Ok((rounds, has_checkpoint))
    }

    fn skip(&mut self, bytes: u64) -> Result<()> {
        self.0.skip(bytes).map_err(unreadable)
    }

    /// Gives the next `count` records of N bytes to `apply`, many at a time.
    fn each<const N: usize>(&mut self, count: u64, mut apply: impl FnMut(&[[u8; N]]) -> Result<()>) -> Result<()> {
        let mut left = count;
        while left > 0 {
            let most = left.min((READ_AT_ONCE / N) as u64) as usize;
            let bytes = self.0.some(N, most * N).map_err(unreadable)?;
            let (records, rest) = bytes.as_chunks();
            let beyond = rest.len();
            left -= records.len() as u64;
            apply(records)?;
            self.0.give_back(beyond);
        }
        Ok(())
    }

    /// Appends the next `count` records of N bytes.
    fn append<const N: usize, T>(
        &mut self,
        all: &mut Vec<T>,
        count: u64,
        mut record: impl FnMut(&[u8; N]) -> T,
    ) -> Result<()> {
        self.each(count, |records| {
            all.extend(records.iter().map(&mut record));
            Ok(())
        })
    }
}

fn unreadable(reason: Unreadable) -> Error {
    match reason {
        Unreadable::Io(error) => cannot_read(error),
        Unreadable::Damaged => {
            Error::new(Kind::BadRequest, "the hierarchy cannot be read: it was changed or damaged: a checksum is wrong")
        }
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

#[cfg(test)]
mod tests;
