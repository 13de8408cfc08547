//! Points of other numbers of coordinates than three: whole jobs give the same on the gpu as on the cpu.

use std::time::Instant;

use crate::common::gpu::{device, opened};
use crate::common::zoo::sized;
use tesserae_mesh::Kind;
use tesserae_mesh::data::{Graph, PointSet, Values};
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::gpu::{Fault, FaultPoint, GpuDevice};
use tesserae_mesh::device::{Cancel, Device, DeviceKind};
use tesserae_mesh::energy;
use tesserae_mesh::job::{self, InMemory, PointsInMemory, Prepared};
use tesserae_mesh::mesh::Limits;
use tesserae_mesh::parameters::{Algorithm, Parameters, Seeds};
use tesserae_mesh::report::Row;

/// Rows, labels and hierarchy of a job; the rows without their times.
fn run(prepared: &Prepared, device: &mut dyn Device) -> (Vec<String>, Option<Vec<u32>>, String) {
    let mut rows = Vec::new();
    let mut on_row = |row: Row| match row {
        Row::Iteration(row) => rows.push(format!("{} {:?} {:?} {}", row.iteration, row.phase, row.energy, row.moves)),
        Row::Round(row) => rows.push(format!("{row:?}")),
    };
    let outcome = job::run(prepared, device, &Cancel::default(), &mut on_row).expect("it runs");
    (rows, outcome.labels, outcome.hierarchy.map(|made| format!("{:?}", made.tree)).unwrap_or_default())
}

/// Fails if the job runs without the gpu: an injected fault then does nothing.
fn compare_on_gpu(gpu: &mut GpuDevice, prepared: &Prepared, context: &str) {
    compare(gpu, prepared, context);
    gpu.inject(Fault::Lose(FaultPoint::Upload));
    let error = job::run(prepared, gpu, &Cancel::default(), &mut |_| {}).expect_err("it is lost");
    assert_eq!(error.kind, Kind::DeviceLost, "{context}: {error}");
}

fn compare(gpu: &mut GpuDevice, prepared: &Prepared, context: &str) {
    let expected = run(prepared, &mut CpuDevice::new());
    let found = run(prepared, gpu);
    let difference = found.0.iter().zip(&expected.0).find(|(found, expected)| found != expected);
    assert_eq!(difference, None, "{context}: rows");
    assert!(found == expected, "{context}: labels or hierarchy");
}

#[test]
fn faces_by_their_normals_are_clustered_alike() {
    let mut gpu = device();
    for (sample, faces) in [(Sample::Knot, 1500), (Sample::Cube, 600), (Sample::Parts, 900)] {
        let mesh = generate(sample, sized(faces)).expect("a sample");
        for (algorithm, seeds, allow_disconnected) in [
            (Algorithm::Bb, Seeds::Coarse, false),
            (Algorithm::Bb, Seeds::Morton, true),
            (Algorithm::Pml, Seeds::Coarse, false),
            (Algorithm::Hr, Seeds::Coarse, false),
        ] {
            let clusters = Some(60);
            let energy = energy::Kind::L21;
            let usual = Parameters::default();
            let parameters = Parameters { algorithm, clusters, energy, seeds, allow_disconnected, ..usual };
            let mesh = (&mesh).into();
            let job = InMemory { mesh, limits: Limits::default(), parameters: &parameters, seeds: None, weights: None };
            let prepared = job::prepare_in_memory(&job).expect("a mesh");
            let context = format!("{} {algorithm:?}", sample.name());
            match sample {
                Sample::Cube => compare_on_gpu(&mut gpu, &prepared, &context),
                _ => compare(&mut gpu, &prepared, &context),
            }
        }
    }
}

/// Points in a grid, of so many coordinates: waves and steps.
fn points(dimensions: usize, graph: Graph) -> PointSet {
    let rows = sized(20) as usize;
    let shape = vec![rows, 30];
    let value = |at: usize| {
        let (item, axis) = (at / dimensions, at % dimensions);
        let (row, column) = (item / 30, item % 30);
        let wave = ((row * (axis + 1) + column) as f64 / 9.0).sin();
        wave + f64::from(u8::from((row + 3 * axis) % 13 > 6)) + (at * 7919 % 101) as f64 / 400.0
    };
    let values = Values::F8((0..rows * 30 * dimensions).map(value).collect());
    PointSet { dimensions, values, weights: None, mask: None, shape, graph }
}

#[test]
fn points_of_up_to_eight_coordinates_are_clustered_alike() {
    let mut gpu = device();
    for (dimensions, graph) in [
        (2, Graph::Grid { full: false }),
        (4, Graph::Grid { full: true }),
        (5, Graph::Grid { full: false }),
        (8, Graph::Grid { full: true }),
    ] {
        for (algorithm, clusters) in [(Algorithm::Bb, 25), (Algorithm::Pml, 5), (Algorithm::Hr, 40)] {
            let parameters = Parameters { algorithm, clusters: Some(clusters), ..Parameters::default() };
            let set = points(dimensions, graph.clone());
            let (format, seeds, started) = (None, None, Instant::now());
            let parameters = &parameters;
            let job = PointsInMemory { set, format, max_items: 1000, parameters, seeds, started };
            let prepared = job::prepare_points_in_memory(job).map_err(|refusal| refusal.error).expect("points");
            assert!(!prepared.wants_cpu() || algorithm == Algorithm::Hr);
            let context = format!("{dimensions} coordinates, {algorithm:?}");
            match dimensions {
                5 => compare_on_gpu(&mut gpu, &prepared, &context),
                _ => compare(&mut gpu, &prepared, &context),
            }
        }
    }
}

#[test]
fn points_of_more_coordinates_are_refused_by_a_gpu() {
    let mut gpu: Box<dyn Device> = Box::new(opened());
    assert_eq!(gpu.info().kind, DeviceKind::Gpu);
    let parameters = &Parameters { clusters: Some(9), ..Parameters::default() };
    let set = points(9, Graph::Grid { full: false });
    let job = PointsInMemory { set, format: None, max_items: 1000, parameters, seeds: None, started: Instant::now() };
    let prepared = job::prepare_points_in_memory(job).map_err(|refusal| refusal.error).expect("points");
    assert!(prepared.wants_cpu());
    let error = job::run(&prepared, gpu.as_mut(), &Cancel::default(), &mut |_| {}).expect_err("it is refused");
    assert!(error.message.contains("8 coordinates"), "{error}");
}
