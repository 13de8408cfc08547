//! OFF: the forms that are read, and the files that are refused, with what is wrong and where.

use std::time::{Duration, Instant};

use proptest::prelude::*;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, Part, PolygonMesh};
use tesserae_mesh::{Kind, Result};

use crate::make::{SQUARE, check, faces};

/// A square of a triangle and a quad that has a colour.
pub const TEXT: &str = "OFF\n# made by a test\n4 2 5\n0 0 0\n1 0 0\n1 1.5 0\n0 1e-3 1\n3 0 1 2\n4 0 1 2 3 255 0 0\n";

fn off(bytes: impl AsRef<[u8]>) -> Result<PolygonMesh> {
    mesh::read(bytes.as_ref(), Format::Off, &NoResources, &Limits::default())
}

/// The square of two triangles under this header, with these numbers after the coordinates of each vertex.
fn square(header: &str, more: &str, end: &str) -> String {
    let vertices = SQUARE.iter().map(|[x, y, z]| format!("{x} {y} {z}{more}{end}"));
    let rows: String = vertices.chain(["3 0 1 2", "3 0 2 3"].map(|face| format!("{face}{end}"))).collect();
    format!("{header}{end}{rows}")
}

#[track_caller]
fn expect_square(text: impl AsRef<[u8]>) {
    let mesh = off(&text).expect("a mesh");
    check(&mesh);
    assert_eq!((mesh.format, &mesh.positions[..]), (Format::Off, &SQUARE[..]));
    assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.parts, [Part { faces: 2, ..Part::default() }]);
    assert!(mesh.warnings.is_empty(), "{:?}", mesh.warnings);
    assert_eq!(Format::recognise(None, text.as_ref(), None), Ok(Format::Off));
}

#[test]
fn all_headers_and_line_ends_are_read() {
    for end in ["\n", "\r\n", "\r"] {
        for (header, more) in [
            ("OFF\n4 2 0", ""),
            ("OFF 4 2 0", ""),
            ("OFF4 2 0", ""),
            ("OFF\n4 2", ""),
            ("OFF\n4\n2 5", ""),
            ("\u{feff}OFF\n4 2 0", ""),
            ("OFF\n4 2 0 # edges are not counted", ""),
            ("COFF\n4 2 0", " 255 0 0 255"),
            ("NOFF\n4 2 0", " 0 0 1"),
            ("CNOFF\n4 2 0", " 0 0 1 0.5 0.5 0.5 1"),
            ("NCOFF\n4 2 0", " 0 0 1 0.5 0.5 0.5 1"),
            ("STOFF\n4 2 0", " 0.5 0.5"),
            ("STCNOFF\n4 2 0", " 0 0 1 1 1 1 1 0.5 0.5"),
        ] {
            expect_square(square(&header.replace('\n', end), more, end));
        }
    }
}

#[test]
fn blanks_comments_and_colours_do_not_matter() {
    let text = "OFF # a comment\n\n# another\n  4\t2 1\n\n0 0 0\n # between rows\n1 0 0 # behind a row\n 1 1 0\n0 1 0\n\
                3 0 1 2 # no colour\n\n3 0 2 3 0.1 0.2 0.3\n\n# the end";
    expect_square(text);
}

#[test]
fn faces_keep_their_places_whatever_their_corners() {
    let mesh = off("OFF\n4 4 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n2 1 2\n0\n3 0 1 2\nmore\n").expect("a mesh");
    check(&mesh);
    assert_eq!(faces(&mesh), [&[0, 1, 2, 3][..], &[1, 2, 2], &[0, 0, 0], &[0, 1, 2]]);
    let words = ["fewer than 3 corners were kept as degenerate triangles: 2", "after the last face were ignored: 1"];
    assert!(mesh.warnings.iter().zip(words).all(|(warning, words)| warning.contains(words)), "{:?}", mesh.warnings);
}

