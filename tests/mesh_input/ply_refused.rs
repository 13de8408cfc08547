//! PLY: files that are refused, with what is wrong and where.

use std::time::{Duration, Instant};

use tesserae_mesh::Kind;

use crate::make::SQUARE;
use crate::ply_make::{self as make, ENCODINGS, Encoding, ply, properties, square, write};

/// A text with these lines for the properties of vertices and faces, and these rows.
fn text(header: &str, rows: &str) -> String {
    format!("ply\nformat ascii 1.0\n{header}end_header\n{rows}")
}

const HEADER: &str = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
                      property list uchar int vertex_indices\n";

#[track_caller]
fn message(bytes: impl AsRef<[u8]>) -> String {
    let start = Instant::now();
    let error = ply(bytes).expect_err("refused");
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
    assert!(matches!(error.kind, Kind::InvalidMesh | Kind::TooLarge), "{error:?}");
    error.message
}

#[track_caller]
fn expect(bytes: impl AsRef<[u8]>, words: &[&str]) {
    let message = message(bytes);
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
}

/// The bytes with `to` in place of the first `from`.
fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).expect("what is replaced");
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

#[test]
fn headers_are_refused_by_line() {
    for (header, words) in [
        ("format ascii 1.0\n", ["line 3 ", "twice"]),
        ("element vertex\n", ["line 3 ", "element vertex"]),
        ("element vertex -1\n", ["line 3 ", "-1"]),
        ("element vertex 1e3\n", ["line 3 ", "1e3"]),
        ("element vertex 99999999999999999999\n", ["line 3 ", "99999999999999999999"]),
        ("element vertex 3 4\n", ["line 3 ", "element vertex 3 4"]),
        ("property float x\n", ["line 3 ", "before the first element"]),
        ("element vertex 3\nproperty half x\n", ["line 4 ", "half"]),
        ("element vertex 3\nproperty float\n", ["line 4 ", "property TYPE NAME"]),
        ("element face 3\nproperty list uchar int\n", ["line 4 ", "property list TYPE"]),
        ("element face 3\nproperty list list uchar int vertex_indices\n", ["line 4 ", "property list TYPE TYPE NAME"]),
        ("element face 3\nproperty list uchar list uchar int a\n", ["line 4 ", "property list TYPE TYPE NAME"]),
        ("element face 3\nproperty list float int vertex_indices\n", ["line 4 ", "vertex_indices"]),
        ("element face 3\nproperty list uchar long vertex_indices\n", ["line 4 ", "long"]),
        ("elements vertex 3\n", ["line 3 ", "elements"]),
    ] {
        expect(text(header, ""), &words);
    }
    expect("ply\nelement vertex 3\nend_header\n", &["no format line"]);
    expect("ply\nformat ascii 2.0\n", &["line 2 ", "\"2.0\""]);
    expect("ply\nformat binary 1.0\n", &["line 2 ", "\"binary\""]);
    expect("ply\nformat ascii 1.0\n", &["end_header"]);
    expect(format!("ply\nformat ascii 1.0\ncomment {}", "x".repeat(2 << 20)), &["end_header", "1048576"]);
    expect(format!("ply\nformat ascii 1.0\n{}", "comment\n".repeat(1 << 18)), &["end_header", "1048576"]);
}

#[test]
fn elements_without_what_is_read_are_refused() {
    for (header, words) in [
        (HEADER.replace("float y", "float v"), ["vertex", "\"y\""]),
        (HEADER.replace("float y", "float x"), ["twice", "\"x\""]),
        (HEADER.replace("float y", "list uchar float y"), ["no list", "\"y\""]),
        (HEADER.replace("vertex_indices", "corners"), ["\"face\"", "\"vertex_indices\" or \"vertex_index\""]),
        (HEADER.replace("uchar int", "uchar float"), ["vertex_indices", "no list of integers"]),
        (HEADER.replace("list uchar int", "int"), ["vertex_indices", "no list of integers"]),
        (HEADER.replace("vertex 2", "vertex 0"), ["no vertices", "1"]),
        (HEADER.replace("vertex 2", "point 2"), ["no vertices", "1"]),
        (HEADER.repeat(2), ["twice", "\"vertex\""]),
    ] {
        for encoding in ["ascii", "binary_little_endian"] {
            let rows = if encoding == "ascii" { "0 0 0\n".repeat(9) } else { "\0".repeat(200) };
            expect(text(&header, &rows).replace("ascii", encoding), &words);
        }
    }
}

