//! Tests of surfaces.

use std::collections::BTreeSet;

use super::*;
use crate::dev::sample::{Sample, generate};
use crate::energy::cvd::wide;
use crate::energy::{LatticeEnergy, WideSums};
use crate::mesh::{Faces, Format};

fn mesh(positions: &[[f64; 3]], faces: &[&[u32]]) -> PolygonMesh {
    let mut all = Faces::default();
    faces.iter().for_each(|corners| all.push(corners));
    PolygonMesh::of_one_part(Format::Obj, positions.to_vec(), all)
}

/// The surface of a sample.
pub(crate) fn of_sample(sample: Sample, faces: u64) -> Surface {
    Surface::build(&generate(sample, faces).expect("a mesh")).expect("a surface")
}

/// Every cluster has faces, and all of them lie in its component.
pub(crate) fn assert_clusters_lie_in(graph: &DualGraph, labels: &[u32], component_of_cluster: &[u32]) {
    let found: BTreeSet<(u32, u32)> = labels.iter().copied().zip(graph.component_of_face()).collect();
    assert_eq!(found, (0..).zip(component_of_cluster.iter().copied()).collect());
}

const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

/// Neighbours of an upload face, as upload faces, sorted.
fn neighbours(surface: &Surface, upload: u32) -> Vec<u32> {
    let face = surface.internal_faces()[upload as usize];
    let mut near: Vec<u32> =
        surface.neighbours_of(face).iter().map(|&near| surface.upload_face[near as usize]).collect();
    near.sort_unstable();
    near
}

#[test]
fn seams_are_welded_and_minus_zero_is_zero() {
    let mut positions = SQUARE.to_vec();
    positions.extend([[-0.0, 0.0, -0.0], [1.0, 1.0, -0.0], [9.0, 9.0, 9.0]]);
    let surface = Surface::build(&mesh(&positions, &[&[0, 1, 2], &[4, 5, 3]])).expect("a surface");
    assert_eq!(surface.components.len(), 1);
    assert_eq!(surface.counts.welded_vertices, 4, "the vertex at (9, 9, 9) is not used");
    assert_eq!(surface.counts.boundary_edges, 4);
    assert_eq!(neighbours(&surface, 0), [1]);
}

#[test]
fn positions_that_differ_in_the_last_bit_stay_apart() {
    let mut positions = SQUARE.to_vec();
    positions.extend([[f64::MIN_POSITIVE, 0.0, 0.0], [1.0, 1.0_f64.next_up(), 0.0]]);
    let surface = Surface::build(&mesh(&positions, &[&[0, 1, 2], &[4, 5, 3]])).expect("a surface");
    assert_eq!(surface.components.len(), 2);
}

#[test]
fn an_edge_of_many_faces_is_a_chain_by_face_number() {
    let mut positions = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let mut faces = Vec::new();
    for fin in 0..5u32 {
        positions.push([f64::from(fin), 1.0 + f64::from(fin * fin), 0.5]);
        faces.push(if fin % 2 == 0 { [0, 1, fin + 2] } else { [fin + 2, 1, 0] });
    }
    let faces: Vec<&[u32]> = faces.iter().map(|face| &face[..]).collect();
    let surface = Surface::build(&mesh(&positions, &faces)).expect("a surface");
    assert_eq!(surface.counts.non_manifold_edges, 1);
    assert_eq!(surface.counts.boundary_edges, 10);
    let rows: Vec<Vec<u32>> = (0..5).map(|face| neighbours(&surface, face)).collect();
    assert_eq!(rows, [vec![1], vec![0, 2], vec![1, 3], vec![2, 4], vec![3]]);
}

#[test]
fn a_face_that_runs_along_an_edge_counts_for_it_when_it_does_so_an_odd_number_of_times() {
    let positions = [
        [0.0, 0.0, 0.0],
        [4.0, 0.0, 0.0],
        [4.0, 4.0, 0.0],
        [0.0, 4.0, 0.0],
        [1.0, 1.0, 0.0],
        [3.0, 1.0, 0.0],
        [2.0, 3.0, 0.0],
    ];
    // boundary and non-manifold edges, and neighbours of face 0
    type Case<'a> = (&'a [&'a [u32]], u64, u64, &'a [u32]);
    let cases: [Case; 5] = [
        // a square with a triangular hole, which a slit from 0 to 4 joins to the outside: the slit is no boundary
        (&[&[0, 1, 2, 3, 0, 4, 6, 5, 4]], 7, 0, &[]),
        // the same with the hole filled
        (&[&[0, 1, 2, 3, 0, 4, 6, 5, 4], &[4, 5, 6]], 4, 0, &[1, 1, 1]),
        // there, back and there again is once
        (&[&[0, 1, 0, 1, 2]], 3, 0, &[]),
        // a spike along the edge of another face: that face is alone at the edge, and linked all the same
        (&[&[0, 1, 2, 4, 2], &[2, 4, 5]], 6, 0, &[1]),
        // three faces at an edge, one of them twice: the other two are a pair
        (&[&[0, 1, 2, 4, 2], &[2, 4, 5], &[4, 2, 3]], 7, 0, &[1]),
    ];
    for (faces, boundary_edges, non_manifold_edges, near) in cases {
        let surface = Surface::build(&mesh(&positions, faces)).expect("a surface");
        let counts = surface.counts;
        assert_eq!(
            (counts.boundary_edges, counts.non_manifold_edges),
            (boundary_edges, non_manifold_edges),
            "{faces:?}"
        );
        assert_eq!(neighbours(&surface, 0), near, "{faces:?}");
    }
}

