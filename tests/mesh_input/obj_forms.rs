//! OBJ: the forms that are read and the errors that name lines.

use proptest::prelude::*;
use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, Part};

use crate::make::{check, faces, obj};

const VERTICES: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn with_faces(lines: &str) -> Vec<Vec<u32>> {
    let mesh = obj(format!("{VERTICES}{lines}")).expect("a mesh");
    check(&mesh);
    assert_eq!(mesh.positions.len(), 4);
    faces(&mesh).into_iter().map(<[u32]>::to_vec).collect()
}

fn message(text: &str) -> String {
    let error = obj(text).expect_err("refused");
    assert_eq!(error.kind, Kind::InvalidMesh, "{error}");
    error.message
}

#[test]
fn every_form_of_corner_is_read() {
    let triangle = [[0, 1, 2]];
    for line in [
        "f 1 2 3",
        "f 1/7 2/8 3/9",
        "f 1//7 2//8 3//9",
        "f 1/1/1 2/2/2 3/3/3",
        "f -4 -3 -2",
        "f -4/-1/-1 2//-1 3",
        "f 1/ 2// 3/1/",
        "f\t1\t2\t3",
        "f 1 2 3 ",
        "  f  1   2 3",
        "f +1 2 3",
        "f 01 2 3",
        "fo 1 2 3",
        "f 1 2 3 # 4",
        "f 1 2 3# 4",
        "f 1 2 3\r",
        "f 1 \\\n2 \\\r\n 3",
        "f \\\n\\\n1 2 3\\\n",
        "f\\\n1 2 3",
        "f 1 2\\\n3",
        "f 1 2 3\\",
    ] {
        assert_eq!(with_faces(line), triangle, "{line:?}");
        assert_eq!(with_faces(&format!("{line}\n\n")), triangle, "{line:?}");
    }
}

#[test]
fn polygons_stay_polygons_in_file_order() {
    assert_eq!(
        with_faces("f 1 2 3 4\nf 1 2 3\nf 4 3 2 1 2\nf 2 2 2"),
        [&[0, 1, 2, 3][..], &[0, 1, 2], &[3, 2, 1, 0, 1], &[1, 1, 1]]
    );
}

#[test]
fn one_face_may_have_a_million_corners() {
    let corners = 1_000_000;
    let mut text = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\nf");
    for corner in 0..corners {
        text += [" 1", " 2", " -1"][corner % 3];
    }
    let mesh = obj(text).expect("a mesh");
    assert_eq!(mesh.faces.len(), 1);
    assert_eq!(mesh.faces.corners(0).len(), corners);
    assert_eq!(mesh.faces.triangles(), corners as u64 - 2);
    assert_eq!(mesh.faces.corners(0)[..4], [0, 1, 2, 0]);
    assert_eq!(mesh.faces.corners(0)[corners - 3..], [1, 2, 0]);
}

#[test]
fn coordinates_are_doubles_correctly_rounded() {
    let mesh = obj(
        "v 0.1 -1.5e-3 +2E+2 0.5\nv .5 5. -0 1 0 0\nv 0.30000000000000004 1e-400 9007199254740993 nan 2 3 4\nf 1 2 3",
    )
    .expect("a mesh");
    assert_eq!(
        mesh.positions,
        [[0.1, -1.5e-3, 200.0], [0.5, 5.0, 0.0], [0.300_000_000_000_000_04, 0.0, 9_007_199_254_740_992.0]]
    );
}

#[test]
fn line_ends_marks_and_unknown_statements_do_not_matter() {
    let plain = "# made by hand \\\nmtllib ../../etc/passwd\\\nv 0 0 0\nvn 0 0 1\nvt 0 0\nv 1 0 0\nv 1 1 0\ns off\n\
                 usemtl x\nvp 1\nweird 1 2 3\nf 1 2 3\n";
    let expected = obj(plain).expect("a mesh");
    assert_eq!((expected.positions.len(), expected.faces.len()), (3, 1));
    for text in [
        plain.replace('\n', "\r\n"),
        plain.replace('\n', "\r"),
        format!("\u{feff}{plain}"),
        plain.trim_end().to_owned(),
        format!("\n\n{plain}\n\n\n"),
    ] {
        let mesh = obj(&text).expect("a mesh");
        assert_eq!(mesh.positions, expected.positions, "{text:?}");
        assert_eq!(mesh.faces, expected.faces, "{text:?}");
    }
}

#[test]
fn carriage_returns_end_lines_beside_line_feeds() {
    let lines = "# made by hand\nv 0 0 0\nv 1 0 0\nv 1 1 0\ng a\nf 1 2 3\n";
    let expected = obj(lines).expect("a mesh");
    let breaks = lines.match_indices('\n').map(|(at, _)| at);
    // one line feed among carriage returns, and one carriage return among line feeds
    for at in breaks {
        for (usual, other) in [("\r", "\n"), ("\n", "\r"), ("\r", "\r\n"), ("\r\n", "\r"), ("\n", "\r\r\n")] {
            let text = [&lines[..at].replace('\n', usual), other, &lines[at + 1..].replace('\n', usual)].concat();
            assert_eq!(obj(&text).as_ref(), Ok(&expected), "{text:?}");
        }
    }
}

