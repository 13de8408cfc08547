//! glTF: small files that would be large, and large ones that are not; claims that cost nothing.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};

use crate::make::{SQUARE, check, document, floats, glb, gltf, read_glb, refused, shorts, square, triangles};

#[test]
fn small_files_that_place_very_much() {
    // a million instances of a million primitives
    let (mut document, mut binary) = square();
    binary.extend(vec![0; 1_000_000]);
    document["buffers"][0]["byteLength"] = json!(binary.len());
    document["bufferViews"]
        .as_array_mut()
        .expect("views")
        .push(json!({"buffer": 0, "byteOffset": 60, "byteLength": 1_000_000}));
    document["accessors"]
        .as_array_mut()
        .expect("accessors")
        .push(json!({"bufferView": 2, "componentType": 5121, "count": 1_000_000, "type": "SCALAR"}));
    document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"_ID": 2}}});
    let primitive = document["meshes"][0]["primitives"][0].clone();
    document["meshes"][0]["primitives"] = Value::Array(vec![primitive; 1000]);
    let error = refused(&document, &binary);
    assert_eq!(error.kind, Kind::TooLarge);
    assert!(error.message.contains("faces"), "{error}");
    // one triangle of an accessor of many vertices, placed often: vertices follow the triangles
    let vertices = 100_000usize;
    let mut binary = floats(&vec![1.5; 3 * vertices]);
    binary.extend(shorts(&[0, 1, 2]));
    let (mut document, _) = square();
    document["accessors"][0]["count"] = json!(vertices);
    document["accessors"][1]["count"] = json!(3);
    document["bufferViews"] = json!([
        {"buffer": 0, "byteLength": 12 * vertices},
        {"buffer": 0, "byteOffset": 12 * vertices, "byteLength": 6},
    ]);
    document["buffers"][0]["byteLength"] = json!(binary.len());
    document["nodes"] = (0..20_001)
        .map(|node| match node {
            0 => json!({"children": (1..20_001).collect::<Vec<_>>()}),
            _ => json!({"mesh": 0}),
        })
        .collect();
    let start = Instant::now();
    let mesh = read_glb(&glb(&document, &binary)).expect("a mesh");
    assert_eq!(mesh.faces.len(), 20_000);
    assert!(mesh.positions.len() < 300_000, "{}", mesh.positions.len());
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn sparse_accessors_that_share_their_values_over_and_over() {
    let count = 200_000u32;
    let mut binary = floats(&vec![0.5; 3 * count as usize]);
    binary.extend((0..count).flat_map(u32::to_le_bytes));
    let accessor = json!({
        "componentType": 5126, "count": count, "type": "VEC3",
        "sparse": {"count": count, "indices": {"bufferView": 1, "componentType": 5125}, "values": {"bufferView": 0}},
    });
    let document = json!({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "accessors": vec![accessor; 1000],
        "meshes": [{"primitives": (0..1000).map(|p| json!({"attributes": {"POSITION": p}})).collect::<Vec<_>>()}],
        "bufferViews": [{"buffer": 0, "byteLength": 12 * count},
                        {"buffer": 0, "byteOffset": 12 * count, "byteLength": 4 * count}],
        "buffers": [{"byteLength": 16 * count}],
    });
    let start = Instant::now();
    let error = read_glb(&glb(&document, &binary)).expect_err("too much");
    assert_eq!(error.kind, Kind::TooLarge);
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn json_of_nothing_but_nodes() {
    let text = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}{{}}]}}", "{},".repeat(5_000_000));
    let error = mesh::read(text.as_bytes(), Format::Gltf, &NoResources, &Limits::default()).expect_err("too much");
    assert_eq!(error.kind, Kind::TooLarge);
}

