//! STL: the forms that are read, and files that are refused.

use proptest::prelude::*;
use tesserae_mesh::dev::sample::{self, Sample};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, PolygonMesh};
use tesserae_mesh::surface::Surface;
use tesserae_mesh::{Kind, Result};

use crate::make::{check, faces, triangles};
use crate::ply_make;

fn stl(bytes: impl AsRef<[u8]>) -> Result<PolygonMesh> {
    mesh::read(bytes.as_ref(), Format::Stl, &NoResources, &Limits::default())
}

/// A binary file with this header.
pub fn binary(header: &[u8], corners: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((corners.len() as u32).to_le_bytes());
    for (at, triangle) in corners.iter().enumerate() {
        let normal = [f32::NAN, 0.0, f32::INFINITY];
        bytes.extend(normal.iter().chain(triangle.as_flattened()).flat_map(|number| number.to_le_bytes()));
        bytes.extend((at as u16).to_le_bytes());
    }
    bytes
}

/// A text of one solid.
pub fn text(name: &str, corners: &[[[f32; 3]; 3]]) -> String {
    let mut text = format!("solid {name}\n");
    for triangle in corners {
        text += "  facet normal 0 0 1\n    outer loop\n";
        for [x, y, z] in triangle {
            text += &format!("      vertex {x} {y} {z:e}\n");
        }
        text += "    endloop\n  endfacet\n";
    }
    text + &format!("endsolid {name}\n")
}

const SQUARE: [[[f32; 3]; 3]; 2] =
    [[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.]], [[0., 0., 0.], [1., 1., 0.], [0., 1.5, 0.1]]];

fn expected(corners: &[[[f32; 3]; 3]]) -> Vec<Vec<[f64; 3]>> {
    corners.iter().map(|triangle| triangle.iter().map(|corner| corner.map(f64::from)).collect()).collect()
}

/// Positions to the nearest f32, as a text is a decimal.
fn rounded(mesh: &PolygonMesh) -> Vec<Vec<[f64; 3]>> {
    let near = |triangle: Vec<[f64; 3]>| triangle.iter().map(|corner| corner.map(|c| f64::from(c as f32))).collect();
    triangles(mesh).into_iter().map(near).collect()
}

#[test]
fn binary_files_are_read_whatever_their_header_says() {
    for header in
        [&b""[..], b"solid", b"solid facet\nfacet normal", b"\xff\xfe", b"# v 1 2 3", b"ply", b"OFF\n", b"PK\x03\x04"]
    {
        let bytes = binary(header, &SQUARE);
        let mesh = stl(&bytes).unwrap_or_else(|error| panic!("{header:?}: {error}"));
        check(&mesh);
        assert_eq!((mesh.format, mesh.parts.len()), (Format::Stl, 1));
        assert_eq!(triangles(&mesh), expected(&SQUARE));
        assert_eq!(faces(&mesh), [[0, 1, 2], [3, 4, 5]]);
        assert!(mesh.warnings.is_empty());
        assert_eq!(Format::recognise(None, &bytes, Some(bytes.len() as u64)), Ok(Format::Stl));
    }
}

#[test]
fn triangles_are_neighbours_where_their_corners_are_equal() {
    for mesh in [stl(binary(b"", &SQUARE)), stl(text("a", &SQUARE))] {
        let counts = Surface::build(&mesh.expect("a mesh")).expect("a surface").counts;
        assert_eq!((counts.welded_vertices, counts.components, counts.boundary_edges), (4, 1, 4));
    }
}

