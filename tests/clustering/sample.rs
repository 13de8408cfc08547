//! Samples are what their documentation says, and the same everywhere.

use std::collections::HashMap;

use sha2::{Digest, Sha256};
use tesserae_mesh::dev::sample::{MAX_FACES, Sample, generate, write_glb, write_obj};
use tesserae_mesh::mesh::PolygonMesh;

fn made(sample: Sample, faces: u64) -> PolygonMesh {
    generate(sample, faces).expect("an allowed number of faces")
}

fn obj(mesh: &PolygonMesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_obj(&mut bytes, mesh).expect("a vector takes everything");
    bytes
}

fn glb(mesh: &PolygonMesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_glb(&mut bytes, mesh).expect("a vector takes everything");
    bytes
}

/// How often each edge is used: from the smaller vertex to the larger, and back.
fn edge_uses(mesh: &PolygonMesh) -> HashMap<(u32, u32), [u32; 2]> {
    let mut uses: HashMap<(u32, u32), [u32; 2]> = HashMap::new();
    for face in 0..mesh.faces.len() {
        let corners = mesh.faces.corners(face);
        for (i, &from) in corners.iter().enumerate() {
            let to = corners[(i + 1) % corners.len()];
            assert_ne!(from, to, "face {face} has a corner twice");
            uses.entry((from.min(to), from.max(to))).or_default()[usize::from(from > to)] += 1;
        }
    }
    uses
}

/// Vertices − edges + faces.
fn euler(mesh: &PolygonMesh, edges: usize) -> i64 {
    mesh.positions.len() as i64 - edges as i64 + mesh.faces.len() as i64
}

/// Six times the volume between the faces and the origin.
fn volume(mesh: &PolygonMesh) -> f64 {
    let at = |corner: u32| mesh.positions[corner as usize];
    let mut sum = 0.0;
    for face in 0..mesh.faces.len() {
        let corners = mesh.faces.corners(face);
        for i in 1..corners.len() - 1 {
            let [a, b, c] = [corners[0], corners[i], corners[i + 1]].map(at);
            sum += a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0]);
        }
    }
    sum
}

