//! Small files that would take memory out of proportion to their bytes, and sound ones that look a little like them.

use std::sync::Arc;

use serde_json::{Value, json};
use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};

use crate::make::{check, document, floats, glb, obj, read_glb, refused, shorts, square};

/// The square at as many places as there are translations, by `EXT_mesh_gpu_instancing`.
fn instanced(places: usize) -> (Value, Vec<u8>) {
    let (mut document, mut binary) = square();
    binary.extend(floats(&(0..3 * places).map(|at| at as f32).collect::<Vec<_>>()));
    document["buffers"][0]["byteLength"] = json!(binary.len());
    let views = document["bufferViews"].as_array_mut().expect("views");
    views.push(json!({"buffer": 0, "byteOffset": 60, "byteLength": 12 * places}));
    let accessors = document["accessors"].as_array_mut().expect("accessors");
    accessors.push(json!({"bufferView": 2, "componentType": 5126, "count": places, "type": "VEC3"}));
    document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}});
    (document, binary)
}

#[test]
fn instances_from_nowhere() {
    let (mut document, binary) = instanced(4);
    let sparse = json!({"count": 0, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}});
    let zeros = json!({"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse});
    document["accessors"].as_array_mut().expect("accessors").push(zeros);
    // beside others that are there, zeros are sound
    let attributes = &mut document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
    *attributes = json!({"TRANSLATION": 2, "_ZEROS": 3});
    check(&read_glb(&glb(&document, &binary)).expect("a mesh"));
    let attributes = &mut document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
    *attributes = json!({"TRANSLATION": 3});
    let error = refused(&document, &binary);
    assert_eq!(error.kind, Kind::InvalidMesh);
    assert!(error.message.contains("instances of node 0") && error.message.contains("bufferView"), "{error}");
}

#[test]
fn ten_thousand_instances_of_a_small_mesh() {
    let (mut document, binary) = instanced(10_000);
    document["nodes"][0]["name"] = json!("tree in the second row");
    let mesh = read_glb(&glb(&document, &binary)).expect("a mesh");
    check(&mesh);
    assert_eq!((mesh.faces.len(), mesh.parts.len()), (20_000, 10_000));
    // all of them have one name in memory
    let [first, last] = [&mesh.parts[0], &mesh.parts[9999]].map(|part| part.group.as_ref().expect("a name"));
    assert!(Arc::ptr_eq(first, last));
    assert!(mesh.warnings.is_empty());
}

#[test]
fn placements_of_very_many_faces() {
    // a strip of 10,000 faces at 64 places passes, at 128 it does not: by nodes and by instances
    let (mut base, _) = square();
    let indices: Vec<u16> = (0..10_002).map(|corner| corner % 4).collect();
    let strip = |document: &mut Value, binary: &mut Vec<u8>| {
        let first = binary.len();
        binary.extend(shorts(&indices));
        document["bufferViews"][1] = json!({"buffer": 0, "byteOffset": first, "byteLength": 2 * indices.len()});
        document["accessors"][1]["count"] = json!(indices.len());
        document["meshes"][0]["primitives"][0]["mode"] = json!(5);
        document["buffers"][0]["byteLength"] = json!(binary.len());
    };
    for (places, passes) in [(50, true), (128, false)] {
        let (mut instances, mut instances_binary) = instanced(places);
        strip(&mut instances, &mut instances_binary);
        let mut binary = square().1;
        strip(&mut base, &mut binary);
        base["nodes"] = Value::Array(vec![json!({"mesh": 0}); places]);
        base["scenes"] = json!([{"nodes": (0..places).collect::<Vec<_>>()}]);
        for (document, binary) in [(&instances, &instances_binary), (&base, &binary)] {
            let read = read_glb(&glb(document, binary));
            if passes {
                assert_eq!(read.expect("a mesh").faces.len(), 10_000 * places);
                continue;
            }
            let error = read.expect_err("too many faces");
            assert_eq!(error.kind, Kind::TooLarge);
            assert!(error.message.contains("more faces than its bytes allow"), "{error}");
            assert!(error.message.ends_with(": 1280000"), "{error}");
        }
    }
}

#[test]
fn no_instances_of_very_many_faces() {
    let (mut document, binary) = instanced(4);
    document["accessors"][0]["count"] = json!(4);
    document["accessors"][2]["count"] = json!(0);
    let primitive = document["meshes"][0]["primitives"][0].clone();
    document["meshes"][0]["primitives"] = Value::Array(vec![primitive; 1000]);
    assert!(refused(&document, &binary).message.contains("no faces"));
}

#[test]
fn very_many_parts() {
    // bytes that may be instances, with nothing in them: one byte a part
    for (places, passes) in [(100_000, true), (200_000, false)] {
        let (mut document, mut binary) = square();
        binary.resize(60 + places, 0);
        document["buffers"][0]["byteLength"] = json!(binary.len());
        let views = document["bufferViews"].as_array_mut().expect("views");
        views.push(json!({"buffer": 0, "byteOffset": 60, "byteLength": places}));
        let accessors = document["accessors"].as_array_mut().expect("accessors");
        accessors.push(json!({"bufferView": 2, "componentType": 5121, "count": places, "type": "SCALAR"}));
        document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"_ID": 2}}});
        let read = read_glb(&glb(&document, &binary));
        if passes {
            assert_eq!(read.expect("a mesh").parts.len(), places);
            continue;
        }
        let error = read.expect_err("too many parts");
        assert_eq!(error.kind, Kind::TooLarge);
        assert!(error.message.contains("more parts than its bytes allow"), "{error}");
    }
}