/// Labels are a function of the surface, so they do not depend on the format.
#[test]
fn one_mesh_in_three_formats_is_one_surface() {
    let mesh = sample::generate(Sample::Knot, 3000).expect("a sample");
    let mut obj = Vec::new();
    sample::write_obj(&mut obj, &mesh).expect("written");
    let obj = crate::make::obj(&obj).expect("a mesh");
    let mut vertices = ply_make::vertices(&obj.positions);
    vertices.1 = ply_make::properties(&["double x", "double y", "double z"]);
    let elements = [ply_make::faces(&faces(&obj)), vertices];
    let mut solid = "solid\n".to_owned();
    for triangle in triangles(&obj) {
        let corners: String = triangle.iter().map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).collect();
        solid += &format!("facet\nouter loop\n{corners}endloop\nendfacet\n");
    }
    let surface = |mesh: &PolygonMesh| Surface::build(mesh).expect("a surface");
    let expected = surface(&obj);
    let plys = ply_make::ENCODINGS.map(|encoding| ply_make::ply(ply_make::write(encoding, &elements, "\n")));
    for mesh in plys.into_iter().chain([stl(solid)]) {
        let found = surface(&mesh.expect("a mesh"));
        assert!(found.upload_face == expected.upload_face && found.points == expected.points);
        assert!(found.weights == expected.weights && found.neighbours == expected.neighbours);
    }
}

#[test]
fn text_is_read_in_any_case_with_any_line_ends() {
    let plain = text("part one", &SQUARE);
    for text in [
        plain.clone(),
        plain.replace('\n', "\r\n"),
        plain.replace('\n', "\r"),
        plain.to_uppercase(),
        plain.replace("  ", "\t").replace('\n', " \n\n"),
        format!("\n {}", plain.trim_end()),
        plain.replace("normal 0 0 1", "normal nan inf x"),
        plain.replace("\n    outer loop\n", "\n outer\nloop "),
    ] {
        let mesh = stl(&text).unwrap_or_else(|error| panic!("{text:?}: {error}"));
        check(&mesh);
        assert_eq!(rounded(&mesh), expected(&SQUARE), "{text:?}");
        assert!(mesh.parts[0].group.as_ref().is_some_and(|name| name.eq_ignore_ascii_case("part one")));
        assert!(mesh.warnings.is_empty());
        assert_eq!(Format::recognise(None, text.as_bytes(), Some(text.len() as u64)), Ok(Format::Stl));
    }
}

#[test]
fn solids_are_parts() {
    let empty = "solid empty\nendsolid empty\n";
    let one = text("", &SQUARE[..1]);
    let facet = one.trim_start_matches("solid \n").trim_end_matches("endsolid \n");
    let named = [text("a", &SQUARE), empty.into(), text("a", &SQUARE[..1]), text("", &SQUARE[..1])].concat();
    let mut bytes = named.into_bytes();
    bytes.extend(b"solid \xff\xfe\n");
    bytes.extend(facet.as_bytes());
    let mesh = stl(&bytes).expect("a mesh");
    check(&mesh);
    let parts: Vec<_> = mesh.parts.iter().map(|part| (part.group.as_deref(), part.first_face, part.faces)).collect();
    let damaged = Some("\u{fffd}\u{fffd}");
    assert_eq!(parts, [(Some("a"), 0, 2), (Some("a"), 2, 1), (None, 3, 1), (damaged, 4, 1)]);
    assert_eq!(mesh.warnings, ["solids without endsolid, so the file may be truncated: 1"]);
}

#[test]
fn bytes_after_the_last_triangle_are_ignored_with_a_warning() {
    let mut bytes = binary(b"", &SQUARE);
    bytes.extend([0; 7]);
    let mesh = stl(bytes).expect("a mesh");
    assert_eq!(
        (mesh.faces.len(), &mesh.warnings[..]),
        (2, &["bytes after the last triangle were ignored: 7".into()][..])
    );
}

#[track_caller]
fn message(bytes: impl AsRef<[u8]>) -> String {
    let error = stl(bytes).expect_err("refused");
    assert_eq!(error.kind, Kind::InvalidMesh, "{error}");
    error.message
}