#[test]
fn containers_that_lie_about_their_length() {
    let (document, binary) = square();
    let sound = glb(&document, &binary);
    assert!(read_glb(&sound).is_ok());
    let json = u32::from_le_bytes([sound[12], sound[13], sound[14], sound[15]]) as usize;
    let total = sound.len() as u32;
    for (at, value, words) in [
        (8, total - 1, "longer than its header says"),
        (8, total + 1, "truncated"),
        (8, 0, "longer than its header says"),
        (8, u32::MAX, "truncated"),
        (4, 1, "glTF 1.0"),
        (4, 3, "version"),
        (12, json as u32 + 100_000, "chunk 0"),
        (12, u32::MAX, "chunk 0"),
        (16, 0x0042_4942, "JSON"),
        (20 + json, 61, "chunk 1"),
        (20 + json, u32::MAX, "chunk 1"),
        (20 + json, 56, "chunk 2"),
        (20 + json, 52, "chunk 2"),
    ] {
        let mut bytes = sound.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let start = Instant::now();
        let error = read_glb(&bytes).expect_err("refused");
        assert!(error.message.contains(words), "{at} {value}: {error}");
        assert!(start.elapsed() < Duration::from_secs(1));
        // what the head shows is seen before the rest is there
        if at < 20 {
            let head = Format::Glb.check_head(&bytes[..24], Some(bytes.len() as u64));
            assert_eq!(head.expect_err("refused").kind, error.kind);
        }
    }
    assert_eq!(Format::Glb.check_head(&sound[..24], Some(sound.len() as u64)), Ok(()));
    assert!(Format::Glb.check_head(&sound[..24], None).is_ok());
    let mut longer = sound.clone();
    longer.push(0);
    assert!(read_glb(&longer).is_err());
    // an unknown chunk between the others is passed over
    let mut extended = sound[..20 + json].to_vec();
    extended.extend(b"\x04\0\0\0ABCDwxyz");
    extended.extend(&sound[20 + json..]);
    let length = (extended.len() as u32).to_le_bytes();
    extended[8..12].copy_from_slice(&length);
    assert_eq!(read_glb(&extended), read_glb(&sound));
}

#[test]
fn a_chain_of_a_hundred_thousand_nodes() {
    let (mut document, binary) = square();
    let mut nodes: Vec<Value> = (1..100_000).map(|child| json!({"children": [child]})).collect();
    nodes.push(json!({"mesh": 0}));
    document["nodes"] = Value::Array(nodes);
    assert_eq!(gltf(&document, &binary).expect("a mesh").positions, SQUARE);
}

#[test]
fn shared_accessors_are_placed_in_proportion() {
    // a large accessor of which every primitive uses three vertices
    let vertices = 300_000;
    let mut binary: Vec<u8> = (0..vertices).flat_map(|v| floats(&[v as f32, (v % 7) as f32, 0.0])).collect();
    let indices: Vec<u16> = (0..3000).map(|i| i * 20).collect();
    binary.extend(shorts(&indices));
    let mut document = document(vertices, indices.len(), 4);
    let view = binary.len() - 6000;
    let accessors: Vec<Value> = std::iter::once(document["accessors"][0].clone())
        .chain((0..1000).map(
            |p| json!({"bufferView": 1, "byteOffset": 6 * p, "componentType": 5123, "count": 3, "type": "SCALAR"}),
        ))
        .collect();
    assert_eq!(document["bufferViews"][1]["byteOffset"], json!(view));
    document["accessors"] = Value::Array(accessors);
    let primitives: Vec<Value> = (1..=1000).map(|p| json!({"attributes": {"POSITION": 0}, "indices": p})).collect();
    document["meshes"][0]["primitives"] = Value::Array(primitives);
    let mesh = read_glb(&glb(&document, &binary)).expect("a mesh");
    check(&mesh);
    assert_eq!(mesh.faces.len(), 1000);
    assert!(mesh.positions.len() <= vertices + (1 << 16) + 3000, "{}", mesh.positions.len());
    for (index, triangle) in triangles(&mesh).iter().enumerate() {
        for (corner, position) in triangle.iter().enumerate() {
            assert_eq!(position[0], f64::from(indices[3 * index + corner]));
        }
    }
}