#[test]
fn degenerate_and_duplicate_faces_are_counted() {
    let faces: [&[u32]; 7] = [&[0, 1, 2], &[0, 2, 3], &[2, 0, 1], &[0, 0, 1], &[3, 3, 3], &[0, 1, 2, 3], &[1, 3, 2, 0]];
    let surface = Surface::build(&mesh(&SQUARE, &faces)).expect("a surface");
    assert_eq!(surface.counts.degenerate_faces, 2);
    assert_eq!(surface.counts.duplicate_faces, 2, "one triangle and one quadrilateral");
    assert_eq!(surface.counts.zero_area_faces, 2);
    assert_eq!((surface.components.len(), surface.counts.loose_faces), (1, 1), "the point face shares no edge");
}

#[test]
fn faces_smaller_than_a_square_of_the_lattice_are_counted() {
    for (far, tiny) in [(2.0, 0), (1e9, 3)] {
        let positions = [&SQUARE[..], &[[far, 0.5, 1.0]]].concat();
        let surface = Surface::build(&mesh(&positions, &[&[0, 1, 2], &[0, 2, 3], &[0, 1, 4]])).expect("a surface");
        assert_eq!((surface.counts.tiny_faces, surface.counts.zero_area_faces), (tiny, 0), "{far}");
    }
}

#[test]
fn copies_in_a_crowded_edge_are_found_though_nothing_links_them() {
    // between the two copies of face 0 lies another face on each of their edges
    let mut positions = SQUARE[..3].to_vec();
    positions.extend([[0.5, -1.0, 1.0], [2.0, 0.5, 1.0], [-1.0, 0.5, 1.0]]);
    let faces: [&[u32]; 5] = [&[0, 1, 2], &[0, 1, 3], &[1, 2, 4], &[2, 0, 5], &[0, 1, 2]];
    let surface = Surface::build(&mesh(&positions, &faces)).expect("a surface");
    assert_eq!(surface.counts.duplicate_faces, 1);
    assert_eq!(surface.counts.non_manifold_edges, 3);
}

#[test]
fn polygons_have_the_centroid_and_area_of_their_fans() {
    // an L: the fan from its first corner covers it exactly
    let positions =
        [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 2.0, 0.0]];
    let surface = Surface::build(&mesh(&positions, &[&[0, 1, 2, 3, 4, 5]])).expect("a surface");
    let scale = libm::ldexp(1.0, surface.frame.exponent);
    let face = surface.geometry[0];
    assert_eq!(face.area / (scale * scale), 3.0);
    for axis in 0..2 {
        let expected = (2.5 - 1.5 * 1.0) / 3.0 + 0.5 - 1.0; // (0.5·2 + 1.5·1)/3 about the centre (1, 1)
        assert!((face.centroid[axis] / scale - expected).abs() < 1e-12, "{face:?}");
    }
}

#[test]
fn small_components_keep_their_resolution() {
    let mut positions = SQUARE.map(|p| p.map(|x| x * 1e4)).to_vec();
    positions.extend(SQUARE.map(|p| p.map(|x| x * 1e-2 + 3.0)));
    let faces: [&[u32]; 4] = [&[0, 1, 2], &[0, 2, 3], &[4, 5, 6], &[4, 6, 7]];
    let surface = Surface::build(&mesh(&positions, &faces)).expect("a surface");
    let [large, small] = surface.components[..] else { panic!("two components") };
    assert_eq!(small.energy_shift, 0);
    assert_eq!(large.energy_shift, 30, "a ratio of 10^12 in area is more than the spread allows");
    for component in [large, small] {
        assert!(component.weight > 1 << 20 && component.weight < 1 << 34, "{component:?}");
    }
    let only_small = mesh(&positions, &faces[2..]);
    assert_eq!(Surface::build(&only_small).expect("a surface").components[0].energy_shift, 0);
}

