//! The exact message of every kind of malformed input, in `messages.txt`, to be read as a user would.
//!
//! `UPDATE_MESSAGES=1 cargo test --test mesh_input messages` writes the file anew.

use serde_json::{Value, json};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};

use crate::make::{glb, square};

/// A file: what is wrong with it, what it is called, its bytes.
type Input = (&'static str, &'static str, Vec<u8>);

/// The square as JSON without its bytes, changed at a JSON pointer; a key that is missing is added.
fn changed(pointer: &str, value: Value) -> Vec<u8> {
    let (mut document, binary) = square();
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
    let parent = document.pointer_mut(parent).expect("a parent");
    match (parent, key.parse::<usize>()) {
        (Value::Array(array), Ok(at)) => array[at] = value,
        (parent, _) => parent[key] = value,
    }
    glb(&document, &binary)
}

/// The square with a view that is compressed by meshopt.
fn compressed(change: Value) -> Vec<u8> {
    let (mut document, binary) = square();
    let mut compression = json!({"buffer": 0, "byteLength": 48, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES"});
    for (key, value) in change.as_object().expect("an object") {
        compression[key] = value.clone();
    }
    document["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": compression});
    glb(&document, &binary)
}

fn binary_stl() -> Vec<u8> {
    let mut bytes = b"solid from a CAD program".to_vec();
    bytes.resize(80, 0);
    bytes.extend(1u32.to_le_bytes());
    bytes.extend([0.0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend([0, 0]);
    bytes
}

fn containers() -> Vec<Input> {
    let (document, binary) = square();
    let sound = glb(&document, &binary);
    let with = |at: usize, word: u32| {
        let mut bytes = sound.clone();
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        bytes
    };
    vec![
        ("an empty file without a type", "mesh", Vec::new()),
        ("an empty OBJ file", "mesh.obj", Vec::new()),
        ("an empty GLB file", "mesh.glb", Vec::new()),
        ("an empty PLY file", "mesh.ply", Vec::new()),
        ("an empty STL file", "mesh.stl", Vec::new()),
        ("binary STL called OBJ", "part.obj", binary_stl()),
        ("binary STL called PLY", "part.ply", binary_stl()),
        ("PLY called OBJ", "scan.obj", b"ply\nformat ascii 1.0\n".to_vec()),
        ("PLY called STL", "scan.stl", b"ply\nformat ascii 1.0\n".to_vec()),
        ("OBJ called PLY", "mesh.ply", b"v 0 0 0\n".to_vec()),
        ("OBJ called STL", "mesh.stl", b"v 0 0 0\n".to_vec()),
        ("words called PLY", "mesh.ply", b"polygons\n".to_vec()),
        ("words called STL", "mesh.stl", b"polygons\n".to_vec()),
        ("bytes called STL", "mesh.stl", vec![0xff; 200]),
        ("an empty OFF file", "mesh.off", Vec::new()),
        ("OBJ called OFF", "mesh.off", b"v 0 0 0\n".to_vec()),
        ("words called OFF", "mesh.off", b"polygons\n".to_vec()),
        ("FBX", "scene.fbx", b"Kaydara FBX Binary  \0".to_vec()),
        ("3MF", "print.3mf", b"PK\x03\x04\x14\0......3D/3dmodel.model".to_vec()),
        ("ZIP", "mesh.zip", b"PK\x03\x04\x14\0......mesh.obj".to_vec()),
        ("gzip", "mesh.obj.gz", b"\x1f\x8b\x08\0".to_vec()),
        ("an image", "texture.png", b"\x89PNG\r\n\x1a\n".to_vec()),
        ("a web page called GLB", "mesh.glb", b"<!DOCTYPE html><html>".to_vec()),
        ("COLLADA", "scene.dae", b"<?xml version=\"1.0\"?>\n<COLLADA>".to_vec()),
        ("a pointer of Git LFS", "mesh.glb", b"version https://git-lfs.github.com/spec/v1\n".to_vec()),
        ("UTF-16", "mesh.obj", b"\xff\xfev\0 \x000\0".to_vec()),
        ("bytes of no known kind", "mesh.bin", b"\x01\x02\x03\x04".to_vec()),
        ("GLB called OBJ", "mesh.obj", sound.clone()),
        ("GLB called glTF", "mesh.gltf", sound.clone()),
        ("JSON called OBJ", "mesh.obj", b"{\"asset\": {}}".to_vec()),
        ("JSON called GLB", "mesh.glb", b"{\"asset\": {}}".to_vec()),
        ("OBJ called glTF", "mesh.gltf", b"v 0 0 0\n".to_vec()),
        ("GLB cut off", "mesh.glb", sound[..sound.len() - 8].to_vec()),
        ("GLB cut off in its header", "mesh.glb", sound[..9].to_vec()),
        ("GLB of version 1", "mesh.glb", with(4, 1)),
        ("GLB of version 3", "mesh.glb", with(4, 3)),
        ("GLB whose first chunk is no JSON", "mesh.glb", with(16, 0x0042_4942)),
        ("GLB whose chunk is too long", "mesh.glb", with(12, 1 << 20)),
    ]
}

fn documents() -> Vec<Input> {
    let text = |text: &str| text.as_bytes().to_vec();
    let json = |value: Value| value.to_string().into_bytes();
    vec![
        ("JSON cut off", "mesh.gltf", text("{\"asset\": {\"version\": \"2.0\"}, \"nodes\": [")),
        ("JSON with a comma too many", "mesh.gltf", text("{\"asset\": {\"version\": \"2.0\",}}")),
        ("JSON that is no glTF", "mesh.gltf", json(json!({"type": "FeatureCollection"}))),
        ("glTF 1.0", "mesh.gltf", json(json!({"asset": {"version": "1.0"}, "meshes": {"m": {}}}))),
        ("glTF 1.0 without asset", "mesh.gltf", json(json!({"meshes": {"m": {}}}))),
        ("glTF 3.0", "mesh.gltf", json(json!({"asset": {"version": "3.0"}}))),
        ("asset is a string", "mesh.gltf", json(json!({"asset": "2.0"}))),
        ("asset without version", "mesh.gltf", json(json!({"asset": {"generator": "x"}}))),
        ("version is a number", "mesh.gltf", json(json!({"asset": {"version": 2.0}}))),
        ("version is empty", "mesh.gltf", json(json!({"asset": {"version": ""}}))),
        ("glTF without meshes", "mesh.gltf", json(json!({"asset": {"version": "2.0"}}))),
        ("the scene places nothing", "mesh.glb", changed("/scenes/0/nodes", json!([]))),
        ("a mesh without primitives", "mesh.glb", changed("/meshes/0/primitives", json!([]))),
        ("lines only", "mesh.glb", changed("/meshes/0/primitives/0/mode", json!(1))),
        ("no POSITION", "mesh.glb", changed("/meshes/0/primitives/0/attributes", json!({"NORMAL": 0}))),
        ("two indices", "mesh.glb", changed("/accessors/1/count", json!(2))),
        ("a negative index of a mesh", "mesh.glb", changed("/nodes/0/mesh", json!(-1))),
        ("nodes is an object", "mesh.glb", changed("/nodes", json!({}))),
        ("a mesh that is not there", "mesh.glb", changed("/nodes/0/mesh", json!(3))),
        ("a node that is its own child", "mesh.glb", changed("/nodes/0/children", json!([0]))),
        ("a rotation of length 0", "mesh.glb", changed("/nodes/0/rotation", json!([0, 0, 0, 0]))),
        ("a matrix that is not affine", "mesh.glb", changed("/nodes/0/matrix", json!(vec![1; 16]))),
        ("an accessor of too many elements", "mesh.glb", changed("/accessors/0/count", json!(5))),
        ("an unknown component type", "mesh.glb", changed("/accessors/0/componentType", json!(5130))),
        ("positions of two components", "mesh.glb", changed("/accessors/0/type", json!("VEC2"))),
        ("a view beyond its buffer", "mesh.glb", changed("/bufferViews/1/byteLength", json!(100))),
        ("a buffer that is too short", "mesh.glb", changed("/buffers/0/byteLength", json!(1000))),
        ("a buffer in another file", "mesh.glb", changed("/buffers/0/uri", json!("mesh.bin"))),
        ("a buffer outside the folder", "mesh.glb", changed("/buffers/0/uri", json!("../mesh.bin"))),
        ("a buffer on the web", "mesh.glb", changed("/buffers/0/uri", json!("https://example.com/mesh.bin"))),
        ("a buffer with an empty name", "mesh.glb", changed("/buffers/0/uri", json!(""))),
        ("a data URI that is no base64", "mesh.glb", changed("/buffers/0/uri", json!("data:;base64,@@@@"))),
        ("Draco", "mesh.glb", changed("/extensionsRequired", json!(["KHR_draco_mesh_compression"]))),
        ("an unknown extension", "mesh.glb", changed("/extensionsRequired", json!(["ACME_\u{1b}[31m_geometry\n"]))),
        ("meshopt with a wrong stride", "mesh.glb", compressed(json!({"byteStride": 7}))),
        ("meshopt with a wrong count", "mesh.glb", compressed(json!({"mode": "TRIANGLES", "byteStride": 2}))),
        (
            "meshopt with a filter of indices",
            "mesh.glb",
            compressed(json!({
                "mode": "INDICES", "byteStride": 2, "filter": "OCTAHEDRAL",
            })),
        ),
        ("meshopt with a filter of another stride", "mesh.glb", compressed(json!({"filter": "QUATERNION"}))),
        ("meshopt that is damaged", "mesh.glb", compressed(json!({}))),
        ("meshopt with an unknown mode", "mesh.glb", compressed(json!({"mode": "PLANES"}))),
        ("meshopt with a count beyond its bytes", "mesh.glb", compressed(json!({"count": 1_000_000}))),
    ]
}

fn texts() -> Vec<Input> {
    [
        ("OBJ of vertices", "v 0 0 0\nv 1 0 0\n"),
        ("OBJ of lines", "v 0 0 0\nv 1 0 0\nl 1 2\n"),
        ("OBJ of curves", "v 0 0 0\ncurv 0 1 1 1\n"),
        ("OBJ of other text", "hello\nworld\n"),
        ("a vertex of two coordinates", "v 0 0\n"),
        ("a coordinate with a comma", "v 0 0 1,5\n"),
        ("a coordinate that is not finite", "v 0 0 nan\n"),
        ("a face of two corners", "v 0 0 0\nf 1 1\n"),
        ("a face of no vertex", "v 0 0 0\nf 1 1 2\n"),
        ("a face from vertex 0", "v 0 0 0\nf 0 1 1\n"),
        ("a face back beyond the first vertex", "v 0 0 0\nf -1 -1 -2\n"),
        ("a corner of letters", "v 0 0 0\nf 1 1 a\u{202e}b\n"),
    ]
    .into_iter()
    .map(|(what, text)| (what, "mesh.obj", text.as_bytes().to_vec()))
    .collect()
}

/// PLY files whose header is not sound, and sound headers with other rows.
fn ply_files() -> Vec<Input> {
    const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";
    const LIST: &str = "property list uchar int vertex_indices\n";
    let sound = format!("element vertex 3\n{XYZ}element face 1\n{LIST}");
    let ply = |what, format: &str, header: &str, rows: &[u8]| {
        let header = format!("ply\nformat {format} 1.0\n{header}end_header\n");
        (what, "mesh.ply", [header.as_bytes(), rows].concat())
    };
    let text = |what, rows: &str| ply(what, "ascii", &sound, rows.as_bytes());
    let header = |what, from: &str, to: &str| ply(what, "ascii", &sound.replace(from, to), &b"0 0 0\n".repeat(9));
    let bytes = |what, changes: &[(usize, &[u8])]| {
        let mut rows: Vec<u8> = [0.0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
        rows.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
        for (at, bytes) in changes {
            rows[*at..at + bytes.len()].copy_from_slice(bytes);
        }
        ply(what, "binary_little_endian", &sound, &rows)
    };
    let (_, name, mut cut) = bytes("", &[]);
    cut.pop();
    vec![
        ("PLY of one line", "mesh.ply", b"ply\n".to_vec()),
        ("PLY without a format", "mesh.ply", b"ply\nelement vertex 3\nend_header\n".to_vec()),
        ("PLY of an unknown format", "mesh.ply", b"ply\nformat binary 1.0\n".to_vec()),
        ("PLY of version 2", "mesh.ply", b"ply\nformat ascii 2.0\n".to_vec()),
        header("PLY with an unknown line", "element face", "elements face"),
        header("PLY with an unknown type", "float z", "half z"),
        header("PLY with a broken property", "float z", "float"),
        header("PLY with a negative number of rows", "face 1", "face -1"),
        header("PLY with lengths that are floats", "uchar int", "float int"),
        header("PLY with indices that are floats", "uchar int", "uchar float"),
        header("PLY without z", "float z", "float w"),
        header("PLY with two x", "float z", "float x"),
        header("PLY with lists of coordinates", "float z", "list uchar float z"),
        header("PLY without corners", "vertex_indices", "corners"),
        header("PLY without vertices", "vertex 3", "vertex 0"),
        ply("PLY with two elements vertex", "ascii", &sound.repeat(2), b""),
        ply("a point cloud", "ascii", &format!("element vertex 3\n{XYZ}"), &b"0 0 0\n".repeat(3)),
        header("PLY with too few lines", "face 1", "face 4000000000"),
        text("a PLY vertex of two coordinates", "0 0 0\n0 0\n0 1 0\n3 0 1 2\n"),
        text("a PLY vertex of four coordinates", "0 0 0\n1 0 0 1\n0 1 0\n3 0 1 2\n"),
        text("a PLY coordinate that is not finite", "0 0 0\n1 0 0\n0 1 inf\n3 0 1 2\n"),
        text("a PLY face of no vertex", "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n"),
        text("a PLY face of fractions", "0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n"),
        text("a PLY face of letters", "0 0 0\n1 0 0\n0 1 0\nthree 0 1 2\n"),
        text("text of PLY that is binary", "0 0 0\n1 0 0\n0 1 \0\n3 0 1 2\n"),
        ply("binary PLY that is text", "binary_big_endian", &sound, b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("binary PLY cut off", name, cut),
        bytes("binary PLY with a list that is too long", &[(36, &[255])]),
        bytes("binary PLY with a face of no vertex", &[(37, &[9])]),
        bytes("binary PLY in the other byte order", &[(37, &[0; 12]), (40, &[1])]),
        bytes("binary PLY with a coordinate that is not finite", &[(12, &f32::NAN.to_le_bytes())]),
    ]
}

/// STL files.
fn stl_files() -> Vec<Input> {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let text = |what, from: &str, to: &str| {
        (what, "part.stl", format!("solid part\n{}endsolid part\n", facet.replacen(from, to, 1)).into_bytes())
    };
    let mut not_finite = binary_stl();
    not_finite[84 + 12..84 + 16].copy_from_slice(&f32::INFINITY.to_le_bytes());
    vec![
        text("STL without facets", facet, ""),
        text("an STL facet of two vertices", "vertex 0 1 0\n", ""),
        text("an STL facet of four vertices", "vertex 0 1 0\n", "vertex 0 1 0\nvertex 0 2 0\n"),
        text("an STL vertex of two coordinates", "vertex 0 1 0", "vertex 0 1"),
        text("an STL coordinate with a comma", "vertex 0 1 0", "vertex 0 1,5 0"),
        text("an STL coordinate that is not finite", "vertex 0 1 0", "vertex 0 1 -NaN"),
        text("STL with an unknown word", "endfacet\n", "endfacet\ncolor 1 0 0\n"),
        ("STL that ends within a facet", "part.stl", format!("solid part\n{}", &facet[..60]).into_bytes()),
        ("binary STL cut off", "part.stl", binary_stl()[..120].to_vec()),
        ("binary STL with a coordinate that is not finite", "part.stl", not_finite),
    ]
}

/// OFF files.
fn off_files() -> Vec<Input> {
    let text = |what, header: &str, rows: &str| (what, "shape.off", format!("{header}\n{rows}").into_bytes());
    vec![
        text("OFF without rows", "OFF", "8 6 12\n"),
        text("binary OFF", "OFF BINARY", "\0\0\0\u{8}"),
        text("OFF with zero bytes", "OFF 3 1 0", "0 0 \0\n"),
        text("OFF of four dimensions", "4OFF", "3 1 0\n"),
        text("OFF without faces", "OFF 1 0 0", "0 0 0\n"),
        text("OFF without vertices", "OFF 0 1 0", "0\n"),
        text("OFF with a number of letters", "OFF", "many 1 0\n"),
        text("OFF with four numbers", "OFF 3 1 0 1", "0 0 0\n"),
        text("an OFF vertex of two coordinates", "OFF 1 1 0", "0 0\n3 0 0 0\n"),
        text("an OFF coordinate that is not finite", "OFF 1 1 0", "0 0 inf\n3 0 0 0\n"),
        text("an OFF face that ends early", "OFF 1 1 0", "0 0 0\n4 0 0 0\n"),
        text("an OFF face of no vertex", "OFF 1 1 0", "0 0 0\n3 0 0 1\n"),
        text("an OFF face of letters", "OFF 1 1 0", "0 0 0\n3 0 0 a\n"),
    ]
}

#[test]
fn messages_are_those_of_the_table() {
    let inputs = [containers(), documents(), texts(), ply_files(), stl_files(), off_files()].concat();
    assert!(inputs.len() >= 120, "{}", inputs.len());
    let mut table = String::new();
    for (what, name, bytes) in inputs {
        let read = Format::recognise(Some(name), &bytes, Some(bytes.len() as u64))
            .and_then(|format| mesh::read(&bytes, format, &NoResources, &Limits::default()));
        let error = read.expect_err(what);
        table += &format!("{what}\n    {}: {}\n", error.kind.slug(), error.message);
    }
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mesh_input/messages.txt");
    if std::env::var_os("UPDATE_MESSAGES").is_some() {
        std::fs::write(&path, &table).expect("written");
    }
    let known = std::fs::read_to_string(&path).expect("the table");
    for (line, known) in table.lines().zip(known.lines()) {
        assert_eq!(line, known);
    }
    assert_eq!(table, known);
}
