//! Density: weights and curvature make clusters smaller where they are larger, and nothing else.

use crate::command::Folder;
use crate::common::zoo;
use tesserae_mesh::Result;
use tesserae_mesh::cluster::{self, flat::Options, seeds};
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Cancel, Device};
use tesserae_mesh::mesh::PolygonMesh;
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::{Surface, Wanted};

fn build(mesh: &PolygonMesh, wanted: Wanted<'_>) -> Surface {
    Surface::build_with(mesh, false, wanted, None).expect("a surface")
}

fn weighted(weights: &[f64]) -> Wanted<'_> {
    Wanted { weights: Some(weights), ..Wanted::default() }
}

/// Labels in internal order.
fn labels(surface: &Surface, clusters: u64) -> Vec<u32> {
    let seeds = seeds::choose(surface, clusters, &Seeds::Morton, 0, None).expect("the number is possible");
    let mut device = CpuDevice::new();
    let mut steps = device.open(surface, &seeds.component_of_cluster).expect("the cpu takes everything");
    let options = Options { max_iterations: None, refine: true, allow_disconnected: false };
    let cancel = Cancel::default();
    let start = seeds.labels(surface.faces());
    let mut record = cluster::record::Record::default();
    cluster::flat::boundary_based(surface, &start, options, steps.as_mut(), &cancel, &mut |_| {}, &mut record)
        .expect("no cancellation")
        .labels
}

/// How many clusters have most of their faces where `inside` says.
fn clusters_inside(surface: &Surface, clusters: usize, labels: &[u32], inside: impl Fn([i32; 3]) -> bool) -> usize {
    let mut votes = vec![0i64; clusters];
    for (face, &label) in labels.iter().enumerate() {
        votes[label as usize] += if inside(surface.points[face]) { 1 } else { -1 };
    }
    votes.into_iter().filter(|&votes| votes > 0).count()
}

#[test]
fn a_constant_density_gives_the_same_labels_as_none() {
    for (name, mesh) in zoo::all() {
        let plain = build(&mesh, Wanted::default());
        let clusters = (plain.faces() as u64 / 20).max(plain.components.len() as u64);
        let expected = labels(&plain, clusters);
        let energy = plain.source_energy(&expected, clusters as usize);
        for weight in [1.0, 3.7, 1e-200] {
            for count in [mesh.faces.len(), mesh.positions.len()] {
                let weights = vec![weight; count];
                let surface = build(&mesh, weighted(&weights));
                assert_eq!(surface.weights, plain.weights, "{name} {weight}");
                assert_eq!(labels(&surface, clusters), expected, "{name} {weight}");
                let relative = surface.source_energy(&expected, clusters as usize) / weight / energy;
                // where the numbers are ordinary ones
                assert!(!(1e-99..1e99).contains(&energy) || (relative - 1.0).abs() < 1e-12, "{name} {relative}");
                assert_eq!(surface.energy_and_hexagon_ratio(&expected, clusters as usize).1, None);
            }
        }
        let surface = build(&mesh, Wanted { curvature_exponent: Some(0.0), ..Wanted::default() });
        assert_eq!(surface.weights, plain.weights, "{name}");
    }
}

#[test]
fn where_weights_are_larger_clusters_are_smaller() {
    let mesh = generate(Sample::Sphere, 20_000).expect("a sample");
    let is_north =
        |face: usize| mesh.faces.corners(face).iter().map(|&v| mesh.positions[v as usize][2]).sum::<f64>() > 0.0;
    let weights: Vec<f64> = (0..mesh.faces.len()).map(|face| if is_north(face) { 16.0 } else { 1.0 }).collect();
    let surface = build(&mesh, weighted(&weights));
    let north = clusters_inside(&surface, 250, &labels(&surface, 250), |g| g[2] > 0);
    // width as density^(−1/4): 4 times as many in the same area
    assert!((185..215).contains(&north), "{north} of 250");
    let of_vertices: Vec<f64> = mesh.positions.iter().map(|p| if p[2] > 0.0 { 16.0 } else { 1.0 }).collect();
    let surface = build(&mesh, weighted(&of_vertices));
    let north = clusters_inside(&surface, 250, &labels(&surface, 250), |g| g[2] > 0);
    assert!((185..215).contains(&north), "by vertices: {north} of 250");
}