#[test]
fn one_long_name_for_very_many_parts() {
    let (mut document, binary) = instanced(20_000);
    document["nodes"][0]["name"] = json!("😀".repeat(100_000));
    let mesh = read_glb(&glb(&document, &binary)).expect("a mesh");
    let bytes: usize = mesh.parts.iter().filter_map(|part| part.group.as_ref()).map(|name| name.len()).sum();
    assert_eq!(mesh.parts.len(), 20_000);
    assert!(mesh.parts[0].group.as_ref().is_some_and(|name| name.len() == 255));
    assert!(bytes < 20_000 * 255 + 1, "{bytes}");

    let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned();
    text += &format!("o {}\n", "😀".repeat(255));
    text += &"g a\nf 1 2 3\ng b\nf 1 2 3\n".repeat(10_000);
    let mesh = obj(&text).expect("a mesh");
    check(&mesh);
    // parts stay apart even where their names are left out
    assert_eq!(mesh.parts.len(), 20_000);
    let named = mesh.parts.iter().filter_map(|part| part.group.as_ref());
    let bytes: usize = named.clone().map(|name| name.len()).sum();
    assert!(bytes <= (1 << 20) + 8 * text.len(), "{bytes}");
    assert!(named.clone().count() < 20_000);
    let warning = mesh.warnings.iter().find(|warning| warning.contains("names"));
    assert!(warning.is_some_and(|warning| warning.ends_with(&format!(": {}", 20_000 - named.count()))), "{warning:?}");
    let [first, third] = [0, 2].map(|part| mesh.parts[part].group.as_ref().expect("a name"));
    assert!(Arc::ptr_eq(first, third));
    assert!(first.ends_with("/a"), "{first}");
}

#[test]
fn compressed_zeros() {
    // the codec's header, three bytes for 256 elements of nothing new, and its tail
    let encoded = |count: usize| {
        let mut bytes = vec![0xa1];
        bytes.resize(1 + 3 * count / 256, 0xaa);
        bytes.resize(bytes.len() + 24, 0);
        bytes
    };
    for (count, passes) in [(256 * 1000, true), (256 * 2000, false)] {
        let mut document = document(4, 6, 4);
        let mut binary = square().1;
        let encoded = encoded(count);
        binary.extend(&encoded);
        document["buffers"][0]["byteLength"] = json!(binary.len());
        document["accessors"][0]["count"] = json!(count);
        document["bufferViews"][0] = json!({"buffer": 0, "byteLength": 0, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteOffset": 60, "byteLength": encoded.len(), "byteStride": 12, "count": count,
            "mode": "ATTRIBUTES",
        }}});
        let read = read_glb(&glb(&document, &binary));
        if passes {
            // and what no face uses is not kept
            let mesh = read.expect("a mesh");
            assert_eq!((mesh.positions.len(), mesh.adjusted.vertices_left_out), (4, count as u64 - 4));
            continue;
        }
        let error = read.expect_err("too many bytes");
        assert_eq!(error.kind, Kind::TooLarge);
        assert!(error.message.contains("decompresses to more bytes"), "{error}");
        assert!(error.message.ends_with(&format!(": {}", 12 * count)), "{error}");
    }
}

#[test]
fn json_of_very_many_empty_objects() {
    let text = |nodes: usize, node: &str| {
        format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}{{}}]}}", format!("{node},").repeat(nodes))
    };
    let read = |text: String| {
        mesh::read(text.as_bytes(), Format::Gltf, &NoResources, &Limits::default()).expect_err("no faces")
    };
    let error = read(text(200_000, "{}"));
    assert_eq!(error.kind, Kind::TooLarge);
    assert!(error.message.contains("more objects than its bytes allow"), "{error}");
    for (nodes, node) in [(60_000, "{}"), (200_000, "{\"mesh\":0}"), (200_000, "{\"name\":\"a\",\"extras\":{}}")] {
        let error = read(text(nodes, node));
        assert_eq!(error.kind, Kind::InvalidMesh, "{error}");
    }
}
