//! Files that are whole, cut short, damaged or made to do harm.

use std::cell::Cell;
use std::io::{Cursor, Read};

use super::blocks::{BLOCK, SUM};
use super::*;
use crate::device::FREE;
use crate::energy::Merged;
use crate::energy::shape_kind::Kind as ShapeKind;
use crate::hierarchy::tests::small;
use crate::hierarchy::{FaceMove, Merge};

fn file() -> Vec<u8> {
    file_of(&small())
}

fn file_of(stored: &Stored) -> Vec<u8> {
    let mut bytes = Vec::new();
    stored.write(&mut bytes).expect("a vector takes everything");
    bytes
}

/// A hierarchy of 7 of 10 items.
fn masked() -> Stored {
    let takes_part = [true, false, true, true, true, true, false, true, true, false];
    Stored { mask: Mask::new(&takes_part), ..small() }
}

fn read(bytes: &[u8], max_faces: u64) -> Result<Stored> {
    let stored = Stored::read(bytes, bytes.len() as u64, max_faces);
    // a cut sees what reading sees, but for merges and moves that it does not need
    let cut = cut(bytes, bytes.len() as u64, max_faces, 1);
    match &stored {
        Ok(stored) => {
            let of_tree = stored.labels_at(1).map(|cut| cut.labels);
            assert_eq!(cut.map(|(_, cut)| cut.labels), of_tree);
        }
        Err(error) if cut.is_ok() => assert!(error.message.contains("contradicts"), "{error}"),
        Err(_) => {}
    }
    stored
}

/// The content of a file.
fn content(file: &[u8]) -> Vec<u8> {
    file.chunks(BLOCK + SUM).flat_map(|block| &block[..block.len() - SUM]).copied().collect()
}

/// A file with the right checksums.
fn summed(content: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut out = BlockWriter::new(&mut bytes);
    out.put(content).and_then(|()| out.finish()).expect("a vector takes everything");
    bytes
}

/// A hierarchy of many rounds and moves, with checkpoints and some blocks.
fn long() -> Stored {
    let faces = 20_000;
    let (mut merges, mut moves, mut rounds) = (Vec::new(), Vec::new(), Vec::new());
    let mut lives = vec![true; faces as usize];
    let mut living: Vec<u32> = (0..faces).collect();
    while living.len() > 1 {
        for &[into, from] in living.as_chunks().0.iter().step_by(2) {
            let cost = f64::from(into) + 0.5;
            let (energy, weight) = (2.0 * cost, f64::from(from));
            let made = Merged { cost, energy, faces: 2, weight, proxy: [cost, 0.0, -1.0], shape: None };
            merges.push(Merge { into, from, made });
            lives[from as usize] = false;
        }
        living.retain(|&cluster| lives[cluster as usize]);
        // a living cluster keeps the face that it is named by
        moves.extend((1..faces).step_by(3).filter(|&face| !lives[face as usize]).map(|face| {
            let to = living[(face as usize + rounds.len()) % living.len()];
            FaceMove { face, to }
        }));
        let clusters = living.len() as u32;
        let (merges_end, moves_end) = (merges.len() as u32, moves.len() as u64);
        rounds.push(Round { clusters, energy: f64::from(faces - clusters), merges_end, moves_end });
    }
    Stored { header: small().header, mask: None, tree: Tree { faces, merges, moves, rounds } }
}

/// Counts what is read of a file.
struct Counted<'a> {
    file: Cursor<&'a [u8]>,
    read: &'a Cell<usize>,
}

impl Read for Counted<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(into)?;
        self.read.set(self.read.get() + count);
        Ok(count)
    }
}

impl Input for Counted<'_> {
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        self.file.skip(bytes)
    }
}

/// Takes what it cannot skip.
struct Stream<'a>(&'a [u8]);

impl Read for Stream<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.0.read(into)
    }
}

impl Input for Stream<'_> {}

#[test]
fn what_was_written_is_read() {
    assert_eq!(read(&file(), 7), Ok(small()));
    assert_eq!(read(&file_of(&masked()), 10), Ok(masked()));
    assert_eq!(read(&file_of(&masked()), 9).expect_err("10 items").kind, Kind::TooLarge);
}

