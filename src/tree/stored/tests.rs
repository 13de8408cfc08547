//! Files that are whole, cut short, damaged or made to do harm.

use super::*;
use crate::tree::tests::small;

fn file() -> Vec<u8> {
    let mut bytes = Vec::new();
    small().write(&mut bytes).expect("a vector takes everything");
    bytes
}

fn read(bytes: &[u8], max_faces: u64) -> Result<Stored> {
    let stored = Stored::read(bytes, bytes.len() as u64, max_faces);
    // a cut sees what reading sees, but for merges and moves that it does not need
    let cut = cut(bytes, bytes.len() as u64, max_faces, 1);
    match &stored {
        Ok(stored) => {
            let of_tree = stored.tree.labels_at(1).map(|cut| cut.labels);
            assert_eq!(cut.map(|(_, cut)| cut.labels), of_tree);
        }
        Err(error) if cut.is_ok() => assert!(error.message.contains("contradicts"), "{error}"),
        Err(_) => {}
    }
    stored
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
    assert_eq!(read(&file(), 7), Ok(small()));
}

#[test]
fn a_cut_of_the_file_is_the_cut_of_the_tree() {
    let bytes = file();
    for clusters in 0..9 {
        let of_file = cut(bytes.as_slice(), bytes.len() as u64, 7, clusters);
        assert_eq!(of_file.map(|(_, cut)| cut), small().tree.labels_at(clusters), "{clusters}");
    }
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
    let bytes = file();
    let (mut refused, mut harmless) = (0, 0);
    for at in 0..bytes.len() - SUM {
        for value in [0, 1, 2, 6, 7, 0x7f, 0x80, 0xff] {
            let mut changed = bytes.clone();
            changed[at] = value;
            match read(&summed(changed), 1000) {
                Err(_) => refused += 1,
                Ok(stored) => {
                    harmless += 1;
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
    assert!(refused > 500 && harmless > 500, "{refused} refused, {harmless} read");
}

#[test]
fn more_faces_than_allowed_are_refused() {
    let error = read(&file(), 6).expect_err("too many");
    assert_eq!(error.kind, Kind::TooLarge);
}

#[test]
fn counts_beyond_the_file_allocate_nothing() {
    for (at, size) in [(12, 4), (16, 4), (20, 4), (24, 4), (32, 8)] {
        let mut bytes = file();
        bytes[at..at + size].fill(0xff);
        let error = read(&summed(bytes), 1000).expect_err("too much");
        assert!(error.message.contains("bytes") || error.message.contains("faces"), "{error}");
    }
}
