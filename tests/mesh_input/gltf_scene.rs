//! glTF: scenes, nodes, transforms and instances.

use serde_json::{Value, json};

use crate::make::{check, expect, expect_document, faces, floats, gltf, refused, shorts, square};

#[test]
fn nested_transforms_in_doubles() {
    let (mut document, binary) = square();
    document["nodes"] = json!([
        {"children": [1, 2], "translation": [0.1, 0, 0], "scale": [2, 3, -1]},
        {"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 10000000.3, 0, 0.5, 1]},
        {"children": [3], "rotation": [0, 0, 1, 0]},
        {"mesh": 0, "scale": [1, 0.5, 1]},
    ]);
    let mesh = gltf(&document, &binary).expect("a mesh");
    check(&mesh);
    let [one, two]: [[f64; 3]; 2] = [mesh.positions[2], mesh.positions[6]];
    assert_eq!(one, [2.0 * (10_000_000.3 - 1.0) + 0.1, 3.0, -0.5]);
    assert_eq!(two, [-2.0 + 0.1, -1.5, 0.0]);
    assert_eq!(mesh.parts.iter().map(|part| part.node).collect::<Vec<_>>(), [Some(1), Some(3)]);
    // a mirror keeps the side that faces outwards outwards
    assert_eq!(faces(&mesh), [[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]]);
}

#[test]
fn the_default_scene_else_the_first_else_all_roots() {
    let (mut document, binary) = square();
    document["nodes"] = json!([
        {"mesh": 0, "children": [1]}, {"mesh": 0}, {"mesh": 0, "children": [4, 3]}, {"mesh": 0}, {"mesh": 0},
    ]);
    document["scenes"] = json!([{"nodes": [2]}, {"nodes": [2, 0]}, {}]);
    let nodes = |document: &Value| -> Vec<u32> {
        let mesh = gltf(document, &binary).expect("a mesh");
        check(&mesh);
        mesh.parts.iter().filter_map(|part| part.node).collect()
    };
    document["scene"] = json!(1);
    assert_eq!(nodes(&document), [2, 4, 3, 0, 1]);
    document.as_object_mut().expect("an object").remove("scene");
    assert_eq!(nodes(&document), [2, 4, 3]);
    document.as_object_mut().expect("an object").remove("scenes");
    assert_eq!(nodes(&document), [0, 1, 2, 4, 3]);
    document["scenes"] = json!([]);
    assert_eq!(nodes(&document), [0, 1, 2, 4, 3]);
}

#[test]
fn instances_come_before_primitives() {
    let (mut document, mut binary) = square();
    let primitive = document["meshes"][0]["primitives"][0].clone();
    document["meshes"][0]["primitives"] = json!([primitive, primitive]);
    binary.extend(floats(&[0., 0., 1., 0., 0., 2., 0., 0., 3.]));
    // quarter turns about x, as normalised shorts, of which the third is mirrored
    let half = 23170u16;
    binary.extend(shorts(&[0, 0, 0, 32767, half, 0, 0, half, 0, 0, 0, 32767]));
    binary.extend(floats(&[1., 1., 1., 2., 2., 2., 1., 1., -1.]));
    document["bufferViews"].as_array_mut().expect("views").extend([
        json!({"buffer": 0, "byteOffset": 60, "byteLength": 36}),
        json!({"buffer": 0, "byteOffset": 96, "byteLength": 24}),
        json!({"buffer": 0, "byteOffset": 120, "byteLength": 36}),
    ]);
    document["accessors"].as_array_mut().expect("accessors").extend([
        json!({"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC3"}),
        json!({"bufferView": 3, "componentType": 5122, "normalized": true, "count": 3, "type": "VEC4"}),
        json!({"bufferView": 4, "componentType": 5126, "count": 3, "type": "VEC3"}),
    ]);
    document["buffers"][0]["byteLength"] = json!(156);
    document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    document["nodes"][0]["translation"] = json!([10, 0, 0]);
    document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {
        "TRANSLATION": 2, "ROTATION": 3, "SCALE": 4, "_ID": 2,
    }}});
    let mesh = gltf(&document, &binary).expect("a mesh");
    check(&mesh);
    let order: Vec<_> = mesh.parts.iter().map(|part| (part.instance, part.primitive)).collect();
    let expected = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)];
    assert_eq!(order, expected.map(|(instance, primitive)| (Some(instance), Some(primitive))));
    let corners = [mesh.positions[2], mesh.positions[10], mesh.positions[18]];
    for (corner, expected) in corners.iter().zip([[11.0, 1.0, 1.0], [12.0, 0.0, 4.0], [11.0, 1.0, 3.0]]) {
        assert!((0..3).all(|axis| (corner[axis] - expected[axis]).abs() < 1e-9), "{corner:?} {expected:?}");
    }
    assert_eq!(faces(&mesh)[0], [0, 1, 2]);
    assert_eq!(faces(&mesh)[8], [16, 18, 17]);
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
        (
            json!({"TRANSLATION": 2, "ROTATION": 3}),
            &["instances of node 0", "1 of \"ROTATION\"", "2 of \"TRANSLATION\""][..],
        ),
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
fn nodes_that_are_not_shown_place_nothing() {
    let (mut document, binary) = square();
    let hidden = |visible: Value| json!({"KHR_node_visibility": {"visible": visible}});
    document["extensionsUsed"] = json!(["KHR_node_visibility"]);
    document["nodes"] = json!([
        {"mesh": 0, "children": [1, 2, 4], "extensions": {"KHR_node_visibility": {}}},
        {"mesh": 0, "extensions": hidden(json!(true))},
        {"extensions": hidden(json!(false)), "children": [3]},
        {"mesh": 0, "extensions": hidden(json!(true))},
        {"mesh": 0, "extensions": hidden(json!(false))},
    ]);
    document["scenes"] = json!([{"nodes": [0]}]);
    for required in [json!([]), json!(["KHR_node_visibility"])] {
        document["extensionsRequired"] = required;
        let mesh = gltf(&document, &binary).expect("a mesh");
        check(&mesh);
        assert_eq!(mesh.parts.iter().map(|part| part.node).collect::<Vec<_>>(), [Some(0), Some(1)]);
        assert_eq!(mesh.warnings, ["nodes with a mesh are hidden by KHR_node_visibility and were left out: 2"]);
    }
    document["nodes"][0]["extensions"] = hidden(json!(false));
    let error = refused(&document, &binary);
    assert!(error.message.ends_with("KHR_node_visibility hides every node of the scene that has a mesh: 4"), "{error}");
    document["nodes"][0]["extensions"] = hidden(json!("no"));
    assert!(refused(&document, &binary).message.contains("visible"));
}
