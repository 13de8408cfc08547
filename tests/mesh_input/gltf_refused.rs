//! glTF: files that contradict themselves are refused, naming what is wrong, and cost nothing.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tesserae::Kind;
use tesserae::mesh::{self, Format, Limits, NoResources};

use crate::make::{floats, glb, gltf, read_glb, refused, shorts, square};

/// Changes the value at a JSON pointer of the square and expects an error that contains some words.
#[track_caller]
fn expect(pointer: &str, value: Value, words: &[&str]) {
    let (mut document, binary) = square();
    set(&mut document, pointer, value);
    expect_document(&document, &binary, words);
}

fn set(document: &mut Value, pointer: &str, value: Value) {
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
    document.pointer_mut(parent).expect("a parent")[key] = value;
}

#[track_caller]
fn expect_document(document: &Value, binary: &[u8], words: &[&str]) {
    let start = Instant::now();
    let error = refused(document, binary);
    assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
    assert!(matches!(error.kind, Kind::InvalidMesh | Kind::UnsupportedMesh | Kind::TooLarge), "{error:?}");
    for word in words {
        assert!(error.message.contains(word), "{word:?} is not in: {error}");
    }
}

#[test]
fn references_to_nothing() {
    expect("/scene", json!(7), &["scene 7", "the file has 1"]);
    expect("/scenes/0/nodes", json!([4]), &["node 4", "the scene"]);
    expect("/nodes/0/children", json!([3]), &["node 0", "node 3"]);
    expect("/nodes/0/mesh", json!(3), &["node 0", "mesh 3"]);
    expect(
        "/meshes/0/primitives/0/attributes/POSITION",
        json!(9),
        &["accessor 9", "POSITION of primitive 0 of mesh 0"],
    );
    expect("/meshes/0/primitives/0/indices", json!(9), &["accessor 9", "indices of primitive 0 of mesh 0"]);
    expect("/accessors/0/bufferView", json!(9), &["accessor 0", "bufferView 9"]);
    expect("/bufferViews/0/buffer", json!(9), &["bufferView 0", "buffer 9"]);
    expect("/scene", json!(u32::MAX), &["scene 4294967295"]);
    expect("/nodes/0/mesh", json!(-1), &["JSON", "line 1"]);
    expect("/nodes/0/mesh", json!(4_294_967_296u64), &["JSON"]);
}

#[test]
fn counts_and_offsets_beyond_the_bytes() {
    for count in [5u64, 1_000_000_000, 1 << 62, u64::MAX] {
        expect("/accessors/0/count", json!(count), &["accessor 0", "bufferView", &count.to_string()]);
        expect("/accessors/1/count", json!(count + u64::from(count == 5) * 2), &["accessor 1", "bufferView"]);
    }
    for offset in [1u64, 48, 1 << 40, u64::MAX, u64::MAX - 11] {
        expect("/accessors/0/byteOffset", json!(offset), &["accessor 0", "byteOffset"]);
        expect("/bufferViews/1/byteOffset", json!(48 + offset.min(u64::MAX - 48)), &["bufferView 1", "buffer 0"]);
        expect("/bufferViews/0/byteLength", json!(60u64.saturating_add(offset)), &["bufferView 0", "buffer 0"]);
    }
    for stride in [1, 8, 11] {
        expect("/bufferViews/0/byteStride", json!(stride), &["accessor 0", "byteStride"]);
    }
    for stride in [13u64, 16, 252, 1 << 40, u64::MAX] {
        expect("/bufferViews/0/byteStride", json!(stride), &["accessor 0", "byteStride"]);
    }
    expect("/bufferViews/0/byteLength", json!(0), &["accessor 0", "0 bytes"]);
    for length in [61u64, 1_000_000_000, u64::MAX] {
        // the chunk is padded to 60 bytes
        expect("/buffers/0/byteLength", json!(length), &["buffer 0 is truncated", &length.to_string()]);
    }
    expect("/buffers/0/byteLength", json!(12), &["buffer 0", "12 bytes"]);
    expect("/accessors/0/count", json!(-4), &["JSON"]);
    expect("/accessors/0/count", json!(1e9), &["JSON"]);
}

