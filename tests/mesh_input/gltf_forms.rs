//! glTF: the forms that are read.

use proptest::prelude::*;
use serde_json::{Value, json};

use crate::make::{SQUARE, check, data_uri, document, faces, floats, glb, gltf, shorts, square};

#[test]
fn a_square_of_two_triangles() {
    let (document, binary) = square();
    let mesh = gltf(&document, &binary).expect("a mesh");
    check(&mesh);
    assert_eq!(mesh.positions, SQUARE);
    assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.warnings, [""; 0]);
    let part = &mesh.parts[0];
    assert_eq!((part.node, part.mesh, part.primitive, part.instance), (Some(0), Some(0), Some(0), None));
    assert_eq!(part.group.as_deref(), Some("square"));
}

#[test]
fn indices_of_every_width() {
    for (kind, bytes) in [
        (5121, vec![0, 1, 2, 0, 2, 3]),
        (5123, shorts(&[0, 1, 2, 0, 2, 3])),
        (5125, [0u32, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect()),
    ] {
        let (mut document, mut binary) = square();
        binary.truncate(48);
        binary.extend(&bytes);
        document["accessors"][1]["componentType"] = json!(kind);
        document["bufferViews"][1]["byteLength"] = json!(bytes.len());
        document["buffers"][0]["byteLength"] = json!(48 + bytes.len());
        let mesh = gltf(&document, &binary).expect("a mesh");
        assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 3]], "{kind}");
    }
}

#[test]
fn strips_fans_and_lists_with_and_without_indices() {
    let positions: Vec<f32> = (0..15).map(|v| v as f32).collect();
    let order = [4, 3, 2, 1, 0];
    for (mode, plain, incomplete) in [
        (4, vec![[0, 1, 2]], true),
        (5, vec![[0, 1, 2], [1, 3, 2], [2, 3, 4]], false),
        (6, vec![[1, 2, 0], [2, 3, 0], [3, 4, 0]], false),
    ] {
        let mut binary = floats(&positions);
        binary.extend(shorts(&order));
        let mut document = document(5, 5, mode);
        let mesh = gltf(&document, &binary).expect("a mesh");
        let through = |triangle: &[u32; 3]| triangle.map(|corner| u32::from(order[corner as usize]));
        assert_eq!(faces(&mesh), plain.iter().map(through).collect::<Vec<_>>(), "{mode}");
        assert_eq!(mesh.warnings.len(), usize::from(incomplete), "{:?}", mesh.warnings);
        let primitive = &mut document["meshes"][0]["primitives"][0];
        primitive.as_object_mut().expect("an object").remove("indices");
        let mesh = gltf(&document, &binary).expect("a mesh");
        assert_eq!(faces(&mesh), plain, "{mode}");
    }
}

#[test]
fn quantised_positions_of_every_type() {
    let scaled = |one: f64| [[0.0, 1.0 / one, 1.0], [-1.0, -1.0, 2.0 / one], [1.0, 0.0, -1.0]];
    for (kind, is_signed, one, bytes, stride) in [
        (5120, true, 127.0, vec![0u8, 1, 127, 0, 0x81, 0x80, 2, 0, 127, 0, 0x81, 0], 4),
        (5121, false, 255.0, vec![0, 1, 255, 0, 10, 20, 30, 0, 255, 0, 1, 0], 4),
        (5122, true, 32767.0, shorts(&[0, 1, 32767, 0x8001, 0x8000, 2, 32767, 0, 0x8001]), 6),
        (5123, false, 65535.0, shorts(&[0, 1, 65535, 0, 10, 20, 30, 0, 65535, 0, 1, 0]), 8),
    ] {
        for is_normalized in [false, true] {
            let document = json!({
                "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                "accessors": [{"bufferView": 0, "componentType": kind, "normalized": is_normalized, "count": 3,
                               "type": "VEC3"}],
                "bufferViews": [{"buffer": 0, "byteLength": bytes.len(), "byteStride": stride}],
                "buffers": [{"byteLength": bytes.len()}],
                "extensionsRequired": ["KHR_mesh_quantization"], "extensionsUsed": ["KHR_mesh_quantization"],
            });
            let mesh = gltf(&document, &bytes).expect("a mesh");
            let unit = if is_normalized { one } else { 1.0 };
            let expected = if is_signed {
                // the lowest integer is clamped to -1 when it stands for one
                let lowest = if is_normalized { -1.0 } else { -one - 1.0 };
                let s = scaled(one).map(|p| p.map(|c| (c * one).round() / unit));
                [s[0], [s[1][0], lowest, s[1][2]], s[2]]
            } else {
                [[0.0, 1.0, one], [10.0, 20.0, 30.0], [one, 0.0, 1.0]].map(|p| p.map(|c| c / unit))
            };
            assert_eq!(mesh.positions, expected, "{kind} {is_normalized}");
        }
    }
}