#[test]
fn faces_may_refer_to_later_vertices() {
    let mesh = obj("v 0 0 0\nf 1 2 3\nv 1 0 0\nv 0 1 0\nf -1 -2 -3\n").expect("a mesh");
    assert_eq!(faces(&mesh), [[0, 1, 2], [2, 1, 0]]);
}

#[test]
fn negative_indices_count_from_where_they_stand() {
    let mut text = String::new();
    // more than one piece of the file
    for index in 0..40_000 {
        text += &format!("v {index} 0 0\nv 0 {index} 0\nv 0 0 {index}\nf -3 -2 -1\n");
    }
    let mesh = obj(text).expect("a mesh");
    check(&mesh);
    assert_eq!(mesh.faces.len(), 40_000);
    for face in 0..40_000 {
        let first = 3 * face as u32;
        assert_eq!(mesh.faces.corners(face), [first, first + 1, first + 2]);
    }
}

#[test]
fn groups_and_objects_become_parts() {
    let mesh = obj(format!(
        "{VERTICES}f 1 2 3\no car\nf 1 2 3\ng wheel front # round\nf 1 2 3\nf 2 3 4\ng\nf 1 2 3\ng unused\n\
         g w\\\nheel\nf 1 2 3\ng w heel\nf 1 2 3\no\ng \u{fc}\nf 1 2 3\ng\no bus#1\nf 1 2 3\n"
    ))
    .expect("a mesh");
    check(&mesh);
    let named: Vec<(Option<&str>, u64, u64)> =
        mesh.parts.iter().map(|part| (part.group.as_deref(), part.first_face, part.faces)).collect();
    assert_eq!(
        named,
        [
            (None, 0, 1),
            (Some("car"), 1, 1),
            (Some("car/wheel front"), 2, 2),
            (Some("car"), 4, 1),
            (Some("car/w heel"), 5, 2),
            (Some("\u{fc}"), 7, 1),
            (Some("bus#1"), 8, 1),
        ]
    );
    let one = obj(format!("{VERTICES}f 1 2 3\nf 2 3 4")).expect("a mesh");
    let whole = Part { faces: 2, ..Part::default() };
    assert_eq!(one.parts, [whole]);
}

#[test]
fn long_names_are_cut_so_that_parts_stay_small() {
    let name = "\u{e4}".repeat(100_000);
    let mut text = format!("{VERTICES}o {name}\n");
    for face in 0..1000 {
        text += &format!("g {face}\nf 1 2 3\n");
    }
    let mesh = obj(text).expect("a mesh");
    assert_eq!(mesh.parts.len(), 1000);
    let longest = mesh.parts.iter().filter_map(|part| part.group.as_ref()).map(|name| name.len()).max();
    assert!(longest.is_some_and(|longest| longest < 600), "{longest:?}");
}

#[test]
fn what_is_no_face_is_skipped_with_a_warning() {
    let mesh =
        obj(format!("{VERTICES}l 1 2\np 1 2\nl 1 2 3\ncurv 0 1 1 2\nsurf 0 1 0 1 \\\n1 2\nf 1 2 3\n")).expect("a mesh");
    assert_eq!(mesh.faces.len(), 1);
    assert_eq!(mesh.warnings.len(), 2);
    assert!(mesh.warnings[0].ends_with(": 3") && mesh.warnings[0].contains("line"), "{:?}", mesh.warnings);
    assert!(mesh.warnings[1].ends_with(": 2") && mesh.warnings[1].contains("curves"), "{:?}", mesh.warnings);
    assert!(obj("v 0 0 0\nv 1 0 0\nl 1 2").is_err());
}

