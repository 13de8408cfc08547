//! PLY: the forms that are read.

use proptest::prelude::*;
use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, Part, PolygonMesh};

use crate::make::{SQUARE, check, faces, triangles};
use crate::ply_make::{self as make, ENCODINGS, Element, Encoding, ply, properties, square, write};

const LINE_ENDS: [&str; 3] = ["\n", "\r\n", "\r"];

#[test]
fn all_encodings_and_line_ends_are_read() {
    for encoding in ENCODINGS {
        for end in LINE_ENDS {
            let mesh = ply(write(encoding, &square(), end)).expect("a mesh");
            check(&mesh);
            assert_eq!((mesh.format, &mesh.positions[..]), (Format::Ply, &SQUARE[..]));
            assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 3]]);
            assert_eq!(mesh.parts, [Part { faces: 2, ..Part::default() }]);
            assert!(mesh.warnings.is_empty(), "{:?}", mesh.warnings);
        }
    }
}

#[test]
fn blanks_do_not_matter() {
    let text = "ply \nformat  ascii\t1.0 \n\ncomment\n  element vertex 3\nproperty float x\nproperty float y\n\
                property float z \n element face  1\nproperty list uchar int vertex_index\nend_header  \n\n\
                \t0 0  0\n1 0 0 \r\n\n   \n0 1 0\n\n3 0\t1 2\n\n";
    let mesh = ply(text).expect("a mesh");
    assert_eq!(mesh.positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(faces(&mesh), [[0, 1, 2]]);
    assert!(mesh.warnings.is_empty());
}

#[test]
fn a_line_feed_right_behind_the_header_is_data() {
    // in little endian, the first byte of x is a line feed
    let x = f64::from(f32::from_le_bytes([b'\n', 0, 0x80, 0x3f]));
    let positions = [[x, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let bytes = write(Encoding::Little, &[make::vertices(&positions), make::faces(&[&[0, 1, 2]])], "\n");
    assert!(bytes.windows(12).any(|window| window == b"end_header\n\n"));
    assert_eq!(ply(bytes).expect("a mesh").positions, positions);
}

#[test]
fn every_type_is_read_by_both_of_its_names() {
    let (whole, any) = ([[0.0, 1.0, 2.0], [3.0, 100.0, 5.0], [6.0, 7.0, 8.0]], [[0.5, -1.25, 3.0]; 3]);
    let types = ["char", "uchar", "short", "ushort", "int", "uint", "float", "double"];
    let others = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"];
    for encoding in ENCODINGS {
        for kind in types.into_iter().chain(others) {
            let is_real = kind.starts_with("float") || kind == "double";
            let (mut vertices, mut faces) =
                (make::vertices(if is_real { &any } else { &whole }), make::faces(&[&[2, 1, 0]]));
            vertices.1 = ["x", "y", "z"].map(|axis| format!("{kind} {axis}")).to_vec();
            let mut checked = vec![vertices.clone()];
            if !is_real {
                faces.1 = vec![format!("list {kind} {kind} vertex_indices")];
            }
            checked.push(faces);
            let mesh = ply(write(encoding, &checked, "\n")).unwrap_or_else(|error| panic!("{kind}: {error}"));
            assert_eq!(mesh.positions, if is_real { any } else { whole }, "{kind} {encoding:?}");
            assert_eq!(crate::make::faces(&mesh), [[2, 1, 0]]);
        }
    }
}

#[test]
fn doubles_keep_their_precision() {
    let positions = [[0.1, 1e-300, 9_007_199_254_740_993.0], [1.0 / 3.0, -1e300, 5e-324], [0.0, 1.0, 2.0]];
    for encoding in ENCODINGS {
        let mut vertices = make::vertices(&positions);
        vertices.1 = properties(&["double x", "double y", "double z"]);
        let mesh = ply(write(encoding, &[vertices, make::faces(&[&[0, 1, 2]])], "\n")).expect("a mesh");
        assert_eq!(mesh.positions, positions);
    }
}

/// Elements and properties that are not read, lists among them, before, between and after those that are.
fn rich() -> Vec<Element> {
    let [mut vertices, mut faces] = <[Element; 2]>::try_from(square()).expect("two elements");
    vertices.1 = properties(&["uchar red", "float x", "list uchar short marks", "float y", "double q", "float z"]);
    for (at, row) in vertices.2.iter_mut().enumerate() {
        row.insert(0, vec![255.0]);
        row.insert(2, (0..at).map(|mark| mark as f64).collect());
        row.insert(4, vec![0.25]);
    }
    faces.1 = properties(&["list int float texcoord", "list uchar uint vertex_index", "uchar flags"]);
    for row in &mut faces.2 {
        row.insert(0, vec![0.0, 0.5, 1.0]);
        row.push(vec![7.0]);
    }
    let edges = || ("edge", properties(&["int vertex1", "int vertex2"]), vec![vec![vec![0.0], vec![1.0]]; 3]);
    let lists = || ("material", properties(&["list uint double weights"]), vec![vec![vec![]], vec![vec![1.0, 2.0]]]);
    let nothing = ("nothing", Vec::new(), vec![Vec::new(); 5]);
    vec![edges(), faces, nothing, lists(), vertices, ("camera", properties(&["float view"]), vec![vec![vec![1.0]]])]
}

#[test]
fn other_elements_and_properties_are_skipped_wherever_they_are() {
    for encoding in ENCODINGS {
        for end in LINE_ENDS {
            let mesh = ply(write(encoding, &rich(), end)).expect("a mesh");
            check(&mesh);
            assert_eq!(mesh.positions, SQUARE);
            assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 3]]);
            let skipped = "rows of elements other than vertex, face and tristrips were skipped: 11";
            assert_eq!(mesh.warnings, [skipped]);
        }
    }
}

