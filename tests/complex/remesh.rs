//! The remesh is a manifold with the topology of the mesh, whatever the labels.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use proptest::prelude::*;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::mesh::PolygonMesh;
use tesserae_mesh::mesh::divide::divided;
use tesserae_mesh::remesh::{Placement, Remesh, Summary, VertexKind, remesh};

use super::checker::{look, oriented, welded};
use super::common::zoo;
use super::labels::{Kind, Recipe, recipe};

static ZOO: LazyLock<Vec<(String, PolygonMesh)>> = LazyLock::new(|| [zoo::all(), pinched()].concat());

/// Meshes that are no manifolds, and a surface that cannot be oriented.
fn pinched() -> Vec<(String, PolygonMesh)> {
    let corner =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 2.0], [-1.0, 1.0, 1.0]];
    let tetrahedra: &[&[u32]] =
        &[&[0, 2, 1], &[0, 1, 3], &[0, 3, 2], &[1, 2, 3], &[0, 1, 4], &[0, 5, 1], &[0, 4, 5], &[1, 5, 4]];
    let ring = |columns: u32, is_twisted: bool| {
        let place = |at: u32| {
            let turn = f64::from(at / 2) / f64::from(columns) * 6.0;
            [turn.cos(), turn.sin(), f64::from(at % 2)]
        };
        let positions: Vec<[f64; 3]> = (0..2 * columns).map(place).collect();
        let at = |column: u32, row: u32| match column == columns {
            true => u32::from(is_twisted) ^ row,
            false => 2 * column + row,
        };
        let quads: Vec<[u32; 4]> = (0..columns).map(|c| [at(c, 0), at(c + 1, 0), at(c + 1, 1), at(c, 1)]).collect();
        let quads: Vec<&[u32]> = quads.iter().map(|quad| &quad[..]).collect();
        zoo::mesh(&positions, &quads)
    };
    let mut hourglass = generate(Sample::Sphere, 300).expect("a sample");
    let top = hourglass.positions.len() as u32;
    let shifted: Vec<[f64; 3]> = hourglass.positions.iter().map(|&[x, y, z]| [x, y, z + 2.0]).collect();
    let joint = hourglass.positions[0];
    hourglass.positions.extend(shifted);
    let first = hourglass.faces.corners(0)[0];
    for face in 0..hourglass.faces.len() {
        let corners: Vec<u32> = hourglass.faces.corners(face).iter().map(|&corner| corner + top).collect();
        hourglass.faces.push(&corners);
    }
    hourglass.positions[first as usize] = joint;
    hourglass.positions[(first + top) as usize] = hourglass.positions[first as usize];
    vec![
        ("tetrahedra-at-an-edge".into(), zoo::mesh(&corner, tetrahedra)),
        ("cushion".into(), zoo::mesh(&corner, &[&[0, 1, 2], &[0, 1, 2]])),
        ("annulus".into(), ring(12, false)),
        ("moebius".into(), ring(12, true)),
        ("hourglass".into(), hourglass),
        ("bow-tie".into(), zoo::mesh(&corner, &[&[0, 1, 2], &[0, 3, 4]])),
    ]
}

/// Makes and checks a remesh.
fn sound(mesh: &PolygonMesh, labels: &[u32], clusters: u64, placement: Placement) -> Remesh {
    let made = remesh(mesh, labels, clusters, placement).expect("labels fit");
    let found = look(&made.triangles);
    assert_eq!(found.faults, BTreeSet::new());
    let summary = made.summary;
    let said = (summary.euler, summary.loops as usize, summary.components as usize);
    assert_eq!((found.euler, found.loops, found.components), said);
    if let Some(oriented) = oriented(welded(mesh).0) {
        let of_mesh = look(&oriented);
        assert_eq!((found.euler, found.loops, found.components), (of_mesh.euler, of_mesh.loops, of_mesh.components));
    }
    assert_eq!((made.points.len(), made.triangles.len() as u64), (made.sources.len(), summary.triangles));
    let counts = summary.vertices;
    assert_eq!(counts.clusters, clusters);
    assert_eq!(counts.clusters + counts.split + counts.boundary + counts.extra, made.points.len() as u64);
    check_sources(mesh, labels, &made);
    made
}

