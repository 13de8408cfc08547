//! glTF: files that contradict themselves are refused, naming what is wrong.

use serde_json::json;
use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};

use crate::make::{expect, expect_document, gltf, refused, square};

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
fn documents_that_are_not_gltf_2() {
    expect("/asset/version", json!("1.0"), &["2.0", "glTF 1.0"]);
    expect("/asset/version", json!("3.0"), &["\"3.0\""]);
    expect("/asset/minVersion", json!("2.1"), &["\"2.1\""]);
    expect("/asset", json!({}), &["version"]);
    let (mut document, binary) = square();
    document.as_object_mut().expect("an object").remove("asset");
    expect_document(&document, &binary, &["asset"]);
    // of version 1, whose arrays are objects
    expect_document(&json!({"asset": {"version": "1.1"}, "nodes": {"n": {}}}), &[], &["glTF 1.0"]);
    for text in ["{", "{\"asset\":", "{}", "{]", "{\"asset\": {\"version\": \"2.0\"}} x"] {
        let read = mesh::read(text.as_bytes(), Format::Gltf, &NoResources, &Limits::default());
        assert_eq!(read.expect_err("refused").kind, Kind::InvalidMesh, "{text}");
    }
    let deep = format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"extras\": {}", "[".repeat(100_000));
    assert!(mesh::read(deep.as_bytes(), Format::Gltf, &NoResources, &Limits::default()).is_err());
}

#[test]
fn required_extensions_are_named() {
    for name in ["KHR_draco_mesh_compression", "VENDOR_unheard_of", "KHR_mesh_nonsense"] {
        let (mut document, binary) = square();
        document["extensionsRequired"] = json!(["KHR_mesh_quantization", name]);
        let error = refused(&document, &binary);
        assert_eq!(error.kind, Kind::UnsupportedMesh);
        assert!(error.message.contains(name), "{error}");
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
    let zeros = gltf(&document, &binary).expect("zeros, by the specification");
    assert_eq!(zeros.positions, [[0.0; 3]; 4]);
    let sparse = |count: u64, index: u8| {
        let indices = json!({"bufferView": 2, "componentType": 5121});
        json!({"count": count, "indices": indices, "values": {"bufferView": 0}, "index": index})
    };
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