#[test]
fn files_are_refused_by_line_and_row() {
    let body = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let with = |from: &str, to: &str| format!("OFF\n3 1 0\n{}", body.replacen(from, to, 1));
    for (text, words) in [
        ("4OFF\n3 1 0\n".to_owned() + body, ["other than three coordinates", "\"4OFF\""]),
        ("nOFF\n2\n3 1 0\n".to_owned() + body, ["other than three coordinates", "\"nOFF\""]),
        ("OFF BINARY\n\0\0\0\x03".to_owned(), ["binary OFF is not read", "text"]),
        ("OFF\n3 1 0\n\0\0\0".to_owned(), ["zero bytes", "as text"]),
        ("OFFSET\n3 1 0\n".to_owned() + body, ["not an OFF file", "\"OFF\""]),
        ("OFF\nthree 1 0\n".to_owned() + body, ["line 2: ", "number of vertices is an integer from 0 on: \"three\""]),
        ("OFF\n3 -1 0\n".to_owned() + body, ["line 2: ", "number of faces is an integer from 0 on: \"-1\""]),
        ("OFF\n".to_owned(), ["number of vertices", "\"\""]),
        ("OFF\n3 1 0 7\n".to_owned() + body, ["line 2: ", "\"7\""]),
        ("OFF\n3 0 0\n".to_owned() + body, ["no faces", "vertices: 3"]),
        ("OFF\n0 1 0\n0\n".to_owned(), ["without corners", "no vertices"]),
        ("OFF\n3 2 0\n".to_owned() + body, ["3 vertices and 2 faces", "4 lines follow"]),
        (with("1 0 0", "1 0"), ["line 4: vertex 1 (from 0): ", "third coordinate"]),
        (with("1 0 0", "1 0,5 0"), ["line 4: vertex 1 (from 0): ", "\"0,5\""]),
        (with("1 0 0", "1 nan 0"), ["line 4: vertex 1 (from 0): ", "not finite"]),
        (with("1 0 0", "1 # 0 0"), ["line 4: vertex 1 (from 0): ", "third coordinate"]),
        (with("3 0 1 2", "3 0 1"), ["line 6: face 0 (from 0): ", "last of its corners, 3"]),
        (with("3 0 1 2", "3 0 1 3"), ["line 6: face 0 (from 0): ", "there is no such vertex, the file has 3"]),
        (with("3 0 1 2", "3 0 1 -1"), ["line 6: face 0 (from 0): ", "counted from 0: -1"]),
        (with("3 0 1 2", "3 0 1 1.5"), ["line 6: face 0 (from 0): ", "not an integer: \"1.5\""]),
        (with("3 0 1 2", "-3 0 1 2"), ["line 6: face 0 (from 0): ", "number of corners"]),
    ] {
        let error = off(&text).expect_err(&text);
        assert_eq!(error.kind, Kind::InvalidMesh, "{text}");
        assert!(words.iter().all(|word| error.message.contains(word)), "{text}: {error}");
    }
}

/// What a header declares costs nothing before it is compared with the file.
#[test]
fn hostile_numbers_cost_nothing() {
    let start = Instant::now();
    for text in [
        "OFF 4000000000 1 0\n",
        "OFF 3 99999999999999999999999 0\n0 0 0\n",
        "OFF 1 1 0\n0 0 0\n4000000000 0 0 0\n",
        "OFF 1 1 0\n0 0 0\n99999999999999999999999 0\n",
    ] {
        assert!(off(text).is_err(), "{text}");
    }
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
    let limits = Limits { max_faces: 1, ..Limits::default() };
    let error = mesh::read(TEXT.as_bytes(), Format::Off, &NoResources, &limits).expect_err("faces");
    assert_eq!(error.kind, Kind::TooLarge);
}

proptest! {
    /// What is written is read; files of several pieces, too.
    #[test]
    fn written_meshes_are_read_back(
        positions in prop::collection::vec(prop::array::uniform3(-1e9f64..1e9), 3..60),
        polygons in prop::collection::vec(prop::collection::vec(any::<prop::sample::Index>(), 3..7), 1..60),
        repeats in prop_oneof![Just(1usize), Just(300)],
    ) {
        let polygons: Vec<Vec<u32>> = polygons
            .iter()
            .map(|corners| corners.iter().map(|corner| corner.index(positions.len()) as u32).collect())
            .collect();
        let mut text = format!("OFF\n{} {} 0\n", positions.len(), polygons.len() * repeats);
        for [x, y, z] in &positions {
            text += &format!("{x} {y} {z}\n");
        }
        for corners in polygons.iter().cycle().take(polygons.len() * repeats) {
            let words: Vec<String> = corners.iter().map(u32::to_string).collect();
            text += &format!("{} {}\n", corners.len(), words.join(" "));
        }
        let mesh = off(&text).expect("a mesh");
        prop_assert_eq!(&mesh.positions, &positions);
        prop_assert_eq!(mesh.faces.len(), polygons.len() * repeats);
        for face in 0..mesh.faces.len() {
            prop_assert_eq!(mesh.faces.corners(face), &polygons[face % polygons.len()][..]);
        }
    }
}
