//! Small meshes made on the spot, and short ways to read them.

use std::time::{Duration, Instant};

use base64::Engine;
use serde_json::{Value, json};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, PolygonMesh};
use tesserae_mesh::{Error, Kind, Result};

/// Reads an OBJ file.
pub fn obj(text: impl AsRef<[u8]>) -> Result<PolygonMesh> {
    mesh::read(text.as_ref(), Format::Obj, &NoResources, &Limits::default())
}

/// Reads a document with its binary chunk as GLB, and, to see that both give the same, as JSON with data URIs.
pub fn gltf(document: &Value, binary: &[u8]) -> Result<PolygonMesh> {
    let from_glb = read_glb(&glb(document, binary));
    let mut document = document.clone();
    if let Some(first) = document["buffers"].get_mut(0)
        && first.get("uri").is_none()
    {
        first["uri"] = Value::String(data_uri(binary));
    }
    let text = document.to_string();
    let from_json = mesh::read(text.as_bytes(), Format::Gltf, &NoResources, &Limits::default());
    match (&from_glb, &from_json) {
        (Ok(one), Ok(other)) => {
            assert_eq!(one.positions, other.positions);
            assert_eq!(one.faces, other.faces);
            assert_eq!(one.parts, other.parts);
        }
        (Err(one), Err(other)) => assert_eq!(one.kind, other.kind, "{one} / {other}"),
        (one, other) => panic!("GLB and JSON differ: {one:?} {other:?}"),
    }
    from_glb
}

/// Reads a GLB file.
pub fn read_glb(bytes: &[u8]) -> Result<PolygonMesh> {
    mesh::read(bytes, Format::Glb, &NoResources, &Limits::default())
}

/// The error of a document that is refused.
pub fn refused(document: &Value, binary: &[u8]) -> Error {
    gltf(document, binary).expect_err("refused")
}

/// A GLB file.
pub fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = binary.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    let mut length = 12 + 8 + json.len();
    if !bin.is_empty() {
        length += 8 + bin.len();
    }
    bytes.extend((length as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &bin)] {
        if !chunk.is_empty() {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
    }
    bytes
}

/// A data URI of some bytes.
pub fn data_uri(bytes: &[u8]) -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:application/octet-stream;base64,{data}")
}

/// Bytes of little-endian numbers.
pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Bytes of little-endian numbers.
pub fn shorts(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A unit square of four vertices and two triangles: positions (48 bytes), then u16 indices (12 bytes).
pub fn square() -> (Value, Vec<u8>) {
    let mut binary = floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]);
    binary.extend(shorts(&[0, 1, 2, 0, 2, 3]));
    let document = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "square"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 60}],
    });
    (document, binary)
}

/// Positions of the unit square.
pub const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

/// The faces as lists of corners.
pub fn faces(mesh: &PolygonMesh) -> Vec<&[u32]> {
    (0..mesh.faces.len()).map(|face| mesh.faces.corners(face)).collect()
}

/// The corners' positions, face by face.
pub fn triangles(mesh: &PolygonMesh) -> Vec<Vec<[f64; 3]>> {
    let corners = |face: &[u32]| face.iter().map(|&v| mesh.positions[v as usize]).collect();
    faces(mesh).into_iter().map(corners).collect()
}

/// Checks what must hold of every mesh that is read.
pub fn check(mesh: &PolygonMesh) {
    assert!(!mesh.faces.is_empty());
    let vertices = mesh.positions.len();
    assert!(mesh.faces.all_corners().iter().all(|&v| (v as usize) < vertices));
    assert!(mesh.positions.iter().flatten().all(|c| c.is_finite()));
    let mut next = 0;
    for part in &mesh.parts {
        assert_eq!(part.first_face, next);
        assert!(part.faces > 0);
        next += part.faces;
    }
    assert_eq!(next, mesh.faces.len() as u64);
}

/// Expects a document to be refused, quickly, with an error that contains some words.
#[track_caller]
pub fn expect_document(document: &Value, binary: &[u8], words: &[&str]) {
    let start = Instant::now();
    let error = refused(document, binary);
    assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
    assert!(matches!(error.kind, Kind::InvalidMesh | Kind::UnsupportedMesh | Kind::TooLarge), "{error:?}");
    for word in words {
        assert!(error.message.contains(word), "{word:?} is not in: {error}");
    }
}

/// A document with one mesh of one primitive, whose positions are f32 and whose indices are u16, in that order.
pub fn document(vertices: usize, indices: usize, mode: u32) -> Value {
    let (mut document, _) = square();
    let (positions, bytes) = (12 * vertices, 2 * indices);
    document["accessors"][0]["count"] = json!(vertices);
    document["accessors"][1]["count"] = json!(indices);
    document["bufferViews"][0]["byteLength"] = json!(positions);
    document["bufferViews"][1]["byteOffset"] = json!(positions);
    document["bufferViews"][1]["byteLength"] = json!(bytes);
    document["buffers"][0]["byteLength"] = json!(positions + bytes);
    document["meshes"][0]["primitives"][0]["mode"] = json!(mode);
    document
}

/// Changes the value at a JSON pointer of the square and expects an error that contains some words.
#[track_caller]
pub fn expect(pointer: &str, value: Value, words: &[&str]) {
    let (mut document, binary) = square();
    set(&mut document, pointer, value);
    expect_document(&document, &binary, words);
}

fn set(document: &mut Value, pointer: &str, value: Value) {
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
    document.pointer_mut(parent).expect("a parent")[key] = value;
}
