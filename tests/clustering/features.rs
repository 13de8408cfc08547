//! `features`: clusters do not cross sharp edges and borders of groups.

use std::collections::{BTreeMap, BTreeSet};

use crate::common::zoo;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::job::{self, InMemory, Outcome, Request};
use tesserae_mesh::mesh::{self, Faces, Format, Limits, NoResources, PolygonMesh};
use tesserae_mesh::parameters::{Algorithm, Parameters, Seeds};
use tesserae_mesh::report::{Input, MeshInput};
use tesserae_mesh::surface::{Surface, Wanted, WantedFeatures};

fn parameters(features: &str, clusters: Option<u64>, algorithm: Algorithm) -> Parameters {
    let features = Some(features.parse().expect("features"));
    Parameters { features, clusters, algorithm, ..Parameters::default() }
}

fn run(mesh: &PolygonMesh, parameters: &Parameters) -> tesserae_mesh::Result<Outcome> {
    let job = InMemory { mesh: mesh.into(), limits: Limits::default(), parameters, seeds: None, weights: None };
    let prepared = job::prepare_in_memory(&job).map_err(|refusal| refusal.error)?;
    job::run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| ())
}

fn input(outcome: &Outcome) -> &MeshInput {
    match &outcome.report.input {
        Input::Mesh(mesh) => mesh,
        Input::Points(_) => panic!("a mesh"),
    }
}

/// The two faces of every edge that has two, and the angle between them in degrees, from positions.
fn edges(mesh: &PolygonMesh) -> Vec<([usize; 2], f64)> {
    type Place = [u64; 3];
    let mut sides: BTreeMap<[Place; 2], Vec<(usize, bool)>> = BTreeMap::new();
    for face in 0..mesh.faces.len() {
        let corners = mesh.faces.corners(face);
        for (at, &to) in corners.iter().enumerate() {
            let from = corners[(at + corners.len() - 1) % corners.len()];
            let [from, to] = [from, to].map(|vertex| mesh.positions[vertex as usize].map(|x| (x + 0.0).to_bits()));
            if from != to {
                sides.entry([from.min(to), from.max(to)]).or_default().push((face, from < to));
            }
        }
    }
    let angle = |[(one, up), (other, also_up)]: [(usize, bool); 2]| {
        let [n, m] = [one, other].map(|face| normal(mesh, face));
        let sign = if up == also_up { -1.0 } else { 1.0 };
        let sine = [n[1] * m[2] - n[2] * m[1], n[2] * m[0] - n[0] * m[2], n[0] * m[1] - n[1] * m[0]];
        let cosine: f64 = (0..3).map(|axis| n[axis] * m[axis]).sum();
        sine.map(|x| x * x).iter().sum::<f64>().sqrt().atan2(sign * cosine).to_degrees()
    };
    let pairs = sides.into_values().filter_map(|sides| <[_; 2]>::try_from(sides).ok());
    pairs.map(|sides| (sides.map(|(face, _)| face), angle(sides))).collect()
}

/// Newell's normal, not a unit.
fn normal(mesh: &PolygonMesh, face: usize) -> [f64; 3] {
    let corners = mesh.faces.corners(face);
    let mut normal = [0.0; 3];
    for (at, &corner) in corners.iter().enumerate() {
        let (p, q) = (mesh.positions[corner as usize], mesh.positions[corners[(at + 1) % corners.len()] as usize]);
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            normal[axis] += (p[u] - q[u]) * (p[v] + q[v]);
        }
    }
    normal
}

/// Checks the labels of a mesh without edges of more than two faces: a cluster is on both sides of a sharp edge only if
/// it goes around the end of a line of them. Returns how many sharp edges there are, and how many of those there are.
fn check(mesh: &PolygonMesh, labels: &[u32], angle: f64) -> [u64; 2] {
    let edges = edges(mesh);
    let (mut sharp, mut inside) = (0, Vec::new());
    let mut near = vec![Vec::new(); labels.len()];
    for ([one, other], between) in edges {
        if between <= angle {
            near[one].push(other);
            near[other].push(one);
            continue;
        }
        sharp += 1;
        if labels[one] == labels[other] {
            inside.push([one, other]);
        }
    }
    for &[one, other] in &inside {
        let (mut open, mut seen) = (vec![one], BTreeSet::from([one]));
        while let Some(face) = open.pop() {
            let same = near[face].iter().filter(|&&near| labels[near] == labels[one] && seen.insert(near));
            open.extend(same.collect::<Vec<_>>());
        }
        assert!(seen.contains(&other), "cluster {} crosses a sharp edge", labels[one]);
    }
    [sharp, inside.len() as u64]
}