/// Twice the area of each triangle of a mesh of triangles.
fn areas(mesh: &PolygonMesh) -> Vec<f64> {
    let area = |face: usize| {
        let corners = mesh.faces.corners(face);
        let [a, b, c]: [_; 3] = std::array::from_fn(|i| mesh.positions[corners[i] as usize]);
        let [u, v]: [[f64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|x| p[x] - a[x]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        normal.map(|x| x * x).iter().sum::<f64>().sqrt()
    };
    (0..mesh.faces.len()).map(area).collect()
}

#[test]
fn closed_shapes_are_manifolds_of_the_right_genus_wound_outwards() {
    for (sample, characteristic) in [
        (Sample::Sphere, 2),
        (Sample::Icosphere, 2),
        (Sample::Torus, 0),
        (Sample::Knot, 0),
        (Sample::Parts, 9 * 2),
        (Sample::Part, 2),
        (Sample::Quads, 2),
        (Sample::Cube, 2),
    ] {
        let fewest = sample.fewest_faces();
        for faces in [fewest, 251, 1000, 2003, 30_000] {
            let mesh = made(sample, faces.max(fewest));
            let uses = edge_uses(&mesh);
            assert!(
                uses.values().all(|uses| *uses == [1, 1]),
                "{sample:?} of {faces}: an edge is not shared by two faces"
            );
            assert_eq!(euler(&mesh, uses.len()), characteristic, "{sample:?} of {faces}");
            assert!(volume(&mesh) > 0.0, "{sample:?} of {faces} is inside out");
        }
    }
}

#[test]
fn open_shapes_are_discs_seen_from_above() {
    for sample in [Sample::Terrain, Sample::Plane, Sample::Strip] {
        for faces in [sample.fewest_faces(), 7, 2003] {
            let mut mesh = made(sample, faces);
            let uses = edge_uses(&mesh);
            assert!(uses.values().all(|uses| uses[0] < 2 && uses[1] < 2));
            assert!(uses.values().any(|uses| uses[0] + uses[1] == 1));
            assert_eq!(euler(&mesh, uses.len()), 1, "{sample:?} of {faces}");
            mesh.positions.iter_mut().for_each(|p| p[2] += 10.0);
            assert!(volume(&mesh) > 0.0, "{sample:?} of {faces} is upside down");
        }
    }
}

#[test]
fn the_number_of_faces_is_close_to_the_request() {
    for sample in Sample::ALL {
        let first = match sample {
            Sample::Cube | Sample::Parts | Sample::Part => 1500,
            _ => 200,
        };
        for faces in [200, 333, 1500, 1750, 10_007, 69_451] {
            if faces >= first {
                let made = made(sample, faces).faces.len() as u64;
                assert!(made.abs_diff(faces) * 10 <= faces, "{sample:?}: {made} instead of {faces}");
            }
        }
    }
    assert_eq!(made(Sample::Sphere, 1001).faces.len(), 1002);
    assert_eq!(made(Sample::Icosphere, 1200).faces.len(), 1280);
    assert_eq!(made(Sample::Strip, 1001).faces.len(), 1001);
    assert_eq!(made(Sample::Cube, 1200).faces.len(), 1200);
}

#[test]
fn flat_shapes_and_the_cube_have_equal_triangles_and_the_sphere_nearly_so() {
    for (sample, spread) in
        [(Sample::Plane, 1.0), (Sample::Strip, 1.0), (Sample::Cube, 1.000_01), (Sample::Sphere, 1.6)]
    {
        let areas = areas(&made(sample, 12_288));
        let least = areas.iter().copied().fold(f64::INFINITY, f64::min);
        let most = areas.iter().copied().fold(0.0, f64::max);
        assert!(least > 0.0 && most / least <= spread, "{sample:?}: areas from {least} to {most}");
    }
}

#[test]
fn every_part_has_vertices_of_its_own() {
    let mesh = made(Sample::Parts, 5000);
    assert_eq!(mesh.parts.len(), 12);
    let (mut next_face, mut next_vertex) = (0, 0);
    for part in &mesh.parts {
        assert_eq!(part.first_face, next_face);
        next_face += part.faces;
        let corners = || (part.first_face..next_face).flat_map(|face| mesh.faces.corners(face as usize));
        assert_eq!(corners().min(), Some(&next_vertex), "{part:?}");
        next_vertex = corners().max().map_or(0, |last| last + 1);
    }
    assert_eq!(next_face, mesh.faces.len() as u64);
    assert_eq!(next_vertex as usize, mesh.positions.len());
}

#[test]
fn requests_out_of_range_are_refused_with_the_range() {
    for (faces, named) in [(17, "between 18 and 50000000"), (0, "not 0"), (MAX_FACES + 1, "not 50000001")] {
        let error = generate(Sample::Torus, faces).expect_err("out of range");
        assert!(error.message.contains(named), "{error}");
    }
}

#[test]
fn obj_holds_every_position_and_polygon_exactly() {
    let mesh = made(Sample::Quads, 300);
    let text = String::from_utf8(obj(&mesh)).expect("text");
    let (mut vertex, mut face) = (0, 0);
    for line in text.lines() {
        if let Some(line) = line.strip_prefix("v ") {
            let position: Vec<f64> = line.split(' ').map(|x| x.parse().expect("f64")).collect();
            assert_eq!(position, mesh.positions[vertex]);
            vertex += 1;
        } else if let Some(line) = line.strip_prefix("f ") {
            let corners: Vec<u32> = line.split(' ').map(|x| x.parse().expect("u32")).collect();
            assert_eq!(corners.len(), 4);
            let expected: Vec<u32> = mesh.faces.corners(face).iter().map(|c| c + 1).collect();
            assert_eq!(corners, expected);
            face += 1;
        } else {
            assert_eq!(line, "o quads");
        }
    }
    assert_eq!((vertex, face), (mesh.positions.len(), mesh.faces.len()));
}

#[test]
fn glb_says_what_it_holds() {
    for (sample, triangles_a_face) in [(Sample::Parts, 1), (Sample::Knot, 1), (Sample::Quads, 2)] {
        let mesh = made(sample, 2000);
        let bytes = glb(&mesh);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!((word(4), word(8)), (2, bytes.len()));
        let json_end = 20 + word(12);
        assert_eq!(&bytes[16..20], b"JSON");
        assert_eq!((json_end % 4, word(json_end)), (0, bytes.len() - json_end - 8));
        assert_eq!(&bytes[json_end + 4..json_end + 8], b"BIN\0");

        let file = gltf::Gltf::from_slice(&bytes).expect("valid glTF");
        let binary = file.blob.as_deref().expect("a binary chunk");
        let scene = file.default_scene().expect("a scene");
        assert_eq!(scene.nodes().count(), mesh.parts.len());
        let mut face = 0;
        for (node, part) in scene.nodes().zip(&mesh.parts) {
            assert_eq!(node.name(), part.group.as_deref());
            let mesh_of_node = node.mesh().expect("a mesh");
            let primitive = mesh_of_node.primitives().next().expect("a primitive");
            let words = |accessor: &gltf::Accessor<'_>, width: usize| -> Vec<[u8; 4]> {
                let view = accessor.view().expect("a buffer view");
                let start = view.offset() + accessor.offset();
                assert!(accessor.offset() + 4 * width * accessor.count() <= view.length());
                let bytes = &binary[start..start + 4 * width * accessor.count()];
                bytes.chunks(4).map(|w| w.try_into().expect("four bytes")).collect()
            };
            let accessor = primitive.get(&gltf::Semantic::Positions).expect("positions");
            let floats: Vec<f32> = words(&accessor, 3).into_iter().map(f32::from_le_bytes).collect();
            let positions: Vec<[f32; 3]> = floats.chunks(3).map(|p| p.try_into().expect("three numbers")).collect();
            let bounds = primitive.bounding_box();
            for axis in 0..3 {
                let values = || positions.iter().map(|p| p[axis]);
                assert_eq!(values().fold(f32::INFINITY, f32::min), bounds.min[axis]);
                assert_eq!(values().fold(f32::NEG_INFINITY, f32::max), bounds.max[axis]);
            }
            let accessor = primitive.indices().expect("indices");
            let corners: Vec<u32> = words(&accessor, 1).into_iter().map(u32::from_le_bytes).collect();
            assert_eq!(corners.len() as u64, 3 * triangles_a_face * part.faces);
            for triangles in corners.chunks(3 * triangles_a_face as usize) {
                let expected: Vec<u32> = fan(mesh.faces.corners(face));
                for (corner, expected) in triangles.iter().zip(expected) {
                    let position = positions[*corner as usize].map(f64::from);
                    assert_eq!(position, mesh.positions[expected as usize]);
                }
                face += 1;
            }
        }
        assert_eq!(face, mesh.faces.len());
    }
}

/// Corners of the triangles of a polygon.
fn fan(corners: &[u32]) -> Vec<u32> {
    (1..corners.len() - 1).flat_map(|i| [corners[0], corners[i], corners[i + 1]]).collect()
}

#[test]
fn samples_are_the_same_on_every_machine() {
    let sha256 = |bytes: &[u8]| -> String {
        let digest = Sha256::digest(bytes);
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    };
    let mut changed = String::new();
    for (sample, (name, pinned)) in Sample::ALL.into_iter().zip(PINNED) {
        assert_eq!(sample.name(), name);
        let mesh = made(sample, 2000);
        let now = sha256(&[obj(&mesh), glb(&mesh)].concat());
        if now != pinned {
            changed += &format!("(\"{name}\", \"{now}\"),\n");
        }
    }
    assert!(changed.is_empty(), "changed:\n{changed}");
}

/// SHA-256 of the OBJ followed by the GLB of every sample at 2,000 faces.
const PINNED: [(&str, &str); 11] = [
    ("sphere", "e1fdf902aa1eb2b1e15930db5c970d0456d3362035a9e3305f41c0c5e5f3e915"),
    ("icosphere", "faaac69e3aebea3c8108a22ede0392abc791f6d8f9a8419b0f212d03a532baf2"),
    ("torus", "038bd55f0c348052dcc763012a6f04801faf4fbdf26bac3feed3e8695367aac7"),
    ("knot", "1cf57eea5fb8c5f9d1d1eb07aa8e46291bc8c8278c866147fc70b49ebdf59247"),
    ("terrain", "66481e457051df50d6a0ad822d0a8a85150a8c18abf760e992856fe4c026b5bc"),
    ("parts", "8c25a6420ff1b5fe37d4f772c848cdd6f79425bc1439da9a260e9cc8ef4e360d"),
    ("part", "1758389ecd3651a7c152ab84fd8d40ffad15310f0d337be7254aa2b4010f8cbf"),
    ("quads", "56f0874ef484941cf5e9958121f0749f890e05b23c493b78cd4aee89128d9732"),
    ("plane", "f456259eb9b16688a0682d8ef3344703599d4d4eaf7e243934dec712bbd5583e"),
    ("strip", "e8e25d6a87ebf03a3f46b89caa11b38a8d2a4f1bdedc037eb51570ccd63c4a7a"),
    ("cube", "ea28ab8e90a093253831a031d5236b4c1a6d0c1892d2652930aac289373a7b44"),
];