#[test]
fn interleaved_vertices_and_offsets() {
    let (mut document, square) = square();
    let mut binary = vec![7u8; 8];
    for vertex in square[..48].chunks(12) {
        binary.extend(vertex);
        binary.extend([9; 8]);
    }
    binary.extend(&square[48..]);
    let length = binary.len();
    document["bufferViews"] = json!([
        {"buffer": 0, "byteOffset": 4, "byteLength": 84 - 8, "byteStride": 20},
        {"buffer": 0, "byteOffset": 84, "byteLength": length - 84},
    ]);
    document["accessors"][0]["byteOffset"] = json!(4);
    document["accessors"][1]["byteOffset"] = json!(length - 84 - 12);
    document["buffers"][0]["byteLength"] = json!(length);
    assert_eq!(gltf(&document, &binary).expect("a mesh").positions, SQUARE);
}

#[test]
fn sparse_positions_and_indices() {
    let (mut document, mut binary) = square();
    // vertex 2 goes to (5, 6, 7); the last index becomes 1
    binary.extend(floats(&[5., 6., 7.]));
    binary.extend([2, 0, 0, 0]);
    binary.extend(shorts(&[1, 0]));
    binary.extend(shorts(&[5, 0]));
    document["bufferViews"].as_array_mut().expect("views").extend([
        json!({"buffer": 0, "byteOffset": 60, "byteLength": 12}),
        json!({"buffer": 0, "byteOffset": 72, "byteLength": 1}),
        json!({"buffer": 0, "byteOffset": 76, "byteLength": 2}),
        json!({"buffer": 0, "byteOffset": 80, "byteLength": 2}),
    ]);
    document["buffers"][0]["byteLength"] = json!(84);
    document["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": {"bufferView": 3, "componentType": 5121}, "values": {"bufferView": 2},
    });
    document["accessors"][1]["sparse"] = json!({
        "count": 1, "indices": {"bufferView": 5, "componentType": 5123}, "values": {"bufferView": 4},
    });
    let mesh = gltf(&document, &binary).expect("a mesh");
    let moved = [SQUARE[0], SQUARE[1], [5.0, 6.0, 7.0], SQUARE[3]];
    assert_eq!(mesh.positions, moved);
    assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 1]]);

    let first = document["accessors"][0].as_object_mut().expect("an accessor");
    first.remove("bufferView");
    let mesh = gltf(&document, &binary).expect("a mesh");
    assert_eq!(mesh.positions, [[0.0; 3], [0.0; 3], [5.0, 6.0, 7.0], [0.0; 3]]);
}

#[test]
fn buffers_in_data_uris_of_every_kind() {
    let (document, binary) = square();
    let base64 = data_uri(&binary);
    let bytes: String = binary.iter().map(|byte| format!("%{byte:02x}")).collect();
    for uri in [
        base64.clone(),
        base64.replace("octet-stream", "gltf-buffer"),
        base64.replace("data:application/octet-stream", "DATA:"),
        base64.trim_end_matches('=').to_owned(),
        base64.replace('+', "%2B").replace('=', "%3D"),
        format!("data:application/octet-stream,{bytes}"),
    ] {
        let mut document = document.clone();
        document["buffers"][0]["uri"] = json!(uri);
        assert_eq!(gltf(&document, &[]).expect("a mesh").positions, SQUARE, "{uri}");
    }
}

#[test]
fn what_is_no_triangle_is_skipped_with_a_warning() {
    let (mut document, binary) = square();
    let primitive = document["meshes"][0]["primitives"][0].clone();
    let with = |change: Value| {
        let mut primitive = primitive.clone();
        for (key, value) in change.as_object().expect("an object") {
            primitive[key] = value.clone();
        }
        primitive
    };
    document["meshes"][0]["primitives"] = json!([
        with(json!({"mode": 0})),
        with(json!({"mode": 1})),
        with(json!({"mode": 2})),
        with(json!({"mode": 3})),
        with(json!({"attributes": {"NORMAL": 99}})),
        with(json!({"targets": [{"POSITION": 99}]})),
    ]);
    document["nodes"][0]["skin"] = json!(99);
    let mesh = gltf(&document, &binary).expect("a mesh");
    check(&mesh);
    assert_eq!(mesh.parts[0].primitive, Some(5));
    let warnings = mesh.warnings.join("\n");
    for expected in [
        "points or lines were skipped: 4",
        "without POSITION were skipped: 1",
        "morph targets, which were ignored: 1",
        "rest pose: 1",
    ] {
        assert!(warnings.contains(expected), "{warnings}");
    }
    assert_eq!(mesh.warnings.len(), 4);
}