const ALGORITHMS: [Algorithm; 6] =
    [Algorithm::Bb, Algorithm::Pml, Algorithm::Ml, Algorithm::Hr, Algorithm::Acvd, Algorithm::Vc];

#[test]
fn the_sides_of_a_cube_are_six_regions_for_every_algorithm() {
    let mesh = generate(Sample::Cube, 12 * 5 * 5).expect("a sample");
    for algorithm in ALGORITHMS {
        for clusters in [6, 31] {
            let outcome = run(&mesh, &parameters("30", Some(clusters), algorithm)).expect("there are six sides");
            let labels = outcome.labels.as_deref().expect("labels");
            assert_eq!(check(&mesh, labels, 30.0), [12 * 5, 0], "{algorithm:?}");
            let of_mesh = input(&outcome);
            assert_eq!((of_mesh.components, of_mesh.feature_edges), (6, 12 * 5));
            let report = &outcome.report;
            assert_eq!((report.clusters, report.disconnected_clusters, report.feature_edges_inside), (clusters, 0, 0));
        }
        let refused = run(&mesh, &parameters("30", Some(5), algorithm)).expect_err("five are too few");
        assert!(["features", "6", "5"].iter().all(|word| refused.message.contains(word)), "{refused}");
    }
    // a right angle is not above 90 degrees
    let whole = run(&mesh, &parameters("90", Some(5), Algorithm::Bb)).expect("one region");
    assert_eq!((input(&whole).components, input(&whole).feature_edges), (1, 0));
    let below = run(&mesh, &parameters("89.999", Some(6), Algorithm::Bb)).expect("six regions");
    assert_eq!(input(&below).components, 6);
    let hierarchy = run(&mesh, &parameters("30", None, Algorithm::Pml)).expect("a forest");
    assert_eq!(hierarchy.report.clusters, 6);
}

#[test]
fn lines_that_end_inside_a_region_are_counted_and_divide_nothing() {
    let mut inside = 0;
    let samples = [Sample::Knot, Sample::Terrain, Sample::Quads, Sample::Parts].map(|sample| generate(sample, 900));
    for mesh in samples.map(|mesh| mesh.expect("a sample")) {
        for angle in [12.0, 25.0, 40.0] {
            let surface = surface(&mesh, Some(angle), None);
            let clusters = surface.components.len() as u64 + 20;
            for algorithm in [Algorithm::Bb, Algorithm::Pml] {
                let outcome = run(&mesh, &parameters(&angle.to_string(), Some(clusters), algorithm)).expect("enough");
                let counted = [input(&outcome).feature_edges, outcome.report.feature_edges_inside];
                assert_eq!(check(&mesh, outcome.labels.as_deref().expect("labels"), angle), counted);
                assert_eq!(outcome.report.disconnected_clusters, 0);
                inside += counted[1];
            }
        }
    }
    assert!(inside > 0, "a line ends inside a region of one of them");
}

#[test]
fn the_check_sees_clusters_that_cross_a_line() {
    let mesh = generate(Sample::Cube, 12 * 3 * 3).expect("a sample");
    let parameters = Parameters { clusters: Some(2), ..Parameters::default() };
    let labels = run(&mesh, &parameters).expect("two clusters").labels.expect("labels");
    std::panic::catch_unwind(|| check(&mesh, &labels, 30.0)).expect_err("clusters go around edges");
}

#[test]
fn no_cluster_of_a_real_part_crosses_a_sharp_edge() {
    let Some(folder) = zoo::shared_meshes() else { return };
    let bytes = std::fs::read(folder.join("fandisk.obj")).expect("a file");
    let mesh = mesh::read(&bytes, Format::Obj, &NoResources, &Limits::default()).expect("a mesh");
    for (algorithm, clusters) in [(Algorithm::Bb, 200), (Algorithm::Pml, 60)] {
        let outcome = run(&mesh, &parameters("30", Some(clusters), algorithm)).expect("enough clusters");
        let counted = [input(&outcome).feature_edges, outcome.report.feature_edges_inside];
        assert_eq!(check(&mesh, outcome.labels.as_deref().expect("labels"), 30.0), counted);
        assert!(counted[0] > 500 && counted[1] < 20, "{counted:?}");
    }
}

fn surface(mesh: &PolygonMesh, angle: Option<f64>, groups: Option<&[u32]>) -> Surface {
    let features = Some(WantedFeatures { angle, groups });
    Surface::build_with(mesh, false, Wanted::default(), features).expect("a surface")
}

