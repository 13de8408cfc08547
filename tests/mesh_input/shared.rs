//! Real meshes, compared with what is known of them.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Beside, Format, Limits, PolygonMesh};
use tesserae_mesh::surface::Surface;

use crate::make::check;
use crate::ply_forms::compare;

/// The folder of the meshes, if they are there.
fn folder() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/meshes");
    let folder = std::env::var_os("TESSERAE_TEST_MESHES").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("no test meshes in {}: nothing was compared", folder.display());
    None
}

fn read(path: &Path) -> tesserae_mesh::Result<PolygonMesh> {
    let bytes = std::fs::read(path).expect("a file");
    let name = path.file_name().and_then(|name| name.to_str());
    let format = Format::recognise(name, &bytes, Some(bytes.len() as u64))?;
    let folder = path.parent().expect("a folder").to_owned();
    mesh::read(&bytes, format, &Beside { folder }, &Limits::default())
}

/// Positions that differ as f32.
fn distinct(mesh: &PolygonMesh) -> usize {
    let as_bits = |position: &[f64; 3]| position.map(|c| (c as f32 + 0.0).to_bits());
    mesh.positions.iter().map(as_bits).collect::<HashSet<_>>().len()
}

#[test]
fn every_mesh_has_the_known_number_of_triangles_and_vertices() {
    let Some(folder) = folder() else { return };
    let table = std::fs::read_to_string(folder.join("meshes.tsv")).expect("a table");
    let mut seen = 0;
    for row in table.lines().skip(1) {
        let fields: Vec<&str> = row.split('\t').collect();
        let number = |field: usize| -> u64 { fields[field].parse().expect("a number") };
        let path = folder.join(fields[0]);
        let known = [".obj", ".glb", ".gltf", ".ply", ".stl"].iter().any(|end| fields[0].ends_with(end));
        if !known {
            continue;
        }
        seen += 1;
        if fields[0].contains("draco") {
            let error = read(&path).expect_err("Draco is not read");
            assert_eq!(error.kind, Kind::UnsupportedMesh);
            assert!(error.message.contains("KHR_draco_mesh_compression"));
            continue;
        }
        let mesh = read(&path).unwrap_or_else(|error| panic!("{}: {error}", fields[0]));
        check(&mesh);
        assert_eq!(mesh.faces.triangles(), number(3), "triangles of {}", fields[0]);
        assert_eq!(distinct(&mesh) as u64, number(2), "positions of {}", fields[0]);
        // the table counts each primitive once, we count each placement
        let placements = match fields[0] {
            "gltf/Axes-gpu-instancing.glb" => 4 * number(1),
            "gltf/CesiumMilkTruck.glb" => mesh.positions.len() as u64,
            _ => number(1),
        };
        assert_eq!(mesh.positions.len() as u64, placements, "vertices of {}", fields[0]);
    }
    assert!(seen > 39, "{seen}");
}

/// Sets of triangles connected by shared positions, triangles with a position twice left out.
fn components_by_position(mesh: &PolygonMesh) -> u64 {
    let mut numbers = HashMap::new();
    let mut positions: Vec<usize> = Vec::new();
    for position in &mesh.positions {
        let next = numbers.len();
        positions.push(*numbers.entry(position.map(|c| (c as f32 + 0.0).to_bits())).or_insert(next));
    }
    fn root(parents: &mut [usize], mut at: usize) -> usize {
        while parents[at] != at {
            parents[at] = parents[parents[at]];
            at = parents[at];
        }
        at
    }
    let mut parents: Vec<usize> = (0..numbers.len()).collect();
    let mut used = HashSet::new();
    for face in 0..mesh.faces.len() {
        let &[a, b, c] = mesh.faces.corners(face) else { panic!("a triangle") };
        let [a, b, c] = [a, b, c].map(|vertex| positions[vertex as usize]);
        if a == b || b == c || c == a {
            continue;
        }
        used.insert(a);
        for other in [b, c] {
            let (one, other) = (root(&mut parents, a), root(&mut parents, other));
            parents[one] = other;
        }
    }
    used.into_iter().map(|position| root(&mut parents, position)).collect::<HashSet<_>>().len() as u64
}

