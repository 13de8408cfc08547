//! The exact message of every kind of malformed input, in `messages.txt`, to be read as a user would.
//!
//! `UPDATE_MESSAGES=1 cargo test --test mesh_input messages` writes the file anew.

use serde_json::{Value, json};
use tesserae::mesh::{self, Format, Limits, NoResources};

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
        ("binary STL", "part.stl", binary_stl()),
        ("binary STL called OBJ", "part.obj", binary_stl()),
        ("text STL", "part.stl", b"solid part\nfacet normal 0 0 1\n".to_vec()),
        ("PLY", "scan.ply", b"ply\nformat ascii 1.0\n".to_vec()),
        ("OFF", "shape.off", b"OFF\n8 6 12\n".to_vec()),
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

#[test]
fn messages_are_those_of_the_table() {
    let inputs = [containers(), documents(), texts()].concat();
    assert!(inputs.len() >= 60, "{}", inputs.len());
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