/// Sources are points of the upload's faces, of the clusters that they name.
fn check_sources(mesh: &PolygonMesh, labels: &[u32], made: &Remesh) {
    assert!(made.sources.is_sorted_by_key(|source| source.kind as u8));
    for (vertex, source) in made.sources.iter().enumerate() {
        let corners = mesh.faces.corners(source.face as usize);
        assert!(source.vertices.iter().all(|vertex| corners.contains(vertex)), "{source:?}");
        let sum: f64 = source.barycentric.iter().sum();
        assert!((sum - 1.0).abs() < 1e-9 && source.barycentric.iter().all(|&part| part >= -1e-9), "{source:?}");
        if source.kind == VertexKind::Cluster {
            assert_eq!(source.cluster as usize, vertex);
        }
        if labels.contains(&source.cluster) {
            assert_eq!(labels[source.face as usize], source.cluster);
        }
        assert!(made.points[vertex].is_finite(), "{source:?}");
        if source.kind == VertexKind::Boundary {
            let scale = mesh.positions.as_flattened().iter().fold(0.0f64, |size, x| size.max(x.abs()));
            for axis in 0..3 {
                let parts = source.vertices.iter().zip(source.barycentric);
                let sum: f64 = parts.map(|(&vertex, part)| mesh.positions[vertex as usize][axis] * part).sum();
                assert!((sum - made.points[vertex][axis]).abs() <= scale * 1e-9, "{source:?}");
            }
        }
    }
}

proptest! {
    #[test]
    fn random_labels_give_manifolds_with_the_topology_of_the_mesh(
        which in any::<prop::sample::Index>(),
        recipe in recipe(),
    ) {
        let (_, mesh) = which.get(&ZOO);
        let (labels, clusters) = recipe.labels(mesh);
        sound(mesh, &labels, clusters, Placement::Surface);
    }

    #[test]
    fn fitted_ones_are_manifolds_too(which in any::<prop::sample::Index>(), recipe in recipe()) {
        let (_, mesh) = which.get(&ZOO);
        let (labels, clusters) = recipe.labels(mesh);
        let made = sound(mesh, &labels, clusters, Placement::Fit);
        // the fit moves vertices only
        let other = remesh(mesh, &labels, clusters, Placement::Fit).expect("labels fit");
        prop_assert_eq!(made, other);
    }
}

/// Whether a mesh has so many edges of several faces that it is cut into many parts.
fn cut_apart(name: &str) -> bool {
    name.starts_with("tangle") || name == "stacked-boxes"
}

#[test]
fn one_to_three_clusters_are_enough_for_every_mesh() {
    for (name, mesh) in ZOO.iter() {
        for clusters in 1..=3u64.min(mesh.faces.len() as u64) {
            for placement in [Placement::Centroid, Placement::Surface, Placement::Fit] {
                let recipe = Recipe { kind: Kind::Nearest, clusters: clusters as u32, noise: 0, seed: 3 };
                let (labels, _) = recipe.labels(mesh);
                let made = sound(mesh, &labels, clusters, placement);
                assert!(made.points.len() < 40 * (clusters as usize + 12) || cut_apart(name), "{name}");
            }
        }
    }
}

#[test]
fn surfaces_of_the_textbook_keep_their_numbers() {
    let of = |name: &str| ZOO.iter().find(|(other, _)| other == name).map(|(_, mesh)| mesh).expect("in the zoo");
    for (name, euler, loops, components, cut_edges) in [
        ("sphere-hundreds", 2, 0, 1, 0),
        ("torus-hundreds", 0, 0, 1, 0),
        ("terrain-hundreds", 1, 1, 1, 0),
        ("annulus", 0, 2, 1, 0),
        ("moebius", 1, 1, 1, 1),
        ("tetrahedra-at-an-edge", 2, 2, 2, 1),
        ("cushion", 2, 0, 1, 0),
        ("bow-tie", 2, 2, 2, 0),
        ("hourglass", 4, 0, 2, 0),
    ] {
        let mesh = of(name);
        for clusters in [1u32, 2, 3] {
            let clusters = clusters.min(mesh.faces.len() as u32);
            let labels: Vec<u32> = (0..mesh.faces.len() as u32).map(|face| face % clusters).collect();
            let summary = sound(mesh, &labels, u64::from(clusters), Placement::Fit).summary;
            let found = (summary.euler, summary.loops, summary.components, summary.cut_edges);
            assert_eq!(found, (euler, loops, components, cut_edges), "{name} {clusters}");
        }
    }
}

