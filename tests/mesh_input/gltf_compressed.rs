//! glTF: buffer views that are decompressed.

use serde_json::{Value, json};
use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};

use crate::make::{SQUARE, expect_document, faces, glb, gltf, square};

/// Compressed views in a fallback buffer, which has no bytes anywhere.
fn compressed(positions: &[u8], position: Value, indices: &[u8], index: Value) -> (Value, Vec<u8>) {
    let (mut document, _) = square();
    let mut binary = positions.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let second = binary.len();
    binary.extend(indices);
    let extension = |offset: usize, length: usize, more: Value| {
        let mut compression = json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
        for (key, value) in more.as_object().expect("an object") {
            compression[key] = value.clone();
        }
        json!({"EXT_meshopt_compression": compression})
    };
    document["buffers"] = json!([
        {"byteLength": binary.len()},
        {"byteLength": 9999, "extensions": {"EXT_meshopt_compression": {"fallback": true}}},
    ]);
    document["bufferViews"] = json!([
        {"buffer": 1, "byteLength": 48, "extensions": extension(0, positions.len(), position)},
        {"buffer": 1, "byteOffset": 48, "byteLength": 12, "extensions": extension(second, indices.len(), index)},
    ]);
    document["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    (document, binary)
}

#[test]
fn compressed_positions_and_indices() {
    let vertices: Vec<[f32; 3]> = SQUARE.iter().map(|p| p.map(|c| c as f32)).collect();
    let plain = meshopt::encode_vertex_buffer(&vertices).expect("encoded");
    let filtered = meshopt::encode_filter_exp(&vertices, 15, meshopt::EncodeExpMode::Separate);
    let exponential = meshopt::encode_vertex_buffer(&filtered).expect("encoded");
    let indices = [0, 1, 2, 0, 2, 3];
    let listed = meshopt::encode_index_buffer(&indices, 4).expect("encoded");
    let in_sequence = meshopt::encode_index_sequence(&indices, 4).expect("encoded");
    for (positions, filter) in [(&plain, "NONE"), (&exponential, "EXPONENTIAL")] {
        for (indices, mode) in [(&listed, "TRIANGLES"), (&in_sequence, "INDICES")] {
            for (stride, kind) in [(2, 5123), (4, 5125)] {
                let (mut document, binary) = compressed(
                    positions,
                    json!({"byteStride": 12, "count": 4, "mode": "ATTRIBUTES", "filter": filter}),
                    indices,
                    json!({"byteStride": stride, "count": 6, "mode": mode}),
                );
                document["accessors"][1]["componentType"] = json!(kind);
                let mesh = gltf(&document, &binary).expect("a mesh");
                assert_eq!(mesh.positions, SQUARE, "{filter} {mode} {stride}");
                // the codec of triangles may turn them
                let starts = [0, 1, 2].map(|first| [first, (first + 1) % 3, (first + 2) % 3]);
                for (face, corners) in faces(&mesh).iter().zip([[0, 1, 2], [0, 2, 3]]) {
                    let turned = |start: &[usize; 3]| start.map(|at| corners[at]) == **face;
                    assert!(starts.iter().any(turned), "{face:?}");
                }
                if mode == "INDICES" {
                    assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 3]]);
                }
                let renamed = document.to_string().replace("EXT_meshopt", "KHR_meshopt");
                let renamed: Value = serde_json::from_str(&renamed).expect("JSON");
                assert_eq!(gltf(&renamed, &binary).expect("a mesh"), mesh);
            }
        }
    }
}

#[test]
fn compressed_instance_rotations() {
    let (mut document, mut binary) = square();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let quaternions = [[0., 0., 0., 1.], [0., 0., half, half], [half, 0., 0., -half], [0.5, -0.5, 0.5, -0.5]];
    let filtered = meshopt::encode_filter_quat(&quaternions, 12);
    let encoded = meshopt::encode_vertex_buffer(&filtered).expect("encoded");
    binary.extend(&encoded);
    document["buffers"][0]["byteLength"] = json!(binary.len());
    document["bufferViews"].as_array_mut().expect("views").push(json!({
        "buffer": 0, "byteLength": 32, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteOffset": 60, "byteLength": encoded.len(), "byteStride": 8, "count": 4,
            "mode": "ATTRIBUTES", "filter": "QUATERNION",
        }},
    }));
    document["accessors"].as_array_mut().expect("accessors").push(json!(
        {"bufferView": 2, "componentType": 5122, "normalized": true, "count": 4, "type": "VEC4"}
    ));
    document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": 2}}});
    let mesh = gltf(&document, &binary).expect("a mesh");
    // where each rotation takes (1, 1, 0)
    for (instance, expected) in [[1., 1., 0.], [-1., 1., 0.], [1., 0., -1.], [0., -1., -1.]].iter().enumerate() {
        let corner = mesh.positions[4 * instance + 2];
        assert!((0..3).all(|axis| (corner[axis] - expected[axis]).abs() < 2e-3), "{instance}: {corner:?} {expected:?}");
    }
}