#[test]
fn strips_are_triangles_that_face_one_side() {
    let strip = |kind: &str, rows: &[&[f64]]| -> Element {
        let rows = rows.iter().map(|row| vec![row.to_vec()]).collect();
        ("tristrips", vec![format!("list int {kind} vertex_indices")], rows)
    };
    for encoding in ENCODINGS {
        for (kind, restart) in [("int", -1.0), ("short", -1.0), ("uint", f64::from(u32::MAX))] {
            let strips = strip(kind, &[&[0.0, 1.0, 3.0, 2.0, restart, 2.0, 3.0, restart, 0.0, 2.0, 1.0], &[], &[3.0]]);
            let bytes = write(encoding, &[strips.clone(), make::vertices(&SQUARE)], "\n");
            let mesh = ply(bytes).expect("a mesh");
            assert_eq!(faces(&mesh), [[0, 1, 3], [3, 1, 2], [0, 2, 1]], "{encoding:?} {kind}");
            // beside faces, in the order of the file
            let both = write(encoding, &[make::vertices(&SQUARE), make::faces(&[&[0, 1, 2, 3]]), strips], "\n");
            let mesh = ply(both).expect("a mesh");
            assert_eq!(faces(&mesh), [&[0, 1, 2, 3][..], &[0, 1, 3], &[3, 1, 2], &[0, 2, 1]]);
        }
    }
}

#[test]
fn faces_of_few_corners_keep_their_places() {
    for encoding in ENCODINGS {
        let lists: [&[u32]; 6] = [&[0, 1, 2], &[], &[3], &[1, 2], &[0, 1, 2, 3], &[2, 2, 2]];
        let mesh = ply(write(encoding, &[make::vertices(&SQUARE), make::faces(&lists)], "\n")).expect("a mesh");
        check(&mesh);
        let expected: [&[u32]; 6] = [&[0, 1, 2], &[0, 0, 0], &[3, 3, 3], &[1, 2, 2], &[0, 1, 2, 3], &[2, 2, 2]];
        assert_eq!(faces(&mesh), expected);
        assert_eq!(mesh.warnings, ["faces of fewer than 3 corners were kept as degenerate triangles: 3"]);
        let counts = tesserae_mesh::surface::Surface::build(&mesh).expect("a surface").counts;
        assert_eq!(counts.degenerate_faces, 4);
    }
}

#[test]
fn a_face_may_have_as_many_corners_as_its_count_can_say() {
    let corners: Vec<u32> = (0..255).map(|corner| corner % 4).collect();
    for encoding in ENCODINGS {
        let mesh = ply(write(encoding, &[make::vertices(&SQUARE), make::faces(&[&corners, &[0, 1, 2]])], "\n"));
        let mesh = mesh.expect("a mesh");
        assert_eq!(faces(&mesh), [&corners[..], &[0, 1, 2]]);
    }
}

#[test]
fn what_follows_the_last_row_is_ignored_with_a_warning() {
    for (encoding, warning) in [
        (Encoding::Text, "lines after the last row were ignored: 1"),
        (Encoding::Little, "bytes after the last row were ignored: 6"),
    ] {
        let mut bytes = write(encoding, &square(), "\n");
        bytes.extend(b"more\n\n");
        let mesh = ply(&bytes).expect("a mesh");
        assert_eq!((faces(&mesh).len(), &mesh.warnings[..]), (2, &[warning.to_owned()][..]));
    }
}