#[test]
fn every_face_a_cluster_and_clusters_without_faces_are_possible() {
    for (name, mesh) in ZOO.iter().filter(|(_, mesh)| mesh.faces.len() < 1000) {
        let faces = mesh.faces.len() as u64;
        let labels: Vec<u32> = (0..faces as u32).collect();
        sound(mesh, &labels, faces, Placement::Surface);
        let labels = vec![faces as u32 - 1; faces as usize];
        let made = sound(mesh, &labels, faces, Placement::Fit);
        assert_eq!(made.summary.vertices.clusters, faces, "{name}");
    }
}

#[test]
fn divided_faces_change_no_topology() {
    let mut seen = 0;
    for (number, (name, mesh)) in (0..).zip(ZOO.iter()).filter(|(_, (name, _))| name != "tiny") {
        // triangles at the same corners come apart where they are divided, and edges are cut anywhere on a twisted band
        let triangles = welded(mesh).0;
        if look(&triangles).faults.contains("a triangle is there twice") || oriented(triangles).is_none() {
            continue;
        }
        seen += 1;
        let (fine, _) = divided(mesh, 1).expect("few faces");
        let recipe = Recipe { kind: Kind::Nearest, clusters: 20, noise: 1, seed: number };
        let (labels, clusters) = recipe.labels(&fine);
        let of_fine = sound(&fine, &labels, clusters, Placement::Fit).summary;
        let whole = sound(mesh, &vec![0; mesh.faces.len()], 1, Placement::Surface).summary;
        let topology = |summary: Summary| (summary.euler, summary.loops, summary.components);
        assert_eq!((topology(of_fine), of_fine.cut_edges), (topology(whole), 2 * whole.cut_edges), "{name}");
    }
    assert!(seen > 10, "{seen} of {} meshes", ZOO.len());
}

#[test]
fn a_vertex_at_which_many_clusters_meet_takes_no_time() {
    let corners = 4000;
    let mut positions = vec![[0.0, 0.0, 1.0]];
    positions.extend((0..corners).map(|corner| {
        let turn = f64::from(corner) / f64::from(corners) * std::f64::consts::TAU;
        [turn.cos(), turn.sin(), 0.0]
    }));
    let faces: Vec<[u32; 3]> = (0..corners).map(|corner| [0, 1 + corner, 1 + (corner + 1) % corners]).collect();
    let faces: Vec<&[u32]> = faces.iter().map(|face| &face[..]).collect();
    let mesh = zoo::mesh(&positions, &faces);
    let labels: Vec<u32> = (0..corners).collect();
    sound(&mesh, &labels, u64::from(corners), Placement::Fit);
    let few: Vec<u32> = (0..corners).map(|face| face % 7).collect();
    sound(&mesh, &few, 7, Placement::Fit);
}

#[test]
fn labels_that_do_not_fit_are_refused() {
    let mesh = generate(Sample::Sphere, 20).expect("a sample");
    let faces = mesh.faces.len();
    for (labels, clusters, word) in [
        (vec![0; faces - 1], 1, "one a face"),
        (vec![0; faces], faces as u64 + 1, "more clusters than faces"),
        (vec![3; faces], 3, "below the number of clusters, 3"),
    ] {
        let error = remesh(&mesh, &labels, clusters, Placement::Fit).expect_err(word);
        assert!(error.message.contains(word), "{error}");
    }
}
