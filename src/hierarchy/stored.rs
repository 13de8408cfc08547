//! The file that a hierarchy is kept in, `.tsr`.
//!
//! All numbers are little-endian, floats are IEEE 754 binary64. The content, sizes in bytes:
//!
//! | at | size | |
//! |---|---|---|
//! | 0 | 8 | `89 54 53 52 0D 0A 1A 0A`: no text; a change of line ends changes it |
//! | 8 | 4 | version of the format: 3 |
//! | 12 | 4 | H, the length of the header |
//! | 16 | 4 | F, the number of faces, 1 … 2³¹ |
//! | 20 | 4 | M, the number of merges, less than F |
//! | 24 | 4 | R, the number of rounds |
//! | 28 | 4 | C, the number of checkpoints |
//! | 32 | 8 | V, the number of moves |
//! | 40 | 4 | N, the number of items that were uploaded: F, and those that a mask leaves out |
//! | 44 | H | header: a JSON object in UTF-8, see [`Header`] |
//! | | ⌈N/8⌉ | if N > F: whether each item takes part, the first one in the lowest bit of the first byte |
//! | | 32·R | rounds: clusters left u32, end of merges u32, end of moves u64, energy f64, has a checkpoint u32, 0 u32 |
//! | | 16·M + 8·V + 4·F·C | records of each round, see below |
//! | | 48·M | what each merge made: faces u32, energy f64, weight f64, proxy 3 × f64, type of its shape or 0, u32 |
//!
//! The records of a round are its merges (into u32, from u32, cost f64), its moves (face u32, its new cluster u32) and,
//! if it has one, its checkpoint: for each face the living cluster that it is in, u32. [`Round`], [`super::Merge`] and
//! [`super::FaceMove`] define the numbers. The file is this content in blocks, each with a checksum ([`blocks`]).
//!
//! # Why checkpoints
//!
//! A cut starts at the last checkpoint before it and reads only what lies between: however long the run was, that is
//! one label a face and records of fewer than [`BETWEEN_CHECKPOINTS`] bytes a face and of one round more. It also reads
//! the list of rounds, which is short for parallel hierarchies, and has 32 bytes a face for those that merge one pair a
//! round. Blocks before and after are not read.

use std::io::{self, Write};

use self::blocks::{BlockReader, BlockWriter};
use self::errors::{cannot_read, malformed, unreadable};
use self::records::{FIXED, LABEL, MOVE, NODE, PAIR, Pair, ROUND, Sizes, VERSION, u32_at};
use super::replay::{CutPlan, Replay, check_range};
use super::{Cut, Round, Tree, contradiction};
use crate::error::{Error, Kind, Result};

pub use self::blocks::Input;
pub use self::header::Header;
pub use self::mask::Mask;

mod blocks;
mod errors;
mod header;
mod mask;
mod records;

/// The first bytes of the file.
pub const MAGIC: [u8; 8] = *b"\x89TSR\r\n\x1a\n";

/// Longest header that is read, in bytes.
const MAX_HEADER: usize = 1 << 20;

/// Bytes of records that are read at once.
const READ_AT_ONCE: usize = 1 << 20;

/// A round has a checkpoint when the records since the last one have as many bytes for each face. So checkpoints are no
/// more than a third of all records.
const BETWEEN_CHECKPOINTS: u64 = 8;

/// A hierarchy and where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Stored {
    /// Where it comes from.
    pub header: Header,
    /// Which of the uploaded items take part, if a mask leaves some out. The tree is of those that do.
    pub mask: Option<Mask>,
    /// The hierarchy.
    pub tree: Tree,
}

impl Stored {
    /// The shape of what was clustered, of points.
    pub fn shape(&self) -> Option<Vec<usize>> {
        let items = self.mask.as_ref().map_or(self.tree.faces, Mask::items);
        self.header.shape_of(items as usize)
    }