#[test]
fn headers_have_at_most_64_elements_and_256_properties() {
    for (line, room, value, limit) in [("element e 0\n", 62, "", "64"), ("property int a\n", 252, " 0", "256")] {
        let with = |lines: usize| {
            let rows = format!("0 0 0\n0 0 0\n3 0 1 1{}\n", value.repeat(lines));
            text(&format!("{HEADER}{}", line.repeat(lines)), &rows)
        };
        assert_eq!(ply(with(room)).expect("a mesh").faces.len(), 1);
        for more in [room + 1, 60_000] {
            expect(with(more), &[&format!("line {} ", 9 + room), &format!("limit of {limit}")]);
        }
    }
}

#[test]
fn point_clouds_are_refused_as_such() {
    for encoding in ENCODINGS {
        for elements in [vec![make::vertices(&SQUARE)], vec![make::vertices(&SQUARE), make::faces(&[])]] {
            expect(write(encoding, &elements, "\n"), &["no faces", "point cloud", ": 4"]);
        }
    }
    let strips = ("tristrips", properties(&["list int int vertex_indices"]), vec![vec![vec![0.0, 1.0, -1.0, 2.0]]]);
    expect(write(Encoding::Big, &[make::vertices(&SQUARE), strips], "\n"), &["no faces", "strip"]);
}

#[test]
fn lines_are_refused_by_number_and_row() {
    for (rows, expected) in [
        ("0 0 0\n0 0\n3 0 1 1\n", "line 11: row 1 (from 0) of element \"vertex\": the line ends before the last value"),
        ("0 0 0\n\n0 0 0 1\n3 0 1 1\n", "line 12: row 1 (from 0) of element \"vertex\": the line goes on after"),
        (
            "0 0 nan\n0 0 0\n3 0 1 1\n",
            "line 10: row 0 (from 0) of element \"vertex\": a coordinate is not finite: \"nan\"",
        ),
        (
            "0 0 0\n0 1,5 0\n3 0 1 1\n",
            "line 11: row 1 (from 0) of element \"vertex\": a coordinate is not a number, in",
        ),
        (
            "0 0 0\n0 0 1e999\n3 0 1 1\n",
            "line 11: row 1 (from 0) of element \"vertex\": a coordinate is not finite: \"1",
        ),
        (
            "0 0 0\n0 0 0\n3 0 1 2\n",
            "line 12: row 0 (from 0) of element \"face\": there is no such vertex, the file has 2",
        ),
        (
            "0 0 0\n0 0 0\n3 0 -1 1\n",
            "line 12: row 0 (from 0) of element \"face\": there is no such vertex, the file has 2",
        ),
        (
            "0 0 0\n0 0 0\n3 0 1.0 1\n",
            "line 12: row 0 (from 0) of element \"face\": a vertex index is not an integer: \"1",
        ),
        ("0 0 0\n0 0 0\n4 0 1 1\n", "line 12: row 0 (from 0) of element \"face\": the line ends before the last value"),
        (
            "0 0 0\n0 0 0\n2 0 1 1\n",
            "line 12: row 0 (from 0) of element \"face\": the line goes on after the last value",
        ),
        (
            "0 0 0\n0 0 0\n-3 0 1 1\n",
            "line 12: row 0 (from 0) of element \"face\": the number of values of a list is an",
        ),
        (
            "0 0 0\n0 0 0\nx 0 1 1\n",
            "line 12: row 0 (from 0) of element \"face\": the number of values of a list is an",
        ),
        ("0 0 0\n0 0 0\n4000000000 1\n", "line 12: row 0 (from 0) of element \"face\": the line ends before the last"),
        (
            "0 0 0\n0 0 0\n",
            "the PLY file is truncated, so copy or write it again: element \"face\" has 1 rows, the file has 0",
        ),
        (
            "0 0 0\n",
            "the PLY file is truncated, so copy or write it again: element \"vertex\" has 2 rows, the file has 1",
        ),
    ] {
        let message = message(text(HEADER, rows));
        assert!(message.starts_with(expected), "{message}");
    }
}