#[test]
fn octahedral_vectors_of_both_sizes() {
    // no file stores positions so; it shows the filter
    let units: [[f32; 4]; 4] = [[0., 0., 1., 0.], [0.6, -0.8, 0., 0.], [-0.6, 0., -0.8, 0.], [0., -1., 0., 0.]];
    let small = meshopt::encode_filter_oct::<i8>(&units, 8);
    let large = meshopt::encode_filter_oct::<i16>(&units, 12);
    for (encoded, stride, kind, tolerance) in [
        (meshopt::encode_vertex_buffer(&small), 4, 5120, 0.02),
        (meshopt::encode_vertex_buffer(&large), 8, 5122, 0.001),
    ] {
        let sequence = meshopt::encode_index_sequence(&[0, 1, 2, 0, 2, 3], 4).expect("encoded");
        let (mut document, binary) = compressed(
            &encoded.expect("encoded"),
            json!({"byteStride": stride, "count": 4, "mode": "ATTRIBUTES", "filter": "OCTAHEDRAL"}),
            &sequence,
            json!({"byteStride": 2, "count": 6, "mode": "INDICES"}),
        );
        document["accessors"][0]["componentType"] = json!(kind);
        document["accessors"][0]["normalized"] = json!(true);
        let mesh = gltf(&document, &binary).expect("a mesh");
        for (position, unit) in mesh.positions.iter().zip(units) {
            assert!(
                (0..3).all(|axis| (position[axis] - f64::from(unit[axis])).abs() < tolerance),
                "{position:?} {unit:?}"
            );
        }
    }
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
        ("byteStride", json!(0), "ATTRIBUTES: 0"),
        ("byteStride", json!(13), "ATTRIBUTES: 13"),
        ("byteStride", json!(260), "ATTRIBUTES: 260"),
        ("byteStride", json!(u64::MAX), "byteStride"),
        ("byteStride", json!(16), "bufferView 0"),
        ("byteOffset", json!(u64::MAX), "buffer 0"),
        ("byteLength", json!(u64::MAX), "buffer 0"),
        ("byteLength", json!(0), "cannot hold"),
        ("byteLength", json!(encoded.len() - 1), "damaged"),
        ("buffer", json!(5), "buffer 5"),
        ("mode", json!("TRIANGLES"), "TRIANGLES"),
        ("mode", json!("INDICES"), "INDICES"),
        ("mode", json!("POINTS"), "POINTS"),
        ("filter", json!("QUATERNION"), "QUATERNION"),
        ("filter", json!("OCTAHEDRAL"), "OCTAHEDRAL"),
        ("filter", json!("MAGIC"), "MAGIC"),
    ] {
        let document = with(key, value.clone());
        expect_document(&document, &binary, &[word]);
    }
}

#[test]
fn decompressed_bytes_count_against_the_limit() {
    let encoded = meshopt::encode_vertex_buffer(&vec![[0u32; 16]; 50_000]).expect("encoded");
    let document = json!({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 1, "byteLength": 3_200_000, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteLength": encoded.len(), "byteStride": 64, "count": 50_000, "mode": "ATTRIBUTES",
        }}}],
        "buffers": [{"byteLength": encoded.len()}, {"byteLength": 3_200_000}],
    });
    let bytes = glb(&document, &encoded);
    let read = |max_bytes| {
        let limits = Limits { max_bytes, ..Limits::default() };
        mesh::read(&bytes, Format::Glb, &NoResources, &limits)
    };
    assert!(bytes.len() < 400_000, "{}", bytes.len());
    assert!(read(4_000_000).is_ok());
    assert_eq!(read(3_200_000).expect_err("too large").kind, Kind::TooLarge);
}