    /// Writes the file, a piece at a time. The checkpoints take 8 bytes a face, in addition to the tree.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let Tree { faces, merges, rounds, .. } = &self.tree;
        let header = serde_json::to_vec(&self.header)?;
        let has_checkpoint = self.checkpoints();
        let mut out = BlockWriter::new(out);
        out.put(&self.sizes(header.len(), &has_checkpoint).bytes())?;
        out.put(&header)?;
        if let Some(mask) = &self.mask {
            out.put(&mask.bytes())?;
        }
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
        let header = serde_json::to_vec(&self.header).map_or(MAX_HEADER, |header| header.len());
        u64::try_from(self.sizes(header, &self.checkpoints()).file_bytes()).unwrap_or(u64::MAX)
    }

    fn sizes(&self, header: usize, has_checkpoint: &[bool]) -> Sizes {
        Sizes {
            header: header as u32,
            faces: self.tree.faces,
            items: self.mask.as_ref().map_or(self.tree.faces, Mask::items),
            merges: self.tree.merges.len() as u32,
            rounds: self.tree.rounds.len() as u32,
            checkpoints: count(has_checkpoint),
            moves: self.tree.moves.len() as u64,
        }
    }

    /// Which rounds have checkpoints.
    fn checkpoints(&self) -> Vec<bool> {
        let mut since = 0;
        let has_checkpoint = |round| {
            since += records_bytes(&self.tree.rounds, round);
            let is_far = since >= BETWEEN_CHECKPOINTS * u64::from(self.tree.faces);
            if is_far {
                since = 0;
            }
            is_far
        };
        (0..self.tree.rounds.len()).map(has_checkpoint).collect()
    }

    /// The labels at exactly `clusters` clusters ([`Tree::labels_at`]), one an uploaded item.
    pub fn labels_at(&self, clusters: u64) -> Result<Cut> {
        Ok(mask::applied(self.mask.as_ref(), self.tree.labels_at(clusters)?))
    }

    /// Reads a file of `length` bytes. Every size is checked against that before anything is allocated, and the tree is
    /// checked before it is returned. The number of faces, which a short file can state too, is checked against
    /// `max_faces`.
    pub fn read(from: impl Input, length: u64, max_faces: u64) -> Result<Self> {
        let (mut reader, header) = Reader::open(from, length, max_faces)?;
        let Sizes { faces, merges, moves, .. } = reader.sizes;
        let (merges, rounds) = (u64::from(merges), std::mem::take(&mut reader.rounds));
        let mask = reader.mask.take();
        let mut tree = Tree { faces, merges: room(merges)?, moves: room(moves)?, rounds };
        let mut replay = Replay::new(faces);
        for round in 0..tree.rounds.len() {
            let (merges, moves) = extent(&tree.rounds, round);
            reader.append(&mut tree.merges, merges, |record| Pair::of(record).merge())?;
            reader.append(&mut tree.moves, moves, records::move_of)?;
            tree.replay(round, &mut replay)?;
            if reader.has_checkpoint[round] {
                let mut expected = replay.clusters().iter();
                reader.each::<LABEL>(faces.into(), |labels| {
                    match labels.iter().all(|label| Some(&u32::from_le_bytes(*label)) == expected.next()) {
                        true => Ok(()),
                        false => contradiction("checkpoint of round", round + 1),
                    }
                })?;
            }
        }
        let mut incomplete = tree.merges.iter_mut().enumerate();
        reader.each::<NODE>(merges, |nodes| {
            for (node, (at, merge)) in nodes.iter().zip(&mut incomplete) {
                if !records::complete(merge, node, faces) {
                    return contradiction("merge", at);
                }
            }
            Ok(())
        })?;
        Ok(Self { header, mask, tree })
    }
}