#[test]
fn bytes_are_refused_by_row() {
    for encoding in [Encoding::Little, Encoding::Big] {
        let corrupt = |at_end: usize, bytes: &[u8]| {
            let mut file = write(encoding, &square(), "\n");
            let at = file.len() - at_end;
            file[at..at + bytes.len()].copy_from_slice(bytes);
            file
        };
        // two faces of 13 bytes at the end, before them four vertices of 12
        expect(corrupt(13, &[200]), &["row 1 (from 0) of element \"face\"", "200 values of 4 bytes", "12 bytes"]);
        expect(corrupt(26, &[255]), &["row 0 (from 0) of element \"face\"", "255 values"]);
        expect(corrupt(4, &[0xff; 4]), &["row 1 (from 0) of element \"face\"", "the file has 4, counted from 0: -1"]);
        expect(corrupt(4, &[0x7f; 4]), &["row 1 (from 0) of element \"face\"", ": 2139062143"]);
        expect(
            corrupt(26 + 24, &[0x7f, 0xc0, 0xc0, 0x7f]),
            &["row 2 (from 0) of element \"vertex\"", "not finite: NaN"],
        );
        expect(
            corrupt(26 + 24, &[0xff, 0x80, 0x80, 0xff]),
            &["row 2 (from 0) of element \"vertex\"", "not finite: NaN"],
        );
    }
    let mut negative = replaced(&write(Encoding::Big, &square(), "\n"), "list uchar", "list char");
    let at = negative.len() - 26;
    negative[at] = 0x80;
    expect(negative, &["row 0 (from 0) of element \"face\"", "negative number of values: -128"]);
}

#[test]
fn what_contradicts_the_format_line_is_said() {
    let (ascii, little, big) = ("ascii", "binary_little_endian", "binary_big_endian");
    let files = ENCODINGS.map(|encoding| write(encoding, &square(), "\n"));
    for (file, from, to, words) in [
        (0, ascii, little, "but text follows it"),
        (0, ascii, big, "but text follows it"),
        (1, little, ascii, "but zero bytes follow it"),
        (2, big, ascii, "but zero bytes follow it"),
        (1, little, big, "probably in the other order"),
        (2, big, little, "probably in the other order"),
    ] {
        expect(replaced(&files[file], from, to), &[words]);
    }
}

#[test]
fn counts_of_four_thousand_million_take_no_memory() {
    let list = "property list uint int vertex_indices\n";
    for (header, words) in [
        (HEADER.replace("vertex 2", "vertex 4000000000"), ["truncated", "4000000000"]),
        (HEADER.replace("face 1", "face 4000000000"), ["truncated", "4000000000"]),
        (HEADER.replace("face 1", "face 18446744073709551615"), ["truncated", "18446744073709551615"]),
        (HEADER.replace("face 1", "tristrips 4000000000"), ["truncated", "4000000000"]),
        (format!("element edge 4000000000\nproperty int a\n{HEADER}"), ["truncated", "edge"]),
        (format!("element edge 4000000000\n{list}{HEADER}"), ["truncated", "edge"]),
        (HEADER.replace("uchar int", "uint uchar").replace("face 1", "face 1000000000"), ["truncated", "1000000000"]),
    ] {
        for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
            let rows = if encoding == "ascii" { "0 0 0\n".repeat(9) } else { "\0".repeat(200) };
            expect(text(&header, &rows).replace("ascii", encoding), &words);
        }
    }
    // rows without values take no time
    let nothing = "element nothing 18446744073709551615\n".repeat(62);
    let mut bytes = write(Encoding::Little, &square(), "\n");
    let at = bytes.windows(8).position(|window| window == b"element ").expect("an element");
    bytes.splice(at..at, nothing.into_bytes());
    let start = Instant::now();
    assert_eq!(ply(bytes).expect("a mesh").faces.len(), 2);
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
    // lists that claim more than there is, also where they are skipped
    for skipped in ["", "element edge 1\nproperty list uint double a\n"] {
        let header = format!("{skipped}{}", HEADER.replace("uchar", "uint"));
        let rows = if skipped.is_empty() { vec![0; 24] } else { Vec::new() };
        let rows = [&rows[..], &4_000_000_000u32.to_be_bytes(), &[0; 40]].concat();
        let file = [text(&header, "").replace("ascii", "binary_big_endian").as_bytes(), &rows].concat();
        expect(file, &["row 0 (from 0)", "4000000000 values"]);
    }
}

#[test]
fn no_name_reaches_a_message_raw_or_whole() {
    for name in ["\u{1b}[31m\u{202e}".to_owned(), "n".repeat(1 << 19), "\u{7f}".repeat(1 << 18)] {
        for header in [
            format!("{name}\n"),
            format!("element {name} x\n"),
            format!("element {name} 4\nproperty int a\n{HEADER}"),
            format!("element {name} 1\nproperty {name} a\n"),
            format!("element {name} 1\nproperty list float int {name}\n"),
            format!("element {name} 1\nproperty int {name} {name} {name}\n"),
        ] {
            let message = message(text(&header, ""));
            assert!(message.chars().count() < 2500, "{}", message.len());
            assert!(!message.contains(|c: char| c.is_control() || c == '\u{202e}'), "{message:?}");
        }
        let message = message(text(HEADER, &format!("0 0 {name}\n0 0 0\n3 0 0 0\n")));
        assert!(message.chars().count() < 2500 && !message.contains(char::is_control), "{message:?}");
    }
}