#[test]
fn features_change_no_count_but_those_of_components() {
    for (name, mesh) in zoo::all() {
        let plain = Surface::build(&mesh).expect("a surface").counts;
        let groups: Vec<u32> = (0..mesh.faces.len() as u32).map(|face| face % 3).collect();
        for (angle, groups) in [(Some(0.0), None), (Some(20.0), Some(&groups[..])), (None, Some(&groups[..]))] {
            let surface = surface(&mesh, angle, groups);
            let counts = surface.counts;
            assert_eq!(counts.duplicate_faces, plain.duplicate_faces, "{name}");
            assert_eq!(counts.boundary_edges, plain.boundary_edges, "{name}");
            assert_eq!(counts.non_manifold_edges, plain.non_manifold_edges, "{name}");
            assert!(counts.components + counts.loose_faces >= plain.components + plain.loose_faces, "{name}");
            let crossing = |face: u32| {
                let group = |face: u32| groups.map(|groups| groups[surface.upload_face[face as usize] as usize]);
                surface.neighbours_of(face).iter().any(|&near| group(near) != group(face))
            };
            assert!(!(0..surface.faces() as u32).any(crossing), "{name}");
        }
    }
}

#[test]
fn angles_depend_on_the_shape_alone() {
    let mesh = generate(Sample::Cube, 12 * 4 * 4).expect("a sample");
    let regions = |mesh: &PolygonMesh, angle| surface(mesh, Some(angle), None).components.len();
    // every other face turned around
    let mut turned = PolygonMesh { faces: Faces::default(), ..mesh.clone() };
    for face in 0..mesh.faces.len() {
        let mut corners = mesh.faces.corners(face).to_vec();
        if face % 2 == 1 {
            corners.reverse();
        }
        turned.faces.push(&corners);
    }
    // a vertex far away that no face uses
    let mut with_point = mesh.clone();
    with_point.positions.push([1e300; 3]);
    let scaled = |factor: f64| {
        let positions = mesh.positions.iter().map(|place| place.map(|x| x * factor)).collect();
        PolygonMesh { positions, ..mesh.clone() }
    };
    for mesh in [&mesh, &turned, &with_point, &scaled(1.7e308), &scaled(1e-300)] {
        assert_eq!([0.0, 30.0, 90.0, 180.0].map(|angle| regions(mesh, angle)), [6, 6, 1, 1]);
    }
    let [a, b, c] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.3], [0.2, 1.0, 0.7]];
    let folded = zoo::mesh(&[a, b, c], &[&[0, 1, 2], &[2, 1, 0]]);
    assert_eq!([0.0, 179.9, 180.0].map(|angle| regions(&folded, angle)), [2, 2, 1]);
    // a face of two positions does not join the sides of the edge that it lies on
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let with_thin = zoo::mesh(&corners, &[&[0, 1, 2], &[0, 1, 1], &[1, 0, 3]]);
    assert_eq!([30.0, 100.0].map(|angle| regions(&with_thin, angle)), [2, 1]);
    assert_eq!(regions(&generate(Sample::Plane, 50).expect("a sample"), 0.0), 1);
}

#[test]
fn groups_of_files_are_kept_apart_also_after_a_division() {
    // a row of four squares: two groups, then two materials of the second
    let mut obj = String::new();
    (0..=4).for_each(|x| obj += &format!("v {x} 0 0\nv {x} 1 0\n"));
    for (at, name) in ["g left", "", "g right\nusemtl red", "usemtl blue"].iter().enumerate() {
        let first = 2 * at + 1;
        obj += &format!("{name}\nf {} {} {} {}\n", first, first + 2, first + 3, first + 1);
    }
    let labels = |parameters: &Parameters| {
        let prepared = job::prepare(&Request::new(obj.as_bytes(), Format::Obj, parameters))?;
        job::run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| ())
    };
    let three = parameters("groups", Some(3), Algorithm::Bb);
    assert_eq!(labels(&three).expect("three groups").labels.expect("labels"), [0, 0, 1, 2]);
    let divided = Parameters { subdivide: Some("1".parse().expect("a number")), ..three.clone() };
    let divided = labels(&divided).expect("three groups").labels.expect("labels");
    assert_eq!(divided, [vec![0; 16], vec![1; 8], vec![2; 8]].concat());
    let refused = labels(&Parameters { clusters: Some(2), ..three.clone() }).expect_err("three groups");
    assert!(refused.message.contains("features"), "{refused}");
    let seeds = Parameters { seeds: Seeds::Random, ..parameters("0,groups", Some(4), Algorithm::Bb) };
    assert_eq!(labels(&seeds).expect("four faces").report.feature_edges_inside, 0);

    let off = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let refused = job::prepare(&Request::new(off, Format::Off, &three)).expect_err("no groups");
    assert!(refused.message.contains("OFF") && refused.message.contains("leave groups out"), "{refused}");
    let mesh = generate(Sample::Cube, 12).expect("a sample");
    let refused = run(&mesh, &three).expect_err("no file");
    assert!(refused.message.contains("leave groups out"), "{refused}");
}