/// A cut of a hierarchy in a file, without the tree ever being in memory; see [`Stored::labels_at`], [`Stored::read`].
/// Only what the cut needs is read and compared with its checksums. Whether a checkpoint is what the merges and moves
/// before it make, only [`Stored::read`] checks.
pub fn cut(from: impl Input, length: u64, max_faces: u64, clusters: u64) -> Result<(Header, Cut)> {
    let (mut reader, header) = Reader::open(from, length, max_faces)?;
    let (faces, rounds) = (reader.sizes.faces, std::mem::take(&mut reader.rounds));
    check_range(faces, rounds.last().map_or(faces, |round| round.clusters), clusters)?;
    let plan = CutPlan::of(&rounds, faces, clusters as u32);
    let (start, mut replay) = match reader.has_checkpoint[..plan.rounds].iter().rposition(|&has| has) {
        None => (0, Replay::new(faces)),
        Some(last) => {
            let labels = u64::from(count(&reader.has_checkpoint[..last])) * u64::from(faces) * LABEL as u64;
            let records: u64 = (0..=last).map(|round| records_bytes(&rounds, round)).sum();
            reader.skip(records + labels)?;
            let mut clusters = room(faces.into())?;
            reader.append::<LABEL, _>(&mut clusters, faces.into(), |label| u32::from_le_bytes(*label))?;
            (last + 1, Replay::starting_from(clusters, &rounds[last])?)
        }
    };
    for round in start..plan.rounds {
        let (merges, moves) = extent(&rounds, round);
        reader.merges(merges, |pair| replay.merge(pair.into, pair.from))?;
        reader.each::<MOVE>(moves, |moves| moves.iter().try_for_each(|moved| replay.give(records::move_of(moved))))?;
    }
    let mut energy = plan.energy;
    reader.merges(plan.extra_merges as u64, |pair| {
        energy += pair.cost;
        replay.merge(pair.into, pair.from)
    })?;
    Ok((header, mask::applied(reader.mask.as_ref(), plan.finish(replay, energy)?)))
}

/// Merges and moves of a round.
fn extent(rounds: &[Round], round: usize) -> (u64, u64) {
    let (before, after) = (Round::before(rounds, round), rounds[round]);
    (u64::from(after.merges_end - before.merges_end), after.moves_end - before.moves_end)
}

/// Bytes of the merges and moves of a round.
fn records_bytes(rounds: &[Round], round: usize) -> u64 {
    let (merges, moves) = extent(rounds, round);
    merges * PAIR as u64 + moves * MOVE as u64
}

/// How many are true.
fn count(all: &[bool]) -> u32 {
    all.iter().map(|&one| u32::from(one)).sum()
}

/// An empty list with room for a number of records.
fn room<T>(records: u64) -> Result<Vec<T>> {
    let too_much =
        |_| Error::new(Kind::TooLarge, format_args!("the hierarchy does not fit into memory: {records} records"));
    let mut all = Vec::new();
    all.try_reserve_exact(usize::try_from(records).unwrap_or(usize::MAX)).map_err(too_much)?;
    Ok(all)
}

/// Reads the parts of a file, in their order.
struct Reader<R> {
    blocks: BlockReader<R>,
    sizes: Sizes,
    mask: Option<Mask>,
    rounds: Vec<Round>,
    has_checkpoint: Vec<bool>,
}

impl<R: Input> Reader<R> {
    /// Reads and checks all that comes before the records of the rounds.
    fn open(from: R, length: u64, max_faces: u64) -> Result<(Self, Header)> {
        let mut blocks = BlockReader::new(from, length);
        // the kind of file is checked before whether it is whole, for the sake of the message
        let first = blocks.peek::<FIXED>().map_err(cannot_read)?;
        if !first.starts_with(&MAGIC) {
            return malformed("it is no hierarchy file (.tsr)");
        }
        let Some(first) = first.first_chunk() else { return malformed("it ends early") };
        let version = u32_at(first, 8);
        if version != VERSION {
            return malformed(format_args!(
                "only version {VERSION} of the format is read, make the hierarchy again: it has version {version}"
            ));
        }
        let sizes = Sizes::of(first);
        let expected = sizes.file_bytes();
        if u128::from(length) != expected {
            return malformed(format_args!("it should have {expected} bytes, but has {length}"));
        }
        if sizes.header as usize > MAX_HEADER {
            return malformed("its first bytes are not those of a hierarchy");
        }
        if u64::from(sizes.faces.max(sizes.items)) > max_faces {
            return Err(Error::too_large(format_args!(
                "the hierarchy has more faces than the limit of {max_faces}: {}",
                sizes.faces.max(sizes.items)
            )));
        }
        let mut reader = Self { blocks, sizes, mask: None, rounds: Vec::new(), has_checkpoint: Vec::new() };
        reader.skip(FIXED as u64)?;
        let json = reader.blocks.some(sizes.header as usize, sizes.header as usize).map_err(unreadable)?;
        let header = serde_json::from_slice(json).or_else(malformed)?;
        reader.read_mask()?;
        reader.read_rounds()?;
        Ok((reader, header))
    }

