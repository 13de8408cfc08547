use std::io::Write;

use flate2::Compression;
use flate2::write::DeflateEncoder;

use super::*;
use crate::data::{Graph, read};
use crate::export::npz::npy_header;

/// A file of an archive; what its directory says of it may be wrong.
#[derive(Clone)]
struct File {
    name: String,
    method: u16,
    checksum: u32,
    declared: u32,
    data: Vec<u8>,
}

fn stored(name: &str, content: &[u8]) -> File {
    let checksum = rawzip::crc32(content);
    File { name: name.to_owned(), method: 0, checksum, declared: content.len() as u32, data: content.to_vec() }
}

fn deflated(name: &str, content: &[u8]) -> File {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(content).expect("memory");
    File { method: 8, data: encoder.finish().expect("memory"), ..stored(name, content) }
}

fn archive(files: &[File]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut directory = Vec::new();
    for file in files {
        let mut about = [20u16, 0, file.method, 0, 0].iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        about.extend([file.checksum, file.data.len() as u32, file.declared].iter().flat_map(|x| x.to_le_bytes()));
        about.extend([file.name.len() as u16, 0].iter().flat_map(|x| x.to_le_bytes()));
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&about);
        directory.extend([0; 10]);
        directory.extend((bytes.len() as u32).to_le_bytes());
        directory.extend(file.name.as_bytes());
        bytes.extend(b"PK\x03\x04");
        bytes.extend(about);
        bytes.extend(file.name.as_bytes());
        bytes.extend(&file.data);
    }
    let count = files.len() as u16;
    let start = bytes.len() as u32;
    bytes.extend(&directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend([count, count].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([directory.len() as u32, start].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0, 0]);
    bytes
}

fn array<const N: usize>(kind: &str, shape: &str, elements: &[[u8; N]]) -> Vec<u8> {
    [npy_header(kind, shape), elements.concat()].concat()
}

fn counts(numbers: &[i32]) -> Vec<u8> {
    let bytes: Vec<_> = numbers.iter().map(|x| x.to_le_bytes()).collect();
    array("<i4", &format!("({},)", numbers.len()), &bytes)
}

/// Three points in a line.
fn points() -> Vec<u8> {
    array("<f4", "(3, 1)", &[0.0f32, 1.0, 2.0].map(f32::to_le_bytes))
}

/// The files of a matrix, rows 0: 1, 1: 1 2, 2: none, of which the entry 1, 1 is 0.
fn matrix(format: &[u8], shape: &[i32], data: &[u8]) -> Vec<File> {
    vec![
        deflated("indices.npy", &counts(&[1, 1, 2])),
        deflated("indptr.npy", &counts(&[0, 1, 3, 3])),
        deflated("format.npy", &array("|S3", "()", &[format.try_into().unwrap_or(*b"???")])),
        deflated("shape.npy", &counts(shape)),
        deflated("data.npy", data),
    ]
}

#[test]
fn arrays_are_found_by_name_stored_or_deflated() {
    let weights = array("<f8", "(3,)", &[1.0f64, 2.0, 4.0].map(f64::to_le_bytes));
    let mask = array("|b1", "(3,)", &[[1], [0], [1]]);
    for file in [stored, deflated] {
        let bytes = archive(&[
            file("XX.npy", b"another"),
            file("X.npy", &points()),
            file("weights.npy", &weights),
            file("mask.npy", &mask),
            file("indptr.npy", &counts(&[0, 1, 2, 2])),
            file("indices.npy", &counts(&[1, 2])),
        ]);
        let set = read(&bytes, None, 1 << 20).expect("points");
        assert_eq!((set.dimensions, set.items(), set.at(2, 0)), (1, 3, 2.0));
        assert_eq!(set.weights.as_deref(), Some(&[1.0, 2.0, 4.0][..]));
        assert_eq!(set.mask.as_deref(), Some(&[true, false, true][..]));
        let rows = Csr::new([0, 1, 2, 2].into_iter(), [1, 2].into_iter()).expect("rows");
        assert_eq!(set.graph, Graph::Rows(rows));
        let error = read(&bytes, Some(Graph::Knn(2)), 1 << 20).expect_err("two graphs");
        assert!(error.message.contains("twice"), "{error}");
    }
}