#[test]
fn the_lattice_energy_is_the_energy_from_the_source() {
    let mesh = generate(Sample::Knot, 2000).expect("a sample");
    let mut ratios = Vec::new();
    for (scale, power) in [(1.0, 0), (libm::ldexp(1.0, -300), -300), (libm::ldexp(1.0, 270), 270)] {
        let mut mesh = mesh.clone();
        mesh.positions.iter_mut().for_each(|p| *p = p.map(|x| x * scale));
        let surface = Surface::build(&mesh).expect("a surface");
        // everything in one cluster
        let mut sums = wide::Sums::<3>::default();
        (0..surface.faces()).for_each(|face| sums.add_face(surface.face(face)));
        let explained = sums.explained();
        let lattice = surface.energy(LatticeEnergy { explained });
        let source = surface.source_energy(&vec![0; surface.faces()], 1);
        if power == 0 {
            assert!(((lattice - source) / source).abs() < 1e-8, "{lattice} {source}");
        } else {
            // length⁴ leaves the range of f64 here
            assert_eq!(lattice == 0.0, power < 0);
            assert_eq!(lattice.is_finite(), power < 0);
        }
        ratios.push(surface.energy_and_hexagon_ratio(&vec![0; surface.faces()], 1).1);
    }
    assert!(ratios[0].is_some() && ratios.iter().all(|ratio| *ratio == ratios[0]), "no unit matters: {ratios:?}");
}

#[test]
fn a_planar_tiling_by_hexagons_has_ratio_one() {
    // a strip of regular hexagons, each cut into many thin rings of equal triangles, clustered by hexagon
    let (mut positions, mut faces, mut labels) = (Vec::new(), Faces::default(), Vec::new());
    let rings = 24u32;
    for hexagon in 0..3u32 {
        for side in 0..6 {
            let corner = |k: u32| {
                let angle = f64::from(k) * std::f64::consts::FRAC_PI_3;
                [libm::cos(angle), libm::sin(angle)]
            };
            let (a, b) = (corner(side), corner(side + 1));
            let point = |i: u32, j: u32| {
                let (u, v) = (f64::from(i) / f64::from(rings), f64::from(j) / f64::from(rings));
                [a[0] * u + b[0] * v + 3.0 * f64::from(hexagon), a[1] * u + b[1] * v, 0.0]
            };
            for i in 0..rings {
                for j in 0..rings - i {
                    let mut triangle = |points: [[f64; 3]; 3]| {
                        let first = positions.len() as u32;
                        positions.extend(points);
                        faces.push(&[first, first + 1, first + 2]);
                        labels.push(hexagon);
                    };
                    triangle([point(i, j), point(i + 1, j), point(i, j + 1)]);
                    if i + j + 1 < rings {
                        triangle([point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]);
                    }
                }
            }
        }
    }
    let surface = Surface::build(&PolygonMesh::of_one_part(Format::Obj, positions, faces)).expect("a surface");
    let internal: Vec<u32> = surface.upload_face.iter().map(|&face| labels[face as usize]).collect();
    let ratio = surface.energy_and_hexagon_ratio(&internal, 3).1.expect("most of the energy is visible");
    assert!((ratio - 1.0).abs() < 1e-9, "{ratio}");
    let alone: Vec<u32> = (0..surface.faces() as u32).collect();
    assert_eq!(
        surface.energy_and_hexagon_ratio(&alone, surface.faces()).1,
        None,
        "nothing is left of the tiling's energy"
    );
}

fn bridged(mesh: &PolygonMesh) -> Surface {
    Surface::build_with(mesh, true, Wanted::default(), None).expect("a surface")
}

#[test]
fn bridges_join_every_component_once_and_near_ones_first() {
    let mesh = generate(Sample::Parts, 1000).expect("a sample");
    let plain = Surface::build(&mesh).expect("a surface");
    let whole = bridged(&mesh);
    let parts = plain.components.len();
    assert!(parts > 5);
    assert_eq!((whole.components.len(), whole.counts.components), (1, parts as u64));
    assert_eq!(whole.neighbours.items.len(), plain.neighbours.items.len() + 2 * (parts - 1));
    assert_eq!(bridged(&mesh).neighbours, whole.neighbours);

    // four squares along a line: a bridge between each and the next, none between the ends
    let mut positions = Vec::new();
    let mut faces = Faces::default();
    for part in 0..4u32 {
        positions.extend(SQUARE.map(|p| [p[0] + 3.0 * f64::from(part), p[1], p[2]]));
        faces.push(&[0, 1, 2, 3].map(|corner| corner + 4 * part));
    }
    let line = bridged(&PolygonMesh::of_one_part(Format::Obj, positions, faces));
    let rows: Vec<Vec<u32>> = (0..4).map(|face| neighbours(&line, face)).collect();
    assert_eq!(rows, [vec![1], vec![0, 2], vec![1, 3], vec![2]]);
}

#[test]
fn energies_of_many_components_add_up() {
    for components in [1usize, 8, 9, 4096] {
        let runs: Vec<_> = (0..components).map(|run| run..run + 1).collect();
        // the last component has next to no area
        let area = |face: usize| if face + 1 == components { 1e-30 } else { 1e12 };
        let (_, weighed, _) = lattice::weigh(area, &runs);
        let sums = weighed.iter().map(|component| u128::from(component.weight) << component.energy_shift);
        assert!(sums.sum::<u128>() < 1 << 67, "{components}");
    }
}