    /// Reads the mask, if there is one, and checks that as many items take part as the hierarchy has.
    fn read_mask(&mut self) -> Result<()> {
        let Sizes { faces, items, .. } = self.sizes;
        if items < faces {
            return contradiction("number of items", items);
        }
        if items > faces {
            let mut bytes = room(self.sizes.mask_bytes())?;
            self.append::<1, _>(&mut bytes, self.sizes.mask_bytes(), |&[byte]| byte)?;
            self.mask = Mask::of(&bytes, items).filter(|mask| mask.members() == u64::from(faces));
            if self.mask.is_none() {
                return contradiction("mask of items", items);
            }
        }
        Ok(())
    }

    /// Reads the rounds, and checks that they cover all merges and moves, each some merges, and leave the clusters that
    /// they should.
    fn read_rounds(&mut self) -> Result<()> {
        let Sizes { faces, merges, rounds, checkpoints, moves, .. } = self.sizes;
        if faces == 0 || faces > 1 << 31 {
            return contradiction("number of faces", faces);
        }
        if merges >= faces {
            return contradiction("number of merges", merges);
        }
        let (mut read, mut has_checkpoint) = (room(rounds.into())?, room(rounds.into())?);
        let mut before = Round::default();
        self.each::<ROUND>(rounds.into(), |records| {
            for record in records {
                let is_later = |round: &Round| {
                    (before.merges_end + 1..=merges).contains(&round.merges_end)
                        && (before.moves_end..=moves).contains(&round.moves_end)
                        && round.clusters == faces - round.merges_end
                };
                let Some((round, has)) = records::round_of(record).filter(|(round, _)| is_later(round)) else {
                    return contradiction("round", read.len() + 1);
                };
                before = round;
                read.push(round);
                has_checkpoint.push(has);
            }
            Ok(())
        })?;
        if (before.merges_end, before.moves_end) != (merges, moves) {
            return contradiction("rounds end before merges or moves do, round", rounds);
        }
        if count(&has_checkpoint) != checkpoints {
            return contradiction("checkpoints", count(&has_checkpoint));
        }
        (self.rounds, self.has_checkpoint) = (read, has_checkpoint);
        Ok(())
    }

    /// Calls `apply` with each of the next `count` merges.
    fn merges(&mut self, count: u64, mut apply: impl FnMut(Pair) -> Result<()>) -> Result<()> {
        self.each::<PAIR>(count, |pairs| pairs.iter().map(Pair::of).try_for_each(&mut apply))
    }

    fn skip(&mut self, bytes: u64) -> Result<()> {
        self.blocks.skip(bytes).map_err(unreadable)
    }

    /// Calls `apply` with the next `count` records of N bytes, many at a time.
    fn each<const N: usize>(&mut self, count: u64, mut apply: impl FnMut(&[[u8; N]]) -> Result<()>) -> Result<()> {
        let mut left = count;
        while left > 0 {
            let most = left.min((READ_AT_ONCE / N) as u64) as usize;
            let bytes = self.blocks.some(N, most * N).map_err(unreadable)?;
            let (records, rest) = bytes.as_chunks();
            let beyond = rest.len();
            left -= records.len() as u64;
            apply(records)?;
            self.blocks.give_back(beyond);
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

#[cfg(test)]
mod tests;