#[test]
fn text_is_refused_by_line_and_facet() {
    let plain = text("a", &SQUARE);
    let third = "      vertex 1 1 0e0\n";
    for (text, expected) in [
        (
            plain.replacen(third, "", 1),
            "line 6: facet 0 (from 0): a facet has three vertices, so vertex must come next, not \"endloop\"",
        ),
        (
            plain.replacen(third, &third.repeat(2), 1),
            "line 7: facet 0 (from 0): a facet has three vertices, so endloop must come next, not \"vertex\"",
        ),
        (
            plain.replace("vertex 0 1.5", "vertex 0 nan"),
            "line 13: facet 1 (from 0): a coordinate is not finite: \"nan\"",
        ),
        (
            plain.replace("vertex 0 1.5", "vertex 0 1,5"),
            "line 13: facet 1 (from 0): a coordinate is not a number, in wh",
        ),
        (
            plain.replace("vertex 0 1.5 1e-1", "vertex 0 1"),
            "line 13: facet 1 (from 0): three coordinates are needed, there",
        ),
        (plain.replace("endsolid", "end"), "line 16: facet, solid or endsolid must come next, not \"end\""),
        (plain[..plain.len() - 22].into(), "line 15: facet 1 (from 0): the file is truncated: it ends before the endf"),
        (
            plain.replace("vertex 0 1.5", "vertex 0 1.5 7"),
            "line 13: facet 1 (from 0): a facet has three vertices, so endloop",
        ),
    ] {
        let message = message(&text);
        assert!(message.starts_with(expected), "{message}\n{text}");
    }
    let many = text("many", &[SQUARE[0]; 20_000]);
    let error = message(many.replacen("endsolid many", "facet normal 0 0 0 outer", 1));
    assert!(error.starts_with("line 140003: facet 20000 (from 0): the file is truncated"), "{error}");
    assert!(message("solid a\nendsolid a\n").contains("no triangles"));
}

#[test]
fn binary_files_are_refused_by_triangle_and_length() {
    let bytes = binary(b"", &SQUARE);
    for (at, number) in [(84 + 12, f32::NAN), (84 + 50 + 12 + 32, f32::INFINITY), (84 + 50 + 12, -f32::INFINITY)] {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        let expected = format!("triangle {} (from 0): a coordinate is not finite: {number}", (at - 84) / 50);
        assert_eq!(message(bytes), expected);
    }
    for length in 0..bytes.len() {
        let message = message(&bytes[..length]);
        assert!(message.contains("STL file") || message.contains("empty"), "{length}: {message}");
    }
    let mut many = bytes.clone();
    many[80..84].fill(0xff);
    assert!(message(many).contains("truncated"));
    let mut none = bytes[..84].to_vec();
    none[80..84].fill(0);
    none[..6].copy_from_slice(b"solid ");
    assert!(message(none).contains("no triangles"));
}

#[test]
fn limits_hold() {
    for bytes in [binary(b"", &SQUARE), text("a", &SQUARE).into_bytes()] {
        let read = |max_faces| {
            let limits = Limits { max_faces, ..Limits::default() };
            mesh::read(&bytes, Format::Stl, &NoResources, &limits)
        };
        assert!(read(2).is_ok());
        assert_eq!(read(1).expect_err("faces").kind, Kind::TooLarge);
    }
}

/// Compares a mesh with what another reader finds in the same bytes.
pub fn compare(mesh: &PolygonMesh, bytes: &[u8]) {
    let mut bytes = std::io::Cursor::new(bytes);
    let others = stl_io::create_stl_reader(&mut bytes).expect("a mesh of the oracle");
    let theirs: Vec<Vec<[f64; 3]>> = others
        .map(|triangle| {
            let corners = triangle.expect("a triangle").vertices;
            corners.iter().map(|corner| [0, 1, 2].map(|axis| f64::from(corner[axis]))).collect()
        })
        .collect();
    assert!(rounded(mesh) == theirs);
}

proptest! {
    /// What is written is read, as text and as bytes, and another reader finds the same.
    #[test]
    fn written_meshes_are_read_back(
        corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1e9f32..1e9)), 1..60),
        header in prop::collection::vec(any::<u8>(), 0..80), name in "[ -~]{0,40}",
    ) {
        let bytes = binary(&header, &corners);
        let mesh = stl(&bytes).expect("a mesh");
        check(&mesh);
        prop_assert_eq!(triangles(&mesh), expected(&corners));
        if !header.to_ascii_lowercase().starts_with(b"solid") {
            compare(&mesh, &bytes);
        }
        let text = text(&name, &corners);
        let mesh = stl(&text).expect("a mesh");
        check(&mesh);
        prop_assert_eq!(rounded(&mesh), expected(&corners));
        prop_assert_eq!(mesh.parts[0].group.as_deref().unwrap_or_default(), name.trim());
        compare(&mesh, text.as_bytes());
    }
}