#[test]
fn types_of_shapes_are_kept_and_checked() {
    let mut stored = small();
    stored.tree.merges[1].made.shape = Some(ShapeKind::Sphere);
    let mut file = Vec::new();
    stored.write(&mut file).expect("a vector takes everything");
    assert_eq!((file.len() as u64, read(&file, 7)), (stored.bytes(), Ok(stored)));
    let mut bytes = content(&file);
    let last = bytes.len() - 4;
    bytes[last] = 9;
    let error = read(&summed(&bytes), 7).expect_err("no such type");
    assert!(error.message.contains("merge 5"), "{error}");
}

#[test]
fn a_cut_of_the_file_is_the_cut_of_the_tree() {
    for stored in [small(), masked()] {
        let bytes = file_of(&stored);
        for clusters in 0..9 {
            let of_file = cut(bytes.as_slice(), bytes.len() as u64, 10, clusters);
            assert_eq!(of_file.map(|(_, cut)| cut), stored.labels_at(clusters), "{clusters}");
        }
    }
}

#[test]
fn masked_items_belong_to_no_cluster() {
    let Cut { labels, .. } = masked().labels_at(4).expect("a cut");
    let of_members: Vec<u32> = labels.iter().copied().filter(|&label| label != FREE).collect();
    assert_eq!(of_members, small().labels_at(4).expect("a cut").labels);
    assert_eq!([1, 6, 9].map(|item| labels[item]), [FREE; 3]);
    assert_eq!(masked().labels_at(4).expect("a cut").clusters(), 4);
}

#[test]
fn a_file_that_is_shorter_than_it_is_said_to_be_is_refused() {
    let bytes = file();
    for length in 0..bytes.len() {
        assert!(Stored::read(&bytes[..length], bytes.len() as u64, 7).is_err(), "{length} bytes");
        assert!(cut(&bytes[..length], bytes.len() as u64, 7, 3).is_err(), "{length} bytes");
    }
}

#[test]
fn a_file_that_ends_early_or_late_is_refused() {
    let bytes = file();
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length], 7).is_err(), "{length} bytes");
    }
    assert!(read(&[bytes, vec![0]].concat(), 7).is_err());
}

#[test]
fn a_flipped_bit_is_noticed_wherever_it_is() {
    let bytes = file();
    for at in 0..bytes.len() {
        for bit in 0..8 {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << bit;
            assert!(read(&flipped, 1000).is_err(), "bit {bit} of byte {at}");
        }
    }
}

#[test]
fn a_hostile_file_with_a_right_checksum_is_refused_or_harmless() {
    let (mut refused, mut harmless) = (0, 0);
    for bytes in [small(), masked()].map(|stored| content(&file_of(&stored))) {
        for (at, value) in (0..bytes.len()).flat_map(|at| [0, 1, 2, 6, 7, 0x7f, 0x80, 0xff].map(|value| (at, value))) {
            let mut changed = bytes.clone();
            changed[at] = value;
            match read(&summed(&changed), 1000) {
                Err(_) => refused += 1,
                Ok(stored) => {
                    harmless += 1;
                    for clusters in 0..9 {
                        let _ = stored.labels_at(clusters);
                    }
                    let mut out = Vec::new();
                    stored.write_json(&mut out, Default::default()).expect("a vector takes everything");
                    serde_json::from_slice::<serde_json::Value>(&out).expect("JSON");
                    let _ = stored.linkage();
                }
            }
        }
    }
    assert!(refused > 500 && harmless > 500, "{refused} refused, {harmless} read");
}

#[test]
fn more_faces_than_allowed_are_refused() {
    let error = read(&file(), 6).expect_err("too many");
    assert_eq!(error.kind, Kind::TooLarge);
}

#[test]
fn counts_beyond_the_file_allocate_nothing() {
    for (at, size) in [(12, 4), (16, 4), (20, 4), (24, 4), (32, 8), (40, 4)] {
        let mut bytes = content(&file());
        bytes[at..at + size].fill(0xff);
        let error = read(&summed(&bytes), 1000).expect_err("too much");
        assert!(error.message.contains("bytes") || error.message.contains("faces"), "{error}");
    }
}

