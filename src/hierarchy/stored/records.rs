//! The records of the file and their bytes.

use super::super::{FaceMove, Merge, Round};
use super::MAGIC;
use super::blocks::framed;
use crate::energy::Merged;
use crate::energy::shape_kind::Kind as ShapeKind;

pub(super) const VERSION: u32 = 3;
pub(super) const FIXED: usize = 44;
pub(super) const ROUND: usize = 32;
pub(super) const PAIR: usize = 16;
pub(super) const MOVE: usize = 8;
pub(super) const LABEL: usize = 4;
pub(super) const NODE: usize = 48;

/// A number at an offset within a record, whose length the caller knows.
pub(super) fn u32_at(record: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
}

pub(super) fn u64_at(record: &[u8], at: usize) -> u64 {
    u64::from(u32_at(record, at)) | u64::from(u32_at(record, at + 4)) << 32
}

fn f64_at(record: &[u8], at: usize) -> f64 {
    f64::from_bits(u64_at(record, at))
}

/// Puts parts of a record one after the other.
fn record<const N: usize>(parts: &[&[u8]]) -> [u8; N] {
    let mut bytes = [0; N];
    let mut rest = bytes.as_mut_slice();
    for part in parts {
        let (place, after) = rest.split_at_mut(part.len());
        place.copy_from_slice(part);
        rest = after;
    }
    bytes
}

/// What the first bytes say: the length of the header, and how many records of each kind there are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    pub header: u32,
    pub faces: u32,
    /// Faces and what a mask leaves out.
    pub items: u32,
    pub merges: u32,
    pub rounds: u32,
    pub checkpoints: u32,
    pub moves: u64,
}

impl Sizes {
    pub fn bytes(&self) -> [u8; FIXED] {
        let Self { header, faces, items, merges, rounds, checkpoints, moves } = *self;
        let numbers = [VERSION, header, faces, merges, rounds, checkpoints].map(u32::to_le_bytes);
        record(&[&MAGIC, numbers.as_flattened(), &moves.to_le_bytes(), &items.to_le_bytes()])
    }

    pub fn of(first: &[u8; FIXED]) -> Self {
        let [header, faces, merges, rounds, checkpoints, items] = [12, 16, 20, 24, 28, 40].map(|at| u32_at(first, at));
        Self { header, faces, items, merges, rounds, checkpoints, moves: u64_at(first, 32) }
    }

    /// Length of the mask in bytes.
    pub fn mask_bytes(&self) -> u64 {
        if self.items > self.faces { u64::from(self.items).div_ceil(8) } else { 0 }
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u128 {
        let Self { header, faces, merges, rounds, checkpoints, moves, .. } = *self;
        let of = |count: u64, size: usize| u128::from(count) * size as u128;
        let records = of(rounds.into(), ROUND) + of(merges.into(), PAIR + NODE) + of(moves, MOVE);
        let head = FIXED as u128 + u128::from(header) + u128::from(self.mask_bytes());
        framed(head + records + u128::from(checkpoints) * of(faces.into(), LABEL))
    }
}

/// A round, and whether it has a checkpoint.
pub(super) fn round_bytes(round: &Round, has_checkpoint: bool) -> [u8; ROUND] {
    let Round { clusters, merges_end, moves_end, energy } = round;
    record(&[
        &clusters.to_le_bytes(),
        &merges_end.to_le_bytes(),
        &moves_end.to_le_bytes(),
        &energy.to_le_bytes(),
        &u32::from(has_checkpoint).to_le_bytes(),
    ])
}

/// What [`round_bytes`] made; nothing for bytes that it does not make.
pub(super) fn round_of(record: &[u8; ROUND]) -> Option<(Round, bool)> {
    let round = Round {
        clusters: u32_at(record, 0),
        merges_end: u32_at(record, 4),
        moves_end: u64_at(record, 8),
        energy: f64_at(record, 16),
    };
    match (u32_at(record, 24), u32_at(record, 28)) {
        (has_checkpoint @ 0..=1, 0) => Some((round, has_checkpoint == 1)),
        _ => None,
    }
}

/// The part of a merge that cuts need.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub into: u32,
    pub from: u32,
    pub cost: f64,
}

impl Pair {
    pub fn bytes(merge: &Merge) -> [u8; PAIR] {
        record(&[&merge.into.to_le_bytes(), &merge.from.to_le_bytes(), &merge.made.cost.to_le_bytes()])
    }

    pub fn of(record: &[u8; PAIR]) -> Self {
        Self { into: u32_at(record, 0), from: u32_at(record, 4), cost: f64_at(record, 8) }
    }

    /// The merge, its node still to be read.
    pub fn merge(self) -> Merge {
        let Self { into, from, cost } = self;
        Merge { into, from, made: Merged { cost, ..Merged::default() } }
    }
}

pub(super) fn move_bytes(moved: &FaceMove) -> [u8; MOVE] {
    record(&[&moved.face.to_le_bytes(), &moved.to.to_le_bytes()])
}

pub(super) fn move_of(record: &[u8; MOVE]) -> FaceMove {
    FaceMove { face: u32_at(record, 0), to: u32_at(record, 4) }
}

/// The part of a merge that describes what it made.
pub(super) fn node_bytes(Merge { made, .. }: &Merge) -> [u8; NODE] {
    let numbers = [made.energy, made.weight, made.proxy[0], made.proxy[1], made.proxy[2]].map(f64::to_le_bytes);
    let place = made.shape.and_then(|kind| ShapeKind::ALL.iter().position(|&other| other == kind));
    let shape = place.map_or(0, |place| place as u32 + 1);
    record(&[&made.faces.to_le_bytes(), numbers.as_flattened(), &shape.to_le_bytes()])
}

/// Completes a merge of a tree of so many faces; false for bytes that [`node_bytes`] does not make.
pub(super) fn complete(Merge { made, .. }: &mut Merge, record: &[u8; NODE], tree_faces: u32) -> bool {
    let [energy, weight, proxy @ ..] = [4, 12, 20, 28, 36].map(|at| f64_at(record, at));
    let (faces, shape_number) = (u32_at(record, 0), u32_at(record, 44));
    let shape = shape_number.checked_sub(1).and_then(|place| ShapeKind::ALL.get(place as usize).copied());
    *made = Merged { cost: made.cost, energy, faces, weight, proxy, shape };
    (2..=tree_faces).contains(&faces) && shape.is_some() == (shape_number > 0)
}