#[test]
fn edges_of_a_sparse_matrix_are_its_entries_other_than_0_in_rows_or_columns() {
    let data = array("<f8", "(3,)", &[-1.0, 0.0, f64::MIN_POSITIVE].map(f64::to_le_bytes));
    let expected = Csr::new([0, 1, 2, 2].into_iter(), [1, 2].into_iter());
    for format in [b"csr", b"csc"] {
        assert_eq!(graph(&archive(&matrix(format, &[3, 3], &data)), 1 << 20), expected);
    }
    let flags = array("|b1", "(3,)", &[[1], [0], [1]]);
    assert_eq!(graph(&archive(&matrix(b"csr", &[3, 3], &flags)), 1 << 20), expected);
    for (bytes, words) in [
        (archive(&matrix(b"coo", &[3, 3], &data)), "graph.tocsr(); its format is \"coo\""),
        (archive(&matrix(b"csr", &[3, 4], &data)), "must be square, and indptr has 3 rows; its shape is [3, 4]"),
        (archive(&matrix(b"csr", &[3], &data)), "must be square"),
        (archive(&matrix(b"csr", &[3, 3], &flags[..flags.len() - 1])), "should hold 3 numbers"),
        (archive(&matrix(b"csr", &[3, 3], &array("|b1", "(2,)", &[[1], [0]]))), "as many entries as indices, 3, not 2"),
        (archive(&matrix(b"csr", &[3, 3], &array("<c8", "(3,)", &[[1; 8]; 3]))), "must hold numbers"),
        (archive(&matrix(b"csr", &[3, 3], &data)[1..]), "must have an entry indices.npy"),
        (archive(&matrix(b"csr", &[3, 3], &data)[..2]), "must have an entry format.npy"),
    ] {
        let error = graph(&bytes, 1 << 20).expect_err(words);
        assert!(error.message.contains(words) && !error.message.contains('\n'), "{error}");
    }
}

#[test]
fn rows_that_contradict_themselves_are_refused_with_their_place() {
    for (indptr, indices, words) in [
        (&[][..], &[][..], "one entry more than there are items: 0"),
        (&[1, 2], &[0, 0], "entry 0, after 0, is 1"),
        (&[0, 2, 1, 2], &[0, 0], "entry 2, after 2, is 1"),
        (&[0, 3], &[0, 0], "entry 1, after 0, is 3"),
        (&[0, i64::MAX], &[0, 0], "is 9223372036854775807"),
        (&[0, -1], &[0, 0], "is -1"),
        (&[0, 1], &[0, 0], "must end with the number of indices, 2: 1"),
        (&[0, 1, 1, 2], &[0, 3], "from 0 to 2, one less than the number of rows; entry 1, in row 2, is 3"),
        (&[0, 1, 1, 2], &[0, -3], "entry 1, in row 2, is -3"),
        (&[0, 1, 1, 2], &[1 << 32, 0], "entry 0, in row 0, is 4294967296"),
    ] {
        let error = Csr::new(indptr.iter().copied(), indices.iter().copied()).expect_err(words);
        assert!(error.message.contains(words), "{error}");
    }
}

#[test]
fn archives_are_inflated_to_no_more_than_they_declare_and_the_limit_allows() {
    let x = points();
    let fits = archive(&[deflated("X.npy", &x), deflated("other.npy", &[0; 100_000])]);
    assert!(read(&fits, None, x.len() as u64).is_ok(), "what is not needed does not count");
    let error = read(&fits, None, x.len() as u64 - 1).expect_err("one byte too many");
    assert_eq!(error.kind, crate::Kind::TooLarge, "{error}");

    // a thousandth of the bytes that it inflates to
    let bomb = deflated("X.npy", &vec![0; 64 << 20]);
    let modest = File { declared: 200, ..bomb.clone() };
    let damaged = File { checksum: 1, ..deflated("X.npy", &x) };
    let short = File { declared: x.len() as u32 + 1, ..stored("X.npy", &x) };
    let cut = File { data: deflated("X.npy", &x).data[..9].to_vec(), ..deflated("X.npy", &x) };
    let other_method = File { method: 12, ..stored("X.npy", &x) };
    let whole = archive(&[stored("X.npy", &x)]);
    let mut moved = whole.clone();
    let at = whole.len() - 6;
    moved[at..at + 4].copy_from_slice(&[255; 4]);
    for (bytes, words) in [
        (archive(&[bomb]), "would pass that with 67108864"),
        (archive(&[modest]), "X.npy of the .npz file is damaged"),
        (archive(&[damaged]), "X.npy of the .npz file is damaged"),
        (archive(&[short]), "X.npy of the .npz file is damaged"),
        (archive(&[cut]), "X.npy of the .npz file is damaged"),
        (archive(&[other_method]), "must be stored or deflated"),
        (archive(&[stored("x.npy", &x)]), "must have an entry X.npy; it has \"x.npy\""),
        (archive(&[stored("X.npy", &x), stored("indptr.npy", &counts(&[0]))]), "another: indices"),
        (archive(&[stored("X.npy", &x), stored("mask.npy", &counts(&[1, 1, 1]))]), "True and False"),
        (archive(&[stored("X.npy", &x), stored("mask.npy", &array("|b1", "(2,)", &[[1], [1]]))]), "the mask must"),
        (whole[..whole.len() - 30].to_vec(), "no .npz archive"),
        (moved, ".npz"),
    ] {
        let error = read(&bytes, None, 1 << 20).expect_err(words);
        assert!(error.message.contains(words) && !error.message.contains('\n'), "{error}");
    }
}
