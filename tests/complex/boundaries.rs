//! Boundaries, graph and cluster table against sums over faces and edges.

use std::collections::{BTreeMap, BTreeSet};

use tesserae_mesh::complex::{Boundaries, Graph};
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::mesh::PolygonMesh;
use tesserae_mesh::surface::Surface;

use super::checker::welded;
use super::common::zoo;
use super::labels::{Kind, Recipe};

fn labelled(mesh: &PolygonMesh, clusters: u32) -> (Vec<u32>, u64) {
    Recipe { kind: Kind::Nearest, clusters, noise: 1, seed: 5 }.labels(mesh)
}

type Key = [u64; 3];

fn key(position: [f64; 3]) -> Key {
    position.map(|x| (x + 0.0).to_bits())
}

/// The two ends of an edge in space, sorted.
fn between(one: [f64; 3], other: [f64; 3]) -> [Key; 2] {
    let mut ends = [key(one), key(other)];
    ends.sort_unstable();
    ends
}

#[test]
fn curves_cover_every_edge_between_clusters_and_at_the_boundary_once() {
    for (name, mesh) in zoo::all() {
        let (labels, clusters) = labelled(&mesh, 12);
        let found = Boundaries::new(&mesh, &labels, clusters).expect("labels fit");
        let mut covered: BTreeMap<[Key; 2], Vec<(u32, Option<u32>)>> = BTreeMap::new();
        for curve in &found.curves {
            assert!(curve.right.is_none_or(|right| curve.left < right));
            assert_eq!((curve.start.is_none(), curve.end.is_none()), (curve.closed, curve.closed));
            let at = |number: u32| found.points[number as usize];
            let mut points: Vec<[f64; 3]> = curve.points.iter().map(|&number| at(number)).collect();
            if curve.closed {
                points.push(points[0]);
            }
            for pair in points.windows(2) {
                covered.entry(between(pair[0], pair[1])).or_default().push((curve.left, curve.right));
            }
            for (junction, point) in [(curve.start, curve.points.first()), (curve.end, curve.points.last())] {
                if let (Some(junction), Some(point)) = (junction, point) {
                    let junction = &found.junctions[junction as usize];
                    assert_eq!(junction.point, *point);
                    assert!(junction.clusters.contains(&curve.left));
                    assert!(curve.right.is_none_or(|right| junction.clusters.contains(&right)));
                }
            }
        }
        // labels of the triangles at each edge, by position
        let (triangles, faces) = welded(&mesh);
        let mut position = BTreeMap::new();
        for face in 0..mesh.faces.len() {
            for &corner in mesh.faces.corners(face) {
                let next = position.len();
                position.entry(key(mesh.positions[corner as usize])).or_insert(next);
            }
        }
        let mut of_number: Vec<Key> = vec![[0; 3]; position.len()];
        position.into_iter().for_each(|(key, number)| of_number[number] = key);
        let mut at_edge: BTreeMap<[Key; 2], Vec<u32>> = BTreeMap::new();
        for (triangle, face) in triangles.iter().zip(faces) {
            for side in 0..3 {
                let mut ends = [triangle[side], triangle[(side + 1) % 3]].map(|corner| of_number[corner as usize]);
                ends.sort_unstable();
                at_edge.entry(ends).or_default().push(labels[face]);
            }
        }
        for (ends, labels) in at_edge {
            let curves = covered.remove(&ends).unwrap_or_default();
            match labels[..] {
                [one, other] if curves.len() == 1 => {
                    assert!(one != other, "{name}");
                    assert_eq!(curves[0], (one.min(other), Some(one.max(other))), "{name}");
                }
                [one, other] if curves.is_empty() => assert_eq!(one, other, "{name}"),
                _ => {
                    let mut left: Vec<u32> = curves.iter().map(|curve| curve.0).collect();
                    let mut labels = labels.clone();
                    left.sort_unstable();
                    labels.sort_unstable();
                    assert_eq!(left, labels, "{name}");
                    assert!(curves.iter().all(|curve| curve.1.is_none()), "{name}");
                }
            }
        }
        assert!(covered.is_empty(), "{name}");
        let vertices: BTreeSet<Key> = found.point_vertices.iter().map(|&v| key(mesh.positions[v as usize])).collect();
        let points: BTreeSet<Key> = found.points.iter().map(|&point| key(point)).collect();
        assert_eq!((vertices, found.points.len()), (points.clone(), points.len()), "{name}");
    }
}

#[test]
fn left_is_left_as_seen_from_outside() {
    let mesh = generate(Sample::Plane, 800).expect("a sample");
    // one cluster in the middle of another, counter-clockwise around it where it is on the left
    let high = [0, 1].map(|axis| mesh.positions.iter().fold(0.0f64, |high, position| high.max(position[axis])));
    let inside = |face: usize| {
        let at = mesh.faces.corners(face).iter().map(|&v| mesh.positions[v as usize]);
        let centre = at.fold([0.0; 2], |sum, p| [sum[0] + p[0] / 3.0, sum[1] + p[1] / 3.0]);
        (0..2).all(|axis| (0.3..0.7).contains(&(centre[axis] / high[axis])))
    };
    for inner in [0, 1u32] {
        let labels: Vec<u32> = (0..mesh.faces.len()).map(|face| if inside(face) { inner } else { 1 - inner }).collect();
        let found = Boundaries::new(&mesh, &labels, 2).expect("labels fit");
        let curve = found.curves.iter().find(|curve| curve.right.is_some()).expect("a curve");
        let at = |index: usize| found.points[curve.points[index % curve.points.len()] as usize];
        let area: f64 = (0..curve.points.len()).map(|i| at(i)[0] * at(i + 1)[1] - at(i)[1] * at(i + 1)[0]).sum();
        assert!(curve.closed && curve.left == 0 && area != 0.0);
        assert_eq!(area > 0.0, inner == 0);
    }
}

