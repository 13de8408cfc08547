//! glTF: parts under different transforms whose borders meet are one surface.

use serde_json::{Value, json};
use tesserae_mesh::mesh::PolygonMesh;
use tesserae_mesh::surface::Surface;

use crate::make::{check, floats, glb, read_glb};

/// Squares along an edge of a side of the box.
const STEPS: u32 = 5;

type Matrix = [[f64; 3]; 3];

/// A rotation about the axis of a unit quaternion x, y, z, w.
fn rotation([x, y, z, w]: [f64; 4]) -> Matrix {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// The box [−0.7, 0.7]³ with each of its six sides in a node of its own, under another rotation and translation. Each
/// vertex is rounded to f32 in the frame of its node, and each node's transform to f32 as exporters write it.
fn box_of_nodes(offset: f64) -> Vec<u8> {
    let mut binary = Vec::new();
    let mut nodes = Vec::new();
    let (mut accessors, mut views, mut meshes): (Vec<Value>, Vec<Value>, Vec<Value>) = Default::default();
    for side in 0..6usize {
        let angle = 0.3 + 0.37 * side as f64;
        let axis = [0.6, 0.48, 0.64];
        let quaternion = [axis[0] * angle.sin(), axis[1] * angle.sin(), axis[2] * angle.sin(), angle.cos()];
        let quaternion = quaternion.map(|c| f64::from(c as f32));
        let length = quaternion.iter().map(|c| c * c).sum::<f64>().sqrt();
        let turn = rotation(quaternion.map(|c| c / length));
        let shift = [0.1 * side as f64, -0.35, 1.1].map(|c| f64::from(c as f32));
        let first = binary.len();
        for i in 0..=STEPS {
            for j in 0..=STEPS {
                let at = |step: u32| 1.4 * f64::from(step) / f64::from(STEPS) - 0.7;
                let mut point = [0.0; 3];
                point[side % 3] = if side < 3 { 0.7 } else { -0.7 };
                point[(side + 1) % 3] = at(i);
                point[(side + 2) % 3] = at(j);
                // the inverse of the node's transform
                let moved: [f64; 3] = std::array::from_fn(|axis| point[axis] - shift[axis]);
                let local: [f32; 3] =
                    std::array::from_fn(|axis| (0..3).map(|row| turn[row][axis] * moved[row]).sum::<f64>() as f32);
                binary.extend(floats(&local));
            }
        }
        let indices = binary.len();
        for i in 0..STEPS as u16 {
            for j in 0..STEPS as u16 {
                let corner = |i: u16, j: u16| i * (STEPS as u16 + 1) + j;
                let quad = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                for index in [0, 1, 2, 0, 2, 3] {
                    binary.extend(quad[index].to_le_bytes());
                }
            }
        }
        while binary.len() % 4 != 0 {
            binary.push(0);
        }
        let (vertices, corners) = ((STEPS + 1) * (STEPS + 1), 6 * STEPS * STEPS);
        views.push(json!({"buffer": 0, "byteOffset": first, "byteLength": 12 * vertices}));
        views.push(json!({"buffer": 0, "byteOffset": indices, "byteLength": 2 * corners}));
        accessors.push(json!({"bufferView": 2 * side, "componentType": 5126, "count": vertices, "type": "VEC3"}));
        accessors.push(json!({"bufferView": 2 * side + 1, "componentType": 5123, "count": corners, "type": "SCALAR"}));
        let primitive = json!({"attributes": {"POSITION": 2 * side}, "indices": 2 * side + 1});
        meshes.push(json!({"primitives": [primitive]}));
        nodes.push(json!({"mesh": side, "rotation": quaternion, "translation": shift}));
    }
    nodes.push(json!({"children": [0, 1, 2, 3, 4, 5], "translation": [offset, 0, 0]}));
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [6]}], "nodes": nodes, "meshes": meshes,
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": binary.len()}],
    });
    glb(&document, &binary)
}

fn build(mesh: &PolygonMesh) -> Surface {
    Surface::build(mesh).expect("a surface")
}

#[test]
fn a_box_of_six_rotated_nodes_is_closed() {
    // also far from the origin, where f32 has steps of half a unit
    for offset in [0.0, 6_378_137.25] {
        let mesh = read_glb(&box_of_nodes(offset)).expect("a mesh");
        check(&mesh);
        let counts = build(&mesh).counts;
        assert_eq!((counts.boundary_edges, counts.non_manifold_edges, counts.components), (0, 0, 1), "{offset}");
        assert_eq!((counts.degenerate_faces, counts.duplicate_faces), (0, 0));
        let steps = u64::from(STEPS);
        assert_eq!(counts.welded_vertices, 6 * steps * steps + 2, "as many as a closed box has");
        // of the vertices on twelve edges, those of all sides but the first
        assert!(mesh.adjusted.joined_across_parts > 0);
        assert!(mesh.adjusted.joined_across_parts <= 12 * (steps - 1) + 16, "{:?}", mesh.adjusted);
    }
}

#[test]
fn parts_that_are_only_near_stay_apart() {
    // a gap of a ten-thousandth of the box
    let bytes = box_of_nodes(0.0);
    let json = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    let mut document: Value = serde_json::from_slice(&bytes[20..20 + json]).expect("JSON");
    let x = document["nodes"][0]["translation"][0].as_f64().expect("a number");
    document["nodes"][0]["translation"][0] = json!(x + 1e-4);
    let mesh = read_glb(&glb(&document, &bytes[28 + json..])).expect("a mesh");
    let counts = build(&mesh).counts;
    assert_eq!((counts.components, counts.boundary_edges), (2, 2 * 4 * u64::from(STEPS)));
}

#[test]
fn what_lies_under_one_transform_keeps_its_distances() {
    // two triangles of one node, a billionth apart, and a third of another node that meets both
    let mut binary = floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
    binary.extend(floats(&[1e-9, 0., 0., -1., 0., 0., 0., -1., 0.]));
    let view = |at: u32| json!({"buffer": 0, "byteOffset": 36 * at, "byteLength": 36});
    let accessor = |at: u32| json!({"bufferView": at, "componentType": 5126, "count": 3, "type": "VEC3"});
    let primitive = |at: u32| json!({"attributes": {"POSITION": at}});
    let document = json!({
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}, {"mesh": 1, "rotation": [0, 0, 1, 1e-9]}],
        "meshes": [{"primitives": [primitive(0), primitive(1)]}, {"primitives": [primitive(0)]}],
        "accessors": [accessor(0), accessor(1)], "bufferViews": [view(0), view(1)],
        "buffers": [{"byteLength": binary.len()}],
    });
    let mesh = read_glb(&glb(&document, &binary)).expect("a mesh");
    assert_eq!(mesh.positions[0], [0.0; 3]);
    assert_eq!(mesh.positions[3], [f64::from(1e-9f32), 0.0, 0.0]);
    // a scene with one transform is left as it is
    let mut alone = document.clone();
    alone["nodes"] = json!([{"mesh": 0, "rotation": [0.1, 0.2, 0.3, 0.9]}]);
    assert_eq!(read_glb(&glb(&alone, &binary)).expect("a mesh").adjusted.joined_across_parts, 0);
}