#[test]
fn where_the_surface_bends_clusters_are_smaller() {
    // a rounded box: corners bend, sides do not
    let mesh = generate(Sample::Quads, 20_000).expect("a sample");
    let at_corner = |g: [i32; 3]| {
        let reach = g.map(|x| f64::from(x.abs()));
        let largest = reach.iter().copied().fold(0.0, f64::max);
        reach.iter().filter(|&&x| x > 0.8 * largest).count() == 3
    };
    let counts: Vec<usize> = [None, Some(1.0), Some(3.0)]
        .into_iter()
        .map(|curvature_exponent| {
            let surface = build(&mesh, Wanted { weights: None, curvature_exponent });
            clusters_inside(&surface, 300, &labels(&surface, 300), at_corner)
        })
        .collect();
    println!("clusters at the corners with exponent none, 1, 3: {counts:?}");
    assert!(counts[1] > counts[0] && counts[2] > counts[1], "{counts:?}");
}

#[test]
fn weights_that_make_no_sense_are_refused_with_numbers() {
    let mesh = generate(Sample::Sphere, 100).expect("a sample");
    let (faces, vertices) = (mesh.faces.len(), mesh.positions.len());
    let refused = |weights: &[f64]| -> String {
        let built: Result<Surface> = Surface::build_with(&mesh, false, weighted(weights), None);
        built.map(|_| ()).expect_err("refused").message
    };
    let message = refused(&[1.0; 3]);
    assert!([faces, vertices, 3].iter().all(|number| message.contains(&number.to_string())), "{message}");
    assert!(refused(&[]).ends_with("not 0"));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mut weights = vec![1.0; vertices];
        weights[17] = bad;
        weights[20] = bad;
        let message = refused(&weights);
        assert!(message.contains("17") && message.ends_with(&bad.to_string()), "{message}");
    }
}

#[test]
fn weights_of_any_magnitude_are_clustered() {
    let mesh = generate(Sample::Knot, 1000).expect("a sample");
    for range in [1e3, 1e30, 1e300] {
        let weights: Vec<f64> =
            (0..mesh.faces.len()).map(|face| if face % 50 == 0 { range } else { 1.0 / range }).collect();
        for curvature_exponent in [None, Some(10.0)] {
            let surface = build(&mesh, Wanted { weights: Some(&weights), curvature_exponent });
            let labels = labels(&surface, 30);
            assert_eq!(tesserae_mesh::device::pieces::disconnected_clusters(&surface, 30, &labels), 0);
        }
    }
}

#[test]
fn the_command_line_takes_weights_attributes_and_curvature() {
    let folder = Folder::new();
    folder.sample("sphere", 500, "s.obj");
    let npy = |weights: &[f32]| {
        let mut bytes = tesserae_mesh::artifacts::npy_header("<f4", &format!("({},)", weights.len()));
        weights.iter().for_each(|weight| bytes.extend(weight.to_le_bytes()));
        bytes
    };
    folder.write("w.npy", npy(&vec![2.0; 500]));
    folder.write("few.npy", npy(&[2.0; 4]));
    let run = |arguments: &[&str]| folder.run(&[&["cluster", "s.obj", "-k", "20"], arguments].concat());
    run(&["--labels", "plain.bin"]).expect_success();
    run(&["--weights", "w.npy", "--labels", "same.bin", "--report", "same.json"]).expect_success();
    assert_eq!(folder.read("plain.bin"), folder.read("same.bin"));
    let energy = &folder.json("same.json")["energy"];
    assert_eq!(energy["weighted_by"], serde_json::json!(["weights"]));
    assert!(energy["hexagon_ratio"].is_null());
    run(&["--curvature-exponent", "1.5", "--report", "c.json"]).expect_success();
    assert_eq!(folder.json("c.json")["energy"]["weighted_by"], serde_json::json!(["curvature"]));
    run(&["--weights", "few.npy"]).expect_failure(&["500", "252", "4"]);
    run(&["--weights", "none.npy"]).expect_failure(&["cannot read", "none.npy"]);
    run(&["--weights", "s.obj"]).expect_failure(&[".npy"]);
    run(&["--weights", "w.npy", "--weight-attribute", "_W"]).expect_usage_error(&["--weight-attribute"]);
    run(&["--weights", "w.npy", "--labels", "w.npy"]).expect_usage_error(&["the weights", "w.npy"]);
    run(&["--weight-attribute", "_W"]).expect_failure(&["OBJ", "_W"]);
    run(&["--weight-attribute", "W"]).expect_usage_error(&["underscore"]);
    run(&["--curvature-exponent", "11"]).expect_usage_error(&["--curvature-exponent", "11"]);
}