#[test]
fn types_that_cannot_be() {
    for (kind, shape) in [(5125, "VEC3"), (5126, "VEC2"), (5126, "SCALAR")] {
        let (mut document, binary) = square();
        document["accessors"][0]["componentType"] = json!(kind);
        document["accessors"][0]["type"] = json!(shape);
        expect_document(&document, &binary, &["accessor 0", "POSITION"]);
    }
    for (kind, shape) in [(5126, "SCALAR"), (5120, "SCALAR"), (5122, "SCALAR"), (5121, "VEC2")] {
        let (mut document, binary) = square();
        document["accessors"][1]["componentType"] = json!(kind);
        document["accessors"][1]["type"] = json!(shape);
        document["accessors"][1]["count"] = json!(3);
        expect_document(&document, &binary, &["accessor 1", "indices"]);
    }
    expect("/accessors/0/componentType", json!(5130), &["accessor 0", "componentType"]);
    expect("/accessors/0/type", json!("VEC9"), &["accessor 0", "type"]);
    expect("/accessors/0/type", json!("MAT4"), &["accessor 0", "matrices"]);
    expect("/meshes/0/primitives/0/mode", json!(7), &["primitive 0 of mesh 0", "mode"]);
}

#[test]
fn indices_of_no_vertex() {
    for (width, restart) in [(1, 0xff), (2, 0xffff), (4, u32::MAX)] {
        for bad in [4, restart] {
            let (mut document, mut binary) = square();
            binary.truncate(48);
            for index in [0, 1, 2, 0, bad, 3] {
                binary.extend(&index.to_le_bytes()[..width]);
            }
            document["accessors"][1]["componentType"] = json!([5121, 5123, 5125][width / 2]);
            document["bufferViews"][1]["byteLength"] = json!(6 * width);
            document["buffers"][0]["byteLength"] = json!(48 + 6 * width);
            expect_document(
                &document,
                &binary,
                &["element 4 of accessor 1", "4 vertices of accessor 0", &bad.to_string()],
            );
        }
    }
}

#[test]
fn positions_that_are_not_finite() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let (document, mut binary) = square();
        binary[28..32].copy_from_slice(&bad.to_le_bytes());
        expect_document(&document, &binary, &["accessor 0, vertex 2", "node 0", "not finite"]);
    }
    // finite in the file, but not where it is put
    let (mut document, binary) = square();
    document["nodes"] = json!([{"children": [1], "scale": [1e200, 1, 1]}, {"mesh": 0, "scale": [1e200, 1, 1]}]);
    expect_document(&document, &binary, &["accessor 0, vertex", "node 1", "not finite"]);
}

#[test]
fn scenes_that_are_no_trees() {
    for nodes in [
        json!([{"mesh": 0, "children": [0]}]),
        json!([{"mesh": 0, "children": [1]}, {"children": [0]}]),
        json!([{"children": [1, 2]}, {"children": [3]}, {"children": [3]}, {"mesh": 0}]),
        json!([{"children": [1, 1]}, {"mesh": 0}]),
    ] {
        let (mut document, binary) = square();
        document["nodes"] = nodes;
        expect_document(&document, &binary, &["the nodes are no tree"]);
        document.as_object_mut().expect("an object").remove("scenes");
        document.as_object_mut().expect("an object").remove("scene");
        expect_document(&document, &binary, &["the nodes are no tree"]);
    }
    expect("/scenes/0/nodes", json!([0, 0]), &["the nodes are no tree", "0"]);
}

#[test]
fn transforms_that_are_none() {
    expect("/nodes/0/rotation", json!([0, 0, 0, 0]), &["rotation of node 0"]);
    expect("/nodes/0/rotation", json!([1, 2, 3]), &["JSON"]);
    expect("/nodes/0/matrix", json!([1, 2, 3]), &["JSON"]);
    expect("/nodes/0/matrix", json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), &["matrix of node 0"]);
}

#[test]
fn documents_that_are_not_gltf_2() {
    expect("/asset/version", json!("1.0"), &["2.0", "\"1.0\""]);
    expect("/asset/version", json!("3.0"), &["\"3.0\""]);
    expect("/asset/minVersion", json!("2.1"), &["\"2.1\""]);
    expect("/asset", json!({}), &["version"]);
    let (mut document, binary) = square();
    document.as_object_mut().expect("an object").remove("asset");
    expect_document(&document, &binary, &["asset"]);
    // of version 1, whose arrays are objects
    expect_document(&json!({"asset": {"version": "1.1"}, "nodes": {"n": {}}}), &[], &["\"1.1\""]);
    for text in ["{", "{\"asset\":", "{}", "{]", "{\"asset\": {\"version\": \"2.0\"}} x"] {
        let read = mesh::read(text.as_bytes(), Format::Gltf, &NoResources, &Limits::default());
        assert_eq!(read.expect_err("refused").kind, Kind::InvalidMesh, "{text}");
    }
    let deep = format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"extras\": {}", "[".repeat(100_000));
    assert!(mesh::read(deep.as_bytes(), Format::Gltf, &NoResources, &Limits::default()).is_err());
}