#[test]
fn files_of_several_pieces_are_read_as_one() {
    let count = 40_000;
    let positions: Vec<[f64; 3]> = (0..count).map(|at| [f64::from(at), 0.5, -f64::from(at)]).collect();
    let lists: Vec<Vec<u32>> =
        (0..count).map(|at| (0..3 + at % 2).map(|corner| (at + corner) % count).collect()).collect();
    let lists: Vec<&[u32]> = lists.iter().map(Vec::as_slice).collect();
    let elements = [make::faces(&lists), make::vertices(&positions)];
    let expected = ply(write(Encoding::Little, &elements, "\n")).expect("a mesh");
    assert_eq!((&expected.positions, faces(&expected)), (&positions, lists));
    for bytes in [write(Encoding::Big, &elements, "\n"), write(Encoding::Text, &elements, "\n")] {
        assert_eq!(ply(bytes).as_ref(), Ok(&expected));
    }
    // an error is in the line and the row that it is in
    let mut text = String::from_utf8(write(Encoding::Text, &elements, "\n")).expect("text");
    let at = text.find("\n39000 0.5 ").expect("a row") + 1;
    text.replace_range(at..at + 5, "39x00");
    let line = text[..at].matches('\n').count() + 1;
    let error = ply(text).expect_err("a bad row");
    let expected =
        format!("line {line}: row 39000 (from 0) of element \"vertex\": a coordinate is not a number: \"39x00\"");
    assert_eq!(error.message, expected);
}

#[test]
fn limits_hold() {
    for encoding in ENCODINGS {
        let bytes = write(encoding, &square(), "\n");
        let read = |max_faces| {
            let limits = Limits { max_faces, ..Limits::default() };
            mesh::read(&bytes, Format::Ply, &NoResources, &limits)
        };
        assert!(read(2).is_ok());
        assert_eq!(read(1).expect_err("faces").kind, Kind::TooLarge);
    }
}

/// What another reader finds: positions as f32, and corners.
pub fn oracle(bytes: &[u8]) -> (Vec<[f32; 3]>, Vec<Vec<u32>>) {
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::DefaultElement;

    let ply = Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).expect("a mesh of the oracle");
    let coordinate = |row: &DefaultElement, axis: &str| row[axis].to_f32_lossy().expect("a number");
    let position = |row: &DefaultElement| ["x", "y", "z"].map(|axis| coordinate(row, axis));
    let list = |row: &DefaultElement| {
        let list = row.get("vertex_indices").or_else(|| row.get("vertex_index"));
        list.and_then(|list| list.to_u32_list()).expect("a list")
    };
    (ply.payload["vertex"].iter().map(position).collect(), ply.payload["face"].iter().map(list).collect())
}

/// Compares a mesh with what another reader finds in the same bytes.
pub fn compare(mesh: &PolygonMesh, bytes: &[u8]) {
    let (positions, lists) = oracle(bytes);
    let ours: Vec<[f32; 3]> = mesh.positions.iter().map(|position| position.map(|c| c as f32)).collect();
    assert!(ours == positions && faces(mesh) == lists);
}

#[test]
fn another_reader_finds_the_same() {
    for encoding in ENCODINGS {
        for elements in [square(), rich().into_iter().filter(|element| element.0 != "nothing").collect()] {
            let bytes = write(encoding, &elements, "\n");
            compare(&ply(&bytes).expect("a mesh"), &bytes);
        }
    }
}

proptest! {
    /// What is written is read, however it is written.
    #[test]
    fn written_meshes_are_read_back(
        positions in prop::collection::vec(prop::array::uniform3(-1e9f64..1e9), 1..50),
        polygons in prop::collection::vec(prop::collection::vec(0usize..1000, 3..7), 1..60),
        encoding in prop::sample::select(&ENCODINGS[..]), end in prop::sample::select(&LINE_ENDS[..]),
        count in prop::sample::select(vec!["char", "uint8", "short", "uint16", "int32", "uint"]),
        index in prop::sample::select(vec!["int8", "uchar", "int16", "ushort", "int", "uint32"]),
        order in prop::collection::vec(any::<prop::sample::Index>(), 6),
        name in prop::sample::select(vec!["vertex_index", "vertex_indices"]),
    ) {
        let mut vertices = make::vertices(&positions);
        vertices.1 = properties(&["double x", "double y", "double z"]);
        let corners: Vec<Vec<u32>> = polygons
            .iter()
            .map(|polygon| polygon.iter().map(|&corner| (corner % positions.len()) as u32).collect())
            .collect();
        let mut lists = make::faces(&corners.iter().map(Vec::as_slice).collect::<Vec<_>>());
        lists.1 = vec![format!("list {count} {index} {name}")];
        // properties in any order, with others in between
        for (element, more) in [(&mut vertices, "list uchar float w"), (&mut lists, "short material")] {
            element.1.push(more.to_owned());
            element.2.iter_mut().for_each(|row| row.push(vec![1.0]));
            for (at, with) in order.iter().enumerate() {
                let (at, with) = (at % element.1.len(), with.index(element.1.len()));
                element.1.swap(at, with);
                element.2.iter_mut().for_each(|row| row.swap(at, with));
            }
        }
        let elements = if order[0].index(2) == 0 { vec![vertices, lists] } else { vec![lists, vertices] };
        let mesh = ply(write(encoding, &elements, end)).expect("a mesh");
        check(&mesh);
        prop_assert_eq!(&mesh.positions, &positions);
        prop_assert_eq!(faces(&mesh), corners);
        prop_assert_eq!(triangles(&mesh).len(), polygons.len());
    }
}