#[test]
fn what_geometry_does_not_need_is_not_read() {
    let (mut document, binary) = square();
    for (key, value) in [
        ("images", json!([{"uri": "/etc/passwd"}, {"uri": "http://localhost/x.png"}])),
        ("textures", json!([{"extensions": {"KHR_texture_basisu": {"source": 0}}}])),
        ("materials", json!([{"pbrMetallicRoughness": {"baseColorFactor": "red"}}])),
        ("animations", json!([{"channels": 7}])),
        ("cameras", json!("none")),
        ("skins", json!([{}])),
        ("samplers", json!([[]])),
        ("extras", json!("text")),
        ("extensions", json!({"VENDOR_thing": [1, 2, 3]})),
        ("extensionsUsed", json!(["VENDOR_thing", "KHR_materials_unlit", "KHR_draco_mesh_compression"])),
        ("extensionsRequired", json!(["KHR_materials_unlit", "KHR_texture_transform", "KHR_texture_basisu"])),
    ] {
        document[key] = value;
    }
    document["buffers"].as_array_mut().expect("buffers").push(json!({"byteLength": 9, "uri": "../../secret.bin"}));
    document["asset"]["extras"] = json!(17);
    for extras in [json!("text"), json!(5), json!(null), json!([1, {}]), json!({"a": 1})] {
        document["nodes"][0]["extras"] = extras.clone();
        document["meshes"][0]["extras"] = extras.clone();
        document["meshes"][0]["primitives"][0]["extras"] = extras.clone();
        document["accessors"][0]["extras"] = extras.clone();
        document["bufferViews"][0]["extras"] = extras.clone();
        document["buffers"][0]["extras"] = extras.clone();
        assert_eq!(gltf(&document, &binary).expect("a mesh").positions, SQUARE, "{extras}");
    }
    document["nodes"][0]["camera"] = json!(3);
    document["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 12}});
    document["meshes"][0]["primitives"][0]["material"] = json!(44);
    document["meshes"][0]["primitives"][0]["attributes"]["_CUSTOM"] = json!(77);
    document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(78);
    document["meshes"][0]["primitives"][0]["extensions"] =
        json!({"KHR_draco_mesh_compression": {"bufferView": 5, "attributes": {}}});
    assert_eq!(gltf(&document, &binary).expect("a mesh").positions, SQUARE);
}

proptest! {
    /// Positions and indices survive the way through a document, interleaved or not.
    #[test]
    fn written_meshes_are_read_back(
        positions in prop::collection::vec(prop::array::uniform3(-1e9f32..1e9), 3..60),
        corners in prop::collection::vec(any::<u16>(), 1..40),
        mode in 4u32..7,
    ) {
        let flat: Vec<f32> = positions.iter().flatten().copied().collect();
        let corners: Vec<u16> = corners.iter().map(|&c| c % positions.len() as u16).collect();
        let mut binary = floats(&flat);
        binary.extend(shorts(&corners));
        let document = document(positions.len(), corners.len(), mode);
        let expected = if mode == 4 { corners.len() / 3 } else { corners.len().saturating_sub(2) };
        match gltf(&document, &binary) {
            Ok(mesh) => {
                check(&mesh);
                prop_assert_eq!(mesh.faces.len(), expected);
                prop_assert_eq!(mesh.positions, positions.iter().map(|p| p.map(f64::from)).collect::<Vec<_>>());
            }
            Err(_) => prop_assert_eq!(expected, 0),
        }
    }
}

#[test]
fn an_attribute_comes_with_the_vertices_it_belongs_to() {
    use tesserae_mesh::mesh::{Format, Limits, NoResources, ReadMesh, Source, open};
    let (mut document, mut binary) = square();
    // two placements; weights as normalized bytes
    document["scenes"][0]["nodes"] = json!([0, 1]);
    document["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}]);
    document["meshes"][0]["primitives"][0]["attributes"]["_WEIGHT"] = json!(2);
    let accessors = document["accessors"].as_array_mut().expect("accessors");
    accessors.push(json!({"bufferView": 2, "componentType": 5121, "normalized": true, "count": 4, "type": "SCALAR"}));
    let views = document["bufferViews"].as_array_mut().expect("views");
    views.push(json!({"buffer": 0, "byteOffset": 60, "byteLength": 4}));
    document["buffers"][0]["byteLength"] = json!(64);
    binary.extend([255, 51, 102, 255]);
    let read = |document: &Value, name: &str| {
        let bytes = &glb(document, &binary);
        let limits = Limits::default();
        let source = Source { attribute: Some(name), ..Source::new(bytes, Format::Glb, &NoResources, &limits) };
        open(source, |opened| opened.read()).flatten()
    };
    let ReadMesh { mesh, numbers, .. } = read(&document, "_WEIGHT").expect("a mesh");
    assert_eq!(mesh.positions.len(), 8);
    assert_eq!(numbers, Some([1.0, 0.2, 0.4, 1.0].repeat(2)));
    let error = read(&document, "_OTHER").expect_err("no such attribute");
    assert!(error.message.contains("primitive 0 of mesh 0") && error.message.contains("_OTHER"), "{error}");
    for (name, value) in [("count", json!(3)), ("type", json!("VEC2"))] {
        let mut document = document.clone();
        document["accessors"][2][name] = value;
        document["accessors"][2]["componentType"] = json!(5121);
        let error = read(&document, "_WEIGHT").expect_err(name);
        assert!(error.message.contains("accessor 2"), "{error}");
    }
}