#[test]
fn required_extensions_are_named() {
    for name in ["KHR_draco_mesh_compression", "VENDOR_unheard_of", "KHR_materials_nonsense"] {
        let (mut document, binary) = square();
        document["extensionsRequired"] = json!(["KHR_mesh_quantization", name]);
        let error = refused(&document, &binary);
        assert_eq!(error.kind, Kind::UnsupportedMesh);
        assert!(error.message.ends_with(name), "{error}");
    }
}

#[test]
fn draco_without_a_fallback_is_refused() {
    for accessor in [0, 1] {
        let (mut document, binary) = square();
        document["meshes"][0]["primitives"][0]["extensions"] =
            json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}});
        assert!(gltf(&document, &binary).is_ok());
        document["accessors"][accessor].as_object_mut().expect("an accessor").remove("bufferView");
        let error = refused(&document, &binary);
        assert_eq!(error.kind, Kind::UnsupportedMesh);
        assert!(error.message.contains("KHR_draco_mesh_compression"), "{error}");
    }
}

#[test]
fn accessors_of_nothing() {
    let (mut document, binary) = square();
    document["accessors"][0].as_object_mut().expect("an accessor").remove("bufferView");
    expect_document(&document, &binary, &["accessor 0 has neither a bufferView nor sparse values"]);
    let sparse = |count: u64, index: u8| json!({"count": count, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 0}, "index": index});
    document["bufferViews"]
        .as_array_mut()
        .expect("views")
        .push(json!({"buffer": 0, "byteOffset": 48, "byteLength": 12}));
    document["accessors"][0]["sparse"] = sparse(1, 0);
    assert!(gltf(&document, &binary).is_ok());
    document["accessors"][0]["count"] = json!(1_000_000_000);
    expect_document(&document, &binary, &["accessor 0 has no bufferView", "1000000000"]);
    document["accessors"][0]["count"] = json!(4);
    for count in [5, 1_000_000_000, u64::MAX] {
        document["accessors"][0]["sparse"] = sparse(count, 0);
        expect_document(&document, &binary, &["accessor 0", &count.to_string()]);
    }
    // bytes 48 … are 0, 0, 1, 0: they do not increase
    document["accessors"][0]["sparse"] = sparse(2, 0);
    expect_document(&document, &binary, &["sparse indices of accessor 0", "number 1"]);
    document["bufferViews"][2]["byteOffset"] = json!(16 + 15);
    document["accessors"][0]["sparse"] = sparse(1, 0);
    expect_document(&document, &binary, &["sparse indices of accessor 0", "below 4"]);
    document["accessors"][0]["sparse"]["values"]["bufferView"] = json!(77);
    expect_document(&document, &binary, &["sparse values of accessor 0", "bufferView 77"]);
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
        (4, 1, "version"),
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
    document["bufferViews"] = json!([{"buffer": 0, "byteLength": 12 * vertices}, {"buffer": 0, "byteOffset": 12 * vertices, "byteLength": 6}]);
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
        "bufferViews": [{"buffer": 0, "byteLength": 12 * count}, {"buffer": 0, "byteOffset": 12 * count, "byteLength": 4 * count}],
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
fn instances_that_do_not_fit() {
    let (mut document, mut binary) = square();
    binary.extend(floats(&[0.; 8]));
    document["buffers"][0]["byteLength"] = json!(92);
    document["bufferViews"]
        .as_array_mut()
        .expect("views")
        .push(json!({"buffer": 0, "byteOffset": 60, "byteLength": 32}));
    document["accessors"].as_array_mut().expect("accessors").extend([
        json!({"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"}),
        json!({"bufferView": 2, "componentType": 5126, "count": 1, "type": "VEC4"}),
    ]);
    for (attributes, words) in [
        (json!({"TRANSLATION": 2, "ROTATION": 3}), &["instances of node 0", "1 of ROTATION", "2 of TRANSLATION"][..]),
        (json!({"TRANSLATION": 3}), &["TRANSLATION", "components"]),
        (json!({"ROTATION": 2}), &["ROTATION", "components"]),
        (json!({"ROTATION": 3}), &["rotation of instance 0 of node 0"]),
        (json!({"SCALE": 99}), &["accessor 99", "SCALE"]),
        (json!({}), &["no attributes"]),
    ] {
        document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
        let error = refused(&document, &binary);
        for word in words {
            assert!(error.message.contains(word), "{word}: {error}");
        }
    }
    // no instances at all are no faces
    document["accessors"][2]["count"] = json!(0);
    document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}});
    expect_document(&document, &binary, &["no faces"]);
}