#[test]
fn errors_name_the_line_and_the_vertex_or_face() {
    for (text, expected) in [
        ("v 0 0 0\nv 1 0\n", "line 2: vertex 2: three coordinates are needed, there are 2"),
        ("v 0 0 0\n\n# c\nv\n", "line 4: vertex 2: three coordinates are needed, there are 0"),
        ("v 0 0 zero\n", "line 1: vertex 1: a coordinate is not a number: \"zero\""),
        (
            "v 0 0 1,5\n",
            "line 1: vertex 1: a coordinate is not a number, in which a point stands before the decimals: \"1,5\"",
        ),
        ("v 0 1e 1\n", "line 1: vertex 1: a coordinate is not a number: \"1e\""),
        ("v 0 0 -NaN\n", "line 1: vertex 1: a coordinate is not finite: \"-NaN\""),
        ("v 0 inf 0\n", "line 1: vertex 1: a coordinate is not finite: \"inf\""),
        ("v 0 1e400 0\n", "line 1: vertex 1: a coordinate is not finite: \"1e400\""),
        (
            "f 1 2 3\n",
            "line 1: face 1: there is no such vertex, the file has 0; add its v line, or correct the index: 1",
        ),
        (
            "v 0 0 0\nf 1 1 1\nf 1 1 2\n",
            "line 3: face 2: there is no such vertex, the file has 1; add its v line, or correct the index: 2",
        ),
        ("v 0 0 0\nf 1 1 99999999999\n", "line 2: face 1: there is no such vertex: \"99999999999\""),
        ("v 0 0 0\nf 1 1 -2\n", "line 2: face 1: a negative index goes back beyond the first vertex by: 1"),
        ("v 0 0 0\nf 0 1 1\n", "line 2: face 1: vertex indices count from 1 (or from -1 backwards): \"0\""),
        ("v 0 0 0\nf 1 1\n", "line 2: face 1: at least 3 corners are needed, there are 2"),
        ("v 0 0 0\nf\n", "line 2: face 1: at least 3 corners are needed, there are 0"),
        ("v 0 0 0\nf 1 a 1\n", "line 2: face 1: a corner is not of the form v, v/vt, v//vn or v/vt/vn: \"a\""),
        (
            "v 0 0 0\nf 1 1/2/3/4 1\n",
            "line 2: face 1: a corner is not of the form v, v/vt, v//vn or v/vt/vn: \"1/2/3/4\"",
        ),
        ("v 0 0 0\nf 1 1.0 1\n", "line 2: face 1: a corner is not of the form v, v/vt, v//vn or v/vt/vn: \"1.0\""),
        ("v 0 0 0\nf /1 1 1\n", "line 2: face 1: a corner is not of the form v, v/vt, v//vn or v/vt/vn: \"/1\""),
        (
            "v 0 \\\n0 \\\r\n0\nf 1 \\\n1 1\nf 1 1 \\\n5\n",
            "line 6: face 2: there is no such vertex, the file has 1; add its v line, or correct the index: 5",
        ),
        ("v 0 0 0\r\rv 0 0\r", "line 3: vertex 2: three coordinates are needed, there are 2"),
    ] {
        assert_eq!(message(text), expected, "{text:?}");
    }
}

#[test]
fn errors_in_later_pieces_of_a_large_file_name_the_right_line() {
    let many = "v 0 0 0\nf 1 \\\n 1 -1\n".repeat(50_000);
    for (bad, what) in [
        ("v 0 0 x", "vertex 50001: a coordinate"),
        ("f 1 1 -50001", "face 50001: a negative index"),
        ("f 1 1 50001", "face 50001: there is no such vertex"),
        ("f 1 1", "face 50001: at least 3"),
    ] {
        let text = format!("{many}{bad}\n{}", many.replace("v 0 0 0", "v"));
        let text = text.replace("v\nf", "#\nf");
        assert!(message(&text).starts_with(&format!("line 150001: {what}")), "{}", message(&text));
    }
}

#[test]
fn a_file_without_faces_is_refused() {
    for text in ["", "\n", "v 0 0 0\n", "# nothing\n", "hello\nworld\n"] {
        message(text);
    }
    assert!(message("v 0 0 0\n").contains("no faces"));
}

#[test]
fn limits_hold() {
    let text = format!("{VERTICES}f 1 2 3\nf 2 3 4\n");
    let read = |max_bytes, max_faces| {
        let limits = Limits { max_bytes, max_faces, ..Limits::default() };
        mesh::read(text.as_bytes(), Format::Obj, &NoResources, &limits)
    };
    let length = text.len() as u64;
    assert!(read(length, 2).is_ok());
    assert_eq!(read(length - 1, 2).expect_err("bytes").kind, Kind::TooLarge);
    assert_eq!(read(length, 1).expect_err("faces").kind, Kind::TooLarge);
}

proptest! {
    /// What is written is read, however it is written.
    #[test]
    fn written_meshes_are_read_back(
        positions in prop::collection::vec(prop::array::uniform3(-1e9f64..1e9), 1..50),
        polygons in prop::collection::vec(prop::collection::vec(0usize..1000, 3..7), 1..60),
        style in 0usize..4, ends in prop::sample::select(vec!["\n", "\r\n", " \\\n\n", " # x\n"]),
    ) {
        let mut text = String::new();
        for [x, y, z] in &positions {
            text += &match style {
                0 => format!("v {x} {y} {z}{ends}"),
                1 => format!("v\t{x:e} {y:e}  {z:e} 1 0.5 0{ends}"),
                _ => format!("v {x:+} {y:+} {z:+} 1.0{ends}"),
            };
        }
        let count = positions.len();
        let mut expected = Vec::new();
        for polygon in &polygons {
            let corners: Vec<u32> = polygon.iter().map(|&v| (v % count) as u32).collect();
            text += "f";
            for &corner in &corners {
                text += &match style {
                    0 => format!(" {}", corner + 1),
                    1 => format!(" {}//7", corner + 1),
                    2 => format!("  -{}/1/1", count - corner as usize),
                    _ => format!(" \\\n{}/3", corner + 1),
                };
            }
            text += ends;
            expected.push(corners);
        }
        let mesh = obj(&text).expect("a mesh");
        check(&mesh);
        prop_assert_eq!(&mesh.positions, &positions);
        prop_assert_eq!(faces(&mesh), expected);
    }
}
