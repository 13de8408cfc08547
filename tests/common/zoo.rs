//! Meshes of every kind, small enough to compare with the plain version.

use std::path::PathBuf;

use tesserae_mesh::dev::random;
use tesserae_mesh::dev::sample::hard::{cone, stacked_boxes};
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::mesh::{Faces, Format, PolygonMesh};

/// Whether sweeps are as long as `make test-long` makes them, in place of shorter ones.
pub fn is_long() -> bool {
    std::env::var_os("TESSERAE_TEST_LONG").is_some()
}

/// Faces of a mesh of a sweep, of which shorter runs have half.
pub fn sized(faces: u64) -> u64 {
    if is_long() { faces } else { faces / 2 }
}

/// What step `at` of a sweep tries: all of these, in shorter runs one of them in turn.
pub fn in_turn<T: Clone>(at: usize, all: &[T]) -> Vec<T> {
    if is_long() { all.to_vec() } else { vec![all[at % all.len()].clone()] }
}

/// A mesh from positions and faces.
pub fn mesh(positions: &[[f64; 3]], faces: &[&[u32]]) -> PolygonMesh {
    let mut all = Faces::default();
    for corners in faces {
        all.push(corners);
    }
    PolygonMesh::of_one_part(Format::Obj, positions.to_vec(), all)
}

/// A mesh of triangles between points at random: non-manifold edges, duplicates and slivers galore.
pub fn tangle(vertices: u32, faces: usize, seed: u64) -> PolygonMesh {
    let mut states = random(seed);
    let mut next = |bound: u32| ((states() >> 33) % u64::from(bound)) as u32;
    let positions: Vec<[f64; 3]> =
        (0..vertices).map(|_| std::array::from_fn(|_| f64::from(next(1 << 20)) / 1024.0)).collect();
    let corners: Vec<[u32; 3]> = (0..faces).map(|_| std::array::from_fn(|_| next(vertices))).collect();
    let corners: Vec<&[u32]> = corners.iter().map(|corners| &corners[..]).collect();
    mesh(&positions, &corners)
}

/// A polygon, and a triangle at each of its sides, whose tips are at various heights.
pub fn wheel(sides: u32) -> PolygonMesh {
    let at = |turn: f64, radius: f64, height: f64| {
        let (sine, cosine) = (turn * std::f64::consts::TAU / f64::from(sides)).sin_cos();
        [radius * cosine, radius * sine, height]
    };
    let tip = |side: u32| at(f64::from(side) + 0.5, 1.1, f64::from(side * 7919 % 101) / 1000.0);
    let positions: Vec<_> = (0..sides).map(|side| at(f64::from(side), 1.0, 0.0)).chain((0..sides).map(tip)).collect();
    let polygon: Vec<u32> = (0..sides).collect();
    let triangles: Vec<_> = (0..sides).map(|side| [(side + 1) % sides, side, sides + side]).collect();
    let faces: Vec<&[u32]> = std::iter::once(&polygon[..]).chain(triangles.iter().map(|face| &face[..])).collect();
    mesh(&positions, &faces)
}

/// A small mesh beside one a million times as large: two components on very different scales.
pub fn flea_and_elephant() -> PolygonMesh {
    let mut all = generate(Sample::Sphere, 400).expect("a sample");
    let flea = generate(Sample::Sphere, 300).expect("a sample");
    let first = all.positions.len() as u32;
    all.positions.extend(flea.positions.iter().map(|p| p.map(|x| 2.0 + x * 1e-6)));
    for face in 0..flea.faces.len() {
        let corners: Vec<u32> = flea.faces.corners(face).iter().map(|&corner| corner + first).collect();
        all.faces.push(&corners);
    }
    all
}

/// Name and mesh of everything in the zoo.
pub fn all() -> Vec<(String, PolygonMesh)> {
    let mut zoo = Vec::new();
    for sample in Sample::ALL {
        let few = sample.fewest_faces();
        let sizes = [("few", few), ("hundreds", sized(700)), ("thousands", sized(2500))];
        for (size, faces) in sizes.into_iter().filter(|&(_, faces)| faces >= few) {
            let mesh = generate(sample, faces).expect("the sample allows this number");
            zoo.push((format!("{}-{size}", sample.name()), mesh));
        }
    }
    let corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.5, 0.5, 1.0]];
    zoo.push(("one-face".into(), mesh(&corner, &[&[0, 1, 2]])));
    zoo.push(("one-pentagon".into(), mesh(&corner, &[&[0, 1, 3, 4, 2]])));
    zoo.push(("two-sides".into(), mesh(&corner, &[&[0, 1, 2], &[2, 1, 0], &[0, 1, 2]])));
    zoo.push(("point-faces".into(), mesh(&corner, &[&[0, 0, 0], &[1, 1, 1], &[0, 1, 2]])));
    zoo.push(("all-in-one-point".into(), mesh(&[[3.0; 3]; 4], &[&[0, 1, 2], &[1, 2, 3]])));
    zoo.push(("fin".into(), mesh(&corner, &[&[0, 1, 2], &[0, 1, 3], &[0, 1, 4], &[1, 0, 2], &[0, 3, 4]])));
    zoo.push(("tangle-dense".into(), tangle(12, 300, 1)));
    zoo.push(("tangle-sparse".into(), tangle(200, 300, 2)));
    zoo.push(("flea-and-elephant".into(), flea_and_elephant()));
    zoo.push(("cone".into(), cone(300)));
    zoo.push(("stacked-boxes".into(), stacked_boxes(25)));
    let huge: Vec<[f64; 3]> = corner.iter().map(|p| p.map(|x| (x - 0.5) * 1.7e308)).collect();
    zoo.push(("huge".into(), mesh(&huge, &[&[0, 1, 2], &[1, 3, 2], &[0, 1, 4], &[1, 3, 4], &[3, 2, 4]])));
    let tiny: Vec<[f64; 3]> = corner.iter().map(|p| p.map(|x| x * 5e-324)).collect();
    zoo.push(("tiny".into(), mesh(&tiny, &[&[0, 1, 2], &[1, 3, 2], &[0, 1, 4], &[1, 3, 4], &[3, 2, 4]])));
    zoo
}

/// The folder with the real meshes, if there is one; says so otherwise.
pub fn shared_meshes() -> Option<PathBuf> {
    let folder =
        std::env::var_os("TESSERAE_TEST_MESHES").map_or_else(|| super::root().join("../shared/meshes"), PathBuf::from);
    if !folder.is_dir() {
        eprintln!("notice: no real meshes at {}: skipped (set TESSERAE_TEST_MESHES)", folder.display());
        return None;
    }
    Some(folder)
}
