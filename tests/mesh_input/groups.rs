//! Groups of faces: of an OBJ by object, group and material, of a glTF by primitive.

use serde_json::json;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, Source};

use crate::make::{glb, square};

fn groups(bytes: &[u8], format: Format) -> Vec<u32> {
    let limits = Limits::default();
    let source = Source { groups: true, ..Source::new(bytes, format, &NoResources, &limits) };
    let read = mesh::open(source, |opened| opened.read()).flatten().expect("a mesh");
    let groups = read.groups.expect("groups");
    assert_eq!(groups.len(), read.mesh.faces.len());
    groups
}

#[test]
fn faces_of_an_obj_are_grouped_by_object_group_and_material() {
    let face = "f 1 2 3\n";
    let of = |statements: &[&str]| {
        let faces: String = statements.iter().map(|statement| format!("{statement}\n{face}")).collect();
        groups(format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}").as_bytes(), Format::Obj)
    };
    assert_eq!(of(&["", ""]), [0, 0]);
    assert_eq!(of(&["g a", "g b", "g a", "o x", "usemtl m", "usemtl m"]), [0, 1, 0, 2, 3, 3]);
    // one name is not another kind's, and names that no face carries do not count
    assert_eq!(of(&["o a", "o\ng a", "g\nusemtl a", "usemtl b\nusemtl a", "usemtl"]), [0, 1, 2, 2, 3]);
    // blanks around names and ends of lines; a backslash joins lines of groups, but none to materials
    assert_eq!(of(&["usemtl a", " usemtl\ta \r", "usemtl b\\", "usemtl a b"]), [0, 0, 1, 2]);
    assert_eq!(of(&["usemtl", "usemtlx a", "#usemtl a", "g # a"]), [0, 0, 0, 0]);
}

#[test]
fn groups_of_an_obj_do_not_depend_on_where_it_is_cut() {
    let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned();
    let mut expected = Vec::new();
    for run in 0..3000 {
        text += &format!("usemtl material-of-this-run-{}\n", run % 7);
        (0..run % 13).for_each(|_| text += "f 1 2 3 # a comment to make the file longer\n");
        expected.extend(std::iter::repeat_n(run % 7, run % 13));
    }
    assert!(text.len() > 3 * (256 << 10), "several pieces");
    let found = groups(text.as_bytes(), Format::Obj);
    let mut number = std::collections::BTreeMap::new();
    let pairs = found.iter().zip(&expected);
    assert!(pairs.into_iter().all(|(&found, expected)| *number.entry(expected).or_insert(found) == found));
    assert_eq!((number.len(), found.len()), (7, expected.len()));
}

#[test]
fn faces_of_a_gltf_are_grouped_by_primitive_wherever_it_is_placed() {
    let (mut document, binary) = square();
    let first = document["meshes"][0]["primitives"][0].clone();
    document["meshes"][0]["primitives"] = json!([first, first]);
    let mesh = document["meshes"][0].clone();
    document["meshes"] = json!([mesh, mesh]);
    document["scenes"][0]["nodes"] = json!([0, 1, 2]);
    document["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}, {"mesh": 1}]);
    // two triangles each
    let expected = [0, 1, 0, 1, 2, 3].map(|group| [group; 2]);
    assert_eq!(groups(&glb(&document, &binary), Format::Glb), expected.as_flattened());
}