#[test]
fn compressions_that_cannot_be() {
    let (mut document, mut binary) = square();
    let encoded = meshopt::encode_vertex_buffer(&[[0f32; 3]; 4]).expect("encoded");
    binary.extend(&encoded);
    document["buffers"][0]["byteLength"] = json!(binary.len());
    let sound = json!({
        "buffer": 0, "byteOffset": 60, "byteLength": encoded.len(), "byteStride": 12, "count": 4, "mode": "ATTRIBUTES",
    });
    let mut with = |key: &str, value: Value| {
        let mut changed = sound.clone();
        changed[key] = value;
        document["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": changed});
        document.clone()
    };
    assert!(gltf(&with("filter", json!("NONE")), &binary).is_ok());
    for (key, value, word) in [
        ("count", json!(1_000_000_000), "cannot hold"),
        ("count", json!(u64::MAX), "cannot hold"),
        ("count", json!(3), "accessor 0"),
        ("count", json!(0), "bufferView 0"),
        ("count", json!("many"), "EXT_meshopt_compression of bufferView 0"),
        ("byteStride", json!(0), "byteStride 0"),
        ("byteStride", json!(13), "byteStride 13"),
        ("byteStride", json!(260), "byteStride 260"),
        ("byteStride", json!(u64::MAX), "byteStride"),
        ("byteStride", json!(16), "bufferView 0"),
        ("byteOffset", json!(u64::MAX), "buffer 0"),
        ("byteLength", json!(u64::MAX), "buffer 0"),
        ("byteLength", json!(0), "cannot hold"),
        ("byteLength", json!(encoded.len() - 1), "damaged"),
        ("buffer", json!(5), "buffer 5"),
        ("mode", json!("TRIANGLES"), "Triangles"),
        ("mode", json!("INDICES"), "Indices"),
        ("mode", json!("POINTS"), "POINTS"),
        ("filter", json!("QUATERNION"), "Quaternion"),
        ("filter", json!("OCTAHEDRAL"), "Octahedral"),
        ("filter", json!("MAGIC"), "MAGIC"),
    ] {
        let document = with(key, value.clone());
        expect_document(&document, &binary, &[word]);
    }
}

#[test]
fn decompressed_bytes_count_against_the_limit() {
    let encoded = meshopt::encode_vertex_buffer(&vec![[0u32; 16]; 100_000]).expect("encoded");
    let document = json!({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 1, "byteLength": 6_400_000, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteLength": encoded.len(), "byteStride": 64, "count": 100_000, "mode": "ATTRIBUTES",
        }}}],
        "buffers": [{"byteLength": encoded.len()}, {"byteLength": 6_400_000}],
    });
    let bytes = glb(&document, &encoded);
    let read = |max_bytes| {
        let limits = Limits { max_bytes, ..Limits::default() };
        mesh::read(&bytes, Format::Glb, &NoResources, &limits)
    };
    assert!(bytes.len() < 700_000, "{}", bytes.len());
    assert!(read(8_000_000).is_ok());
    assert_eq!(read(6_400_000).expect_err("too large").kind, Kind::TooLarge);
}

#[test]
fn data_uris_that_are_damaged() {
    for (uri, word) in [
        ("data:application/octet-stream;base64,@@@@", "base64"),
        ("data:application/octet-stream;base64", "comma"),
        ("data:", "comma"),
        ("data:;base64,AAAA", "truncated"),
    ] {
        expect("/buffers/0/uri", json!(uri), &["buffer 0", word]);
    }
    // a buffer without bytes anywhere
    let (mut document, binary) = square();
    document["buffers"] = json!([{"byteLength": 60}, {"byteLength": 60}]);
    document["bufferViews"][0]["buffer"] = json!(1);
    expect_document(&document, &binary, &["buffer 1 has no uri"]);
    let text = square().0.to_string();
    let error = mesh::read(text.as_bytes(), Format::Gltf, &NoResources, &Limits::default()).expect_err("no bytes");
    assert!(error.message.contains("buffer 0 has no uri"), "{error}");
}

#[test]
fn meshes_without_faces() {
    expect("/scenes/0/nodes", json!([]), &["no faces"]);
    expect("/nodes", json!([{}]), &["no faces"]);
    expect("/meshes/0/primitives", json!([]), &["no faces"]);
    expect("/accessors/1/count", json!(2), &["no faces"]);
    expect("/accessors/1/count", json!(0), &["no faces"]);
    expect_document(&json!({"asset": {"version": "2.0"}}), &[], &["no faces"]);
}
