//! Clusterings by shapes: whole jobs give the same with a gpu as on the cpu alone.

use crate::common::gpu::{device, opened};
use crate::common::zoo::mesh;
use tesserae_mesh::Kind;
use tesserae_mesh::dev::sample::{Sample, generate, generate_part};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::gpu::{Fault, FaultPoint};
use tesserae_mesh::device::{Cancel, Device, DeviceKind};
use tesserae_mesh::energy;
use tesserae_mesh::job::{self, DeviceFor, InMemory, Outcome, Prepared};
use tesserae_mesh::mesh::{Limits, PolygonMesh};
use tesserae_mesh::parameters::{Algorithm, Levels, Parameters};
use tesserae_mesh::report::Row;

fn prepared(mesh: &PolygonMesh, parameters: &Parameters) -> Prepared {
    let job = InMemory { mesh: mesh.into(), limits: Limits::default(), parameters, seeds: None, weights: None };
    job::prepare_in_memory(&job).expect("a surface")
}

/// Rows without their times, and what came out.
fn run(prepared: &Prepared, device: &mut dyn Device) -> (Vec<String>, Outcome) {
    let mut rows = Vec::new();
    let mut on_row = |row: Row| match row {
        Row::Iteration(row) => rows.push(format!("{} {:?} {:?} {}", row.iteration, row.phase, row.energy, row.moves)),
        Row::Round(row) => rows.push(format!("{row:?}")),
    };
    let outcome = job::run(prepared, device, &Cancel::default(), &mut on_row).expect("it runs");
    (rows, outcome)
}

/// A tube of quads around a corner, whose ends are polygons of many corners.
fn tube(sides: u32, rings: u32) -> PolygonMesh {
    let at = |ring: u32, side: u32| {
        let (turn, along) = (f64::from(side) / f64::from(sides) * std::f64::consts::TAU, f64::from(ring));
        let radius = if ring % 20 < 10 { 9.0 } else { 11.0 + 0.1 * along };
        [radius * turn.cos(), radius * turn.sin(), along]
    };
    let positions: Vec<_> = (0..rings).flat_map(|ring| (0..sides).map(move |side| at(ring, side))).collect();
    let quad = |ring: u32, side: u32| {
        let next = (side + 1) % sides;
        [ring * sides + side, ring * sides + next, (ring + 1) * sides + next, (ring + 1) * sides + side]
    };
    let quads: Vec<_> = (1..rings).flat_map(|ring| (0..sides).map(move |side| quad(ring - 1, side))).collect();
    let ends = [(0..sides).rev().collect::<Vec<u32>>(), ((rings - 1) * sides..rings * sides).collect()];
    let faces: Vec<&[u32]> = ends.iter().map(Vec::as_slice).chain(quads.iter().map(|quad| &quad[..])).collect();
    mesh(&positions, &faces)
}

#[test]
fn labels_rows_and_shapes_are_those_of_the_cpu() {
    let mut gpu = opened();
    let part = generate_part(5000, 0.2).expect("a part").0;
    let knot = generate(Sample::Knot, 5000).expect("a sample");
    let (shapes, planes) = (energy::Kind::Shapes, energy::Kind::Planes);
    let levels = || Some(Levels(vec![400, 150]));
    for (name, mesh, energy, algorithm, clusters) in [
        ("knot", &knot, planes, Algorithm::Bb, 400),
        ("part", &part, shapes, Algorithm::Bb, 200),
        ("tube", &tube(100, 50), shapes, Algorithm::Bb, 250),
        ("parts", &generate(Sample::Parts, 5000).expect("a sample"), planes, Algorithm::Bb, 300),
        ("knot", &knot, shapes, Algorithm::Pml, 100),
    ] {
        let context = format!("{name} {energy:?} {algorithm:?} {clusters}");
        let levels = if algorithm == Algorithm::Bb { None } else { levels() };
        let parameters = Parameters { energy, algorithm, levels, clusters: Some(clusters), ..Parameters::default() };
        let prepared = prepared(mesh, &parameters);
        let (expected, found) = (run(&prepared, &mut CpuDevice::new()), run(&prepared, &mut gpu));
        assert_eq!(found.0, expected.0, "{context}");
        assert!(found.1.labels == expected.1.labels && found.1.labels.is_some(), "{context}");
        let rows = |outcome: &Outcome| serde_json::to_string(&outcome.report.shapes).expect("JSON");
        assert_eq!(rows(&found.1), rows(&expected.1), "{context}");
        assert_eq!(found.1.report.device.kind, DeviceKind::Gpu, "{context}");
        // otherwise the comparison says little
        gpu.inject(Fault::Lose(FaultPoint::Boundary));
        let error = job::run(&prepared, &mut gpu, &Cancel::default(), &mut |_| {}).map(|_| ()).expect_err("lost");
        assert_eq!(error.kind, Kind::DeviceLost, "{context}: {error}");
    }
}

#[test]
fn a_wrong_proposal_is_noticed_and_the_cpu_does_the_job() {
    let parameters = Parameters { energy: energy::Kind::Planes, clusters: Some(500), ..Parameters::default() };
    let prepared = prepared(&generate(Sample::Knot, 8000).expect("a sample"), &parameters);
    let mut gpu = opened();
    gpu.inject(Fault::Miscompute(FaultPoint::Boundary));
    let error = job::run(&prepared, &mut gpu, &Cancel::default(), &mut |_| {}).map(|_| ()).expect_err("a wrong number");
    assert!(error.kind == Kind::DeviceWrong && error.message.contains("computed wrongly"), "{error}");
    gpu.inject(Fault::Miscompute(FaultPoint::Boundary));
    let choice = tesserae_mesh::device::select::DeviceChoice::Gpu;
    let device = DeviceFor { choice, adapter: None };
    let outcome = job::run_on(device, Some(Ok(Box::new(gpu))), &prepared, &Cancel::default(), &mut |_| {});
    let report = outcome.expect("the cpu's result").report;
    assert_eq!((report.device.kind, report.warnings.len()), (DeviceKind::Cpu, 1));
}

#[test]
fn the_report_names_the_cpu_where_it_did_all() {
    let mesh = generate_part(1500, 0.0).expect("a part").0;
    let energy = energy::Kind::Shapes;
    let within = Parameters { energy, tolerance: Some("0.01".parse().expect("a length")), ..Parameters::default() };
    let merged = Parameters { energy, algorithm: Algorithm::Hr, clusters: Some(13), ..Parameters::default() };
    let with_cones = Some("plane,cone".parse().expect("types"));
    let cones = Parameters { energy, shapes: with_cones, clusters: Some(13), ..Parameters::default() };
    let short = Parameters { energy, clusters: Some(13), ..Parameters::default() };
    let all = [(within, "a tolerance"), (merged, "no face moves"), (cones, "cones"), (short, "long enough")];
    for (parameters, why) in all {
        let prepared = prepared(&mesh, &parameters);
        let (expected, found) = (run(&prepared, &mut CpuDevice::new()), run(&prepared, &mut *device()));
        assert_eq!((found.1.report.device.kind, &found.0), (DeviceKind::Cpu, &expected.0));
        let warnings = &found.1.report.warnings;
        assert!(warnings.len() == 1 && warnings[0].contains(why), "{why}: {warnings:?}");
        assert_eq!(found.1.labels, expected.1.labels);
    }
}