#[test]
fn a_cut_reads_its_checkpoint_and_what_follows_it_and_no_more() {
    let stored = long();
    let mut bytes = Vec::new();
    stored.write(&mut bytes).expect("a vector takes everything");
    assert_eq!(read(&bytes, 1 << 20), Ok(stored.clone()));
    let length = bytes.len() as u64;
    let Tree { faces, rounds, .. } = &stored.tree;
    let has_checkpoint = stored.checkpoints();
    assert!(bytes.len() > 8 * BLOCK && has_checkpoint.iter().filter(|&&has| has).count() > 3);
    let most = rounds.iter().flat_map(|round| [round.clusters, round.clusters + 1]).filter(|most| most < faces);
    for clusters in most.chain([*faces]).map(u64::from) {
        let of_tree = stored.tree.labels_at(clusters);
        let count = Cell::new(0);
        let counted = Counted { file: Cursor::new(&bytes), read: &count };
        assert_eq!(cut(counted, length, 1 << 20, clusters).map(|(_, cut)| cut), of_tree, "{clusters}");
        assert_eq!(cut(Stream(&bytes), length, 1 << 20, clusters).map(|(_, cut)| cut), of_tree, "{clusters}");
        assert_eq!(cut(bytes.as_slice(), length, 1 << 20, clusters).map(|(_, cut)| cut), of_tree, "{clusters}");
        // the head, the checkpoint, the records up to the next one, the first of them of a round of merges of half the
        // faces, and the rest of the blocks at both ends
        let between = (LABEL + 2 * BETWEEN_CHECKPOINTS as usize) * *faces as usize;
        assert!(count.get() <= between + 3 * (BLOCK + SUM), "{clusters}: {} of {length}", count.get());
    }
}

#[test]
fn blocks_that_changed_places_and_checkpoints_of_another_run_are_refused() {
    let mut bytes = Vec::new();
    long().write(&mut bytes).expect("a vector takes everything");
    let mut swapped = bytes.clone();
    let (first, second) = swapped.split_at_mut(2 * (BLOCK + SUM));
    first[BLOCK + SUM..].swap_with_slice(&mut second[..BLOCK + SUM]);
    let error = Stored::read(swapped.as_slice(), swapped.len() as u64, 1 << 20).expect_err("in another order");
    assert!(error.message.contains("checksum"), "{error}");

    let mut changed = content(&bytes);
    let nodes = long().tree.merges.len() * NODE;
    let moved = changed.len() - nodes;
    // the checkpoint of the last round that has one is followed by the records of those that have none
    let last = long().checkpoints().iter().rposition(|&has| has).expect("there are some") + 1;
    let rest: u64 = (last..long().tree.rounds.len())
        .map(|round| extent(&long().tree.rounds, round))
        .map(|(merges, moves)| merges * PAIR as u64 + moves * MOVE as u64)
        .sum();
    let end = moved - rest as usize;
    changed[end - 4..end].copy_from_slice(&19_999_u32.to_le_bytes());
    let changed = summed(&changed);
    let error = Stored::read(changed.as_slice(), changed.len() as u64, 1 << 20).expect_err("a false checkpoint");
    assert!(error.message.contains("checkpoint of round"), "{error}");
    // a cut notices clusters that are not there
    let error = cut(changed.as_slice(), changed.len() as u64, 1 << 20, 1).expect_err("a cluster too many");
    assert!(error.message.contains("clusters in a checkpoint"), "{error}");

    // the same sizes, other energies
    let mut other = long();
    other.tree.rounds[0].energy += 1.0;
    let mut of_other = Vec::new();
    other.write(&mut of_other).expect("a vector takes everything");
    assert_eq!(of_other.len(), bytes.len());
    let half = (BLOCK + SUM) * 4;
    let mixed = [&bytes[..half], &of_other[half..]].concat();
    let error = Stored::read(mixed.as_slice(), mixed.len() as u64, 1 << 20).expect_err("of two files");
    assert!(error.message.contains("checksum"), "{error}");
}