/// Edges and unusual faces; ours are counted on f64, those of the table on f32, without degenerate faces.
#[test]
fn every_mesh_of_triangles_has_the_known_edges_and_components() {
    let Some(folder) = folder() else { return };
    let table = std::fs::read_to_string(folder.join("meshes.tsv")).expect("a table");
    let mut compared = 0;
    for row in table.lines().skip(1) {
        let fields: Vec<&str> = row.split('\t').collect();
        let number = |field: usize| -> u64 { fields[field].parse().expect("a number") };
        let name = fields[0];
        if ![".obj", ".glb", ".gltf", ".ply", ".stl"].iter().any(|end| name.ends_with(end)) || name.contains("draco") {
            continue;
        }
        let mesh = read(&folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        if mesh.faces.triangles() != mesh.faces.len() as u64 {
            continue;
        }
        assert_eq!(components_by_position(&mesh), number(4), "components by position of {name}");
        let counts = Surface::build(&mesh).expect("a surface").counts;
        // what differs in f64 only is one position in the table
        let exact: HashSet<_> = mesh.positions.iter().map(|position| position.map(|c| (c + 0.0).to_bits())).collect();
        if exact.len() as u64 != number(2) {
            eprintln!("{name}: {} positions, the table has {}", exact.len(), number(2));
            continue;
        }
        compared += 1;
        assert!(counts.components + counts.loose_faces >= number(4), "components of {name}");
        assert_eq!(counts.boundary_edges, number(5), "boundary edges of {name}");
        assert_eq!(counts.non_manifold_edges, number(6), "non-manifold edges of {name}");
        assert_eq!(counts.degenerate_faces, number(7), "degenerate faces of {name}");
        if counts.degenerate_faces == 0 {
            assert_eq!(counts.duplicate_faces, number(9), "duplicates of {name}");
            assert!(counts.zero_area_faces >= number(8), "faces without area of {name}");
        }
    }
    assert!(compared > 20, "{compared}");
}

#[test]
fn polygons_are_faces() {
    let Some(folder) = folder() else { return };
    for (name, faces) in [
        ("cube-quads.obj", 6),
        ("octagon.obj", 1),
        ("greek-helmet.obj", 4856),
        ("office-chair.obj", 3391),
        ("spot-control-mesh.obj", 180),
        ("suzanne.obj", 500),
        ("pirate.obj", 2527),
    ] {
        let mesh = read(&folder.join(name)).expect("a mesh");
        assert_eq!(mesh.faces.len(), faces, "{name}");
    }
}

#[test]
fn compressed_meshes_are_near_their_originals() {
    let Some(folder) = folder() else { return };
    for (plain, packed, tolerance) in [
        ("spot.obj", "gltf/spot-quantized.glb", 1e-4),
        ("pirate.obj", "gltf/pirate-meshopt.glb", 1e-4),
        ("gltf/Duck/Duck.gltf", "gltf/Duck-meshopt.glb", 3e-4),
    ] {
        let [plain, packed] = [plain, packed].map(|name| read(&folder.join(name)).expect("a mesh"));
        assert_eq!(plain.faces.triangles(), packed.faces.triangles());
        let size = extent(&plain).iter().map(|[low, high]| high - low).fold(0.0, f64::max);
        // every vertex of one has one of the other close by
        let far = |from: &PolygonMesh, to: &PolygonMesh| {
            from.positions
                .iter()
                .map(|a| to.positions.iter().map(|b| distance(a, b)).fold(f64::INFINITY, f64::min))
                .fold(0.0, f64::max)
        };
        let (there, back) = (far(&plain, &packed) / size, far(&packed, &plain) / size);
        assert!(there < tolerance && back < tolerance, "{there} {back}");
    }
}

#[test]
fn the_same_mesh_in_two_formats_is_the_same() {
    let Some(folder) = folder() else { return };
    for name in ["horse", "stanford-bunny"] {
        let [obj, glb] = ["obj", "glb"].map(|end| read(&folder.join(format!("{name}.{end}"))).expect("a mesh"));
        assert_eq!(obj.faces, glb.faces);
        let far = obj.positions.iter().zip(&glb.positions).map(|(a, b)| distance(a, b));
        assert!(far.fold(0.0, f64::max) < 1e-6, "{name}");
    }
}

#[test]
fn ply_and_stl_files_are_the_meshes_that_they_are_elsewhere() {
    let Some(folder) = folder() else { return };
    // text, big endian, little endian
    for (ply, other) in [
        ("stanford-bunny.ply", "stanford-bunny.obj"),
        ("horse.ply", "horse.obj"),
        ("armadillo-172k.ply", "armadillo-172k.glb"),
    ] {
        let [mesh, other] = [ply, other].map(|name| read(&folder.join(name)).expect("a mesh"));
        assert!(mesh.faces == other.faces, "{ply}");
        let far = mesh.positions.iter().zip(&other.positions).map(|(a, b)| distance(a, b));
        let size = extent(&mesh).iter().map(|[low, high]| high - low).fold(0.0, f64::max);
        assert!(far.fold(0.0, f64::max) < 1e-5 * size, "{ply}");
        compare(&mesh, &std::fs::read(folder.join(ply)).expect("a file"));
    }
    let stl = folder.join("featuretype.stl");
    let mesh = read(&stl).expect("a mesh");
    crate::stl_forms::compare(&mesh, &std::fs::read(&stl).expect("a file"));
    assert!(mesh.warnings.is_empty());
}

#[test]
fn instances_and_nodes_are_parts() {
    let Some(folder) = folder() else { return };
    let axes = read(&folder.join("gltf/Axes-gpu-instancing.glb")).expect("a mesh");
    assert_eq!(axes.parts.len(), 24);
    let instances: Vec<_> = axes.parts[..8].iter().map(|part| (part.node, part.instance)).collect();
    let expected = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2), (1, 3)];
    assert_eq!(instances, expected.map(|(node, instance)| (Some(node), Some(instance))));
    assert_eq!(axes.parts[0].group.as_deref(), Some("node_1"));

    let truck = read(&folder.join("gltf/CesiumMilkTruck.glb")).expect("a mesh");
    let origins: Vec<_> = truck.parts.iter().map(|part| (part.node, part.mesh, part.primitive)).collect();
    let expected = [(0, 0, 0), (0, 0, 1), (0, 0, 2), (4, 1, 0), (2, 1, 0)];
    assert_eq!(origins, expected.map(|(n, m, p)| (Some(n), Some(m), Some(p))));
    assert!(truck.parts.iter().all(|part| part.instance.is_none()));

    let morph = read(&folder.join("gltf/AnimatedMorphCube/AnimatedMorphCube.gltf")).expect("a mesh");
    assert!(morph.warnings.iter().any(|warning| warning.contains("morph targets")));
}

#[test]
fn other_formats_are_told_apart() {
    let Some(folder) = folder() else { return };
    let error = read(&folder.join("stanford-dragon.glb.gz")).expect_err("not read");
    assert_eq!(error.kind, Kind::UnsupportedMediaType);
}

/// Lowest and highest coordinate of each axis.
fn extent(mesh: &PolygonMesh) -> [[f64; 2]; 3] {
    std::array::from_fn(|axis| {
        let coordinates = mesh.positions.iter().map(|p| p[axis]);
        let low = coordinates.clone().fold(f64::INFINITY, f64::min);
        [low, coordinates.fold(f64::NEG_INFINITY, f64::max)]
    })
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}