#[test]
fn the_graph_and_its_table_are_sums_over_faces_and_edges() {
    for (name, mesh) in zoo::all() {
        if name == "huge" || name == "tiny" {
            continue;
        }
        let (labels, clusters) = labelled(&mesh, 9);
        let graph = Graph::new(&mesh, &labels, clusters).expect("labels fit");
        let curves = Boundaries::new(&mesh, &labels, clusters).expect("labels fit").curves;
        let mut edges: BTreeMap<(u32, u32), (f64, u32)> = BTreeMap::new();
        let mut perimeters = vec![0.0; clusters as usize];
        for curve in &curves {
            perimeters[curve.left as usize] += curve.length;
            if let Some(right) = curve.right {
                perimeters[right as usize] += curve.length;
                let edge = edges.entry((curve.left, right)).or_default();
                *edge = (edge.0 + curve.length, edge.1 + 1);
            }
        }
        let near = |one: f64, other: f64| (one - other).abs() <= 1e-9 * one.abs().max(other.abs());
        assert_eq!(graph.edges.len(), edges.len(), "{name}");
        for (edge, ((source, target), (length, arcs))) in graph.edges.iter().zip(&edges) {
            assert_eq!((edge.source, edge.target, edge.arcs), (*source, *target, *arcs), "{name}");
            assert!(near(edge.length, *length), "{name}");
        }
        let surface = Surface::build(&mesh).expect("a surface");
        let energy = {
            let internal: Vec<u32> = surface.upload_face.iter().map(|&face| labels[face as usize]).collect();
            surface.source_energy(&internal, clusters as usize)
        };
        let sum: f64 = graph.nodes.iter().map(|node| node.energy).sum();
        assert!((sum - energy).abs() <= 1e-9 * energy.abs(), "{name}: {sum} {energy}");
        for node in &graph.nodes {
            let cluster = node.cluster;
            assert_eq!(node.faces, labels.iter().filter(|&&label| label == cluster).count() as u64, "{name}");
            assert!(near(node.perimeter, perimeters[cluster as usize]), "{name}");
            let neighbours = edges.keys().filter(|(one, other)| *one == cluster || *other == cluster).count();
            assert_eq!(node.neighbours, neighbours as u64, "{name}");
            assert_eq!(node.open, curves.iter().any(|curve| curve.left == cluster && curve.right.is_none()), "{name}");
            assert!(node.planarity.is_none_or(|flat| (0.0..=1.0).contains(&flat)), "{name}");
            if let (Some(normal), Some(cone)) = (node.normal, node.normal_cone) {
                assert!((normal.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-9);
                assert!((-1.0 - 1e-9..=1.0 + 1e-9).contains(&cone));
            }
        }
        let components: BTreeSet<u32> = graph.nodes.iter().filter_map(|node| node.component).collect();
        assert!(components.len() as u64 <= surface.counts.components, "{name}");
    }
}

#[test]
fn tables_of_simple_shapes_have_the_numbers_of_the_textbook() {
    let sphere = generate(Sample::Sphere, 5000).expect("a sample");
    let graph = Graph::new(&sphere, &vec![0; sphere.faces.len()], 1).expect("labels fit");
    let [whole] = &graph.nodes[..] else { panic!("one cluster") };
    assert!((whole.area / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{whole:?}");
    assert_eq!((whole.euler, whole.open, whole.perimeter, whole.roundness), (2, false, 0.0, None));
    assert!(whole.planarity.is_some_and(|flat| flat < 1e-9) && whole.component == Some(0));
    let halves: Vec<u32> = (0..sphere.faces.len())
        .map(|face| {
            u32::from(sphere.faces.corners(face).iter().map(|&v| sphere.positions[v as usize][2]).sum::<f64>() > 0.0)
        })
        .collect();
    let graph = Graph::new(&sphere, &halves, 2).expect("labels fit");
    let up = &graph.nodes[1];
    assert_eq!((up.euler, up.neighbours, graph.edges.len(), graph.edges[0].arcs), (1, 1, 1, 1));
    // a hemisphere's flat base has half of its area
    assert!(up.planarity.is_some_and(|flat| (flat - 0.5).abs() < 0.02), "{up:?}");
    assert!(up.normal.is_some_and(|normal| normal[2] > 0.99) && up.normal_cone.is_some_and(|cone| cone.abs() < 0.1));
    let plane = generate(Sample::Plane, 200).expect("a sample");
    let graph = Graph::new(&plane, &vec![0; plane.faces.len()], 1).expect("labels fit");
    let flat = &graph.nodes[0];
    assert!(flat.open && flat.euler == 1 && flat.normal_cone.is_some_and(|cone| (cone - 1.0).abs() < 1e-12));
}
