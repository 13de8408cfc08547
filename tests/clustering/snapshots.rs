//! Snapshots: the labels of iterations are those that the report's energies are of, on both devices, and to ask for
//! them changes nothing.

use crate::command::Folder;
use crate::common::{gpu, zoo};
use tesserae_mesh::cluster::flat::Options;
use tesserae_mesh::dev::sample::{Sample, generate, write_obj};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::plain;
use tesserae_mesh::device::{Cancel, Device, Ending, Step};
use tesserae_mesh::energy::LatticeEnergy;
use tesserae_mesh::job::{self, Outcome, Prepared, Request};
use tesserae_mesh::mesh::{Format, PolygonMesh};
use tesserae_mesh::parameters::{Algorithm, Parameters, Seeds, Snapshots};
use tesserae_mesh::report::Phase;
use tesserae_mesh::surface::Surface;

fn prepare(mesh: &PolygonMesh, parameters: &Parameters) -> Prepared {
    let mut obj = Vec::new();
    write_obj(&mut obj, mesh).expect("a vector takes everything");
    job::prepare(&Request::new(&obj, Format::Obj, parameters)).expect("a mesh")
}

fn run(prepared: &Prepared, device: &mut dyn Device) -> Outcome {
    job::run(prepared, device, &Cancel::default(), &mut |_| {}).expect("nobody cancels")
}

/// Iteration and labels of every snapshot.
fn snapshots(outcome: &Outcome) -> Vec<(u32, Vec<u32>)> {
    let mut all = Vec::new();
    let done: Result<(), ()> = outcome.snapshots.replay(|iteration, labels| {
        all.push((iteration, labels.to_vec()));
        Ok(())
    });
    assert_eq!(done, Ok(()));
    all
}

/// Energy of labels in upload order, as iterations tell it.
fn energy(prepared: &Prepared, labels: &[u32]) -> f64 {
    let surface = prepared.subject.mesh().expect("a mesh");
    let internal: Vec<u32> = surface.upload_face.iter().map(|&face| labels[face as usize]).collect();
    let clusters = internal.iter().max().map_or(0, |&label| label as usize + 1);
    let component_of_cluster = surface.component_of_cluster(&internal, clusters);
    surface.energy(LatticeEnergy { explained: plain::explained(surface, &component_of_cluster, &internal) })
}

/// Meshes with parameters; the tangles end with connected refinement.
fn cases() -> Vec<(PolygonMesh, Parameters)> {
    let mut cases = Vec::new();
    for algorithm in [Algorithm::Bb, Algorithm::Acvd, Algorithm::Vc] {
        let parameters = |clusters| Parameters {
            algorithm,
            clusters: Some(clusters),
            seeds: Seeds::Random,
            ..Parameters::default()
        };
        for (sample, faces, clusters) in [(Sample::Knot, 3000, 60), (Sample::Parts, 2000, 40), (Sample::Sphere, 100, 1)]
        {
            cases.push((generate(sample, faces).expect("a sample"), parameters(clusters)));
        }
        for seed in 0..20 {
            let tangle = zoo::tangle(60, 400, seed);
            let surface = Surface::build(&tangle).expect("a surface");
            cases.push((tangle, parameters((surface.components.len() as u64 + 40).min(surface.faces() as u64))));
        }
    }
    // clusters that move as a whole leave gaps between their numbers
    let few_faces_a_cluster = Parameters { clusters: Some(60), ..Parameters::default() };
    cases.push((generate(Sample::Knot, 1200).expect("a sample"), few_faces_a_cluster));
    cases
}

#[test]
fn snapshots_are_the_labels_of_their_iterations_and_change_nothing() {
    let (mut after_repairs, mut different) = (0, 0);
    for (mesh, parameters) in cases() {
        let plain = run(&prepare(&mesh, &parameters), &mut CpuDevice::new());
        for every in [1, 7] {
            let wanted = Parameters { snapshots: Some(Snapshots::Every(every)), ..parameters.clone() };
            let prepared = prepare(&mesh, &wanted);
            let outcome = run(&prepared, &mut CpuDevice::new());
            let told = |outcome: &Outcome| -> Vec<_> {
                let rows = outcome.report.iterations.iter();
                rows.map(|row| (row.iteration, row.phase, row.energy, row.moves)).collect()
            };
            assert_eq!(told(&outcome), told(&plain), "{parameters:?}");
            assert_eq!(outcome.labels, plain.labels, "{parameters:?}");
            let kept = snapshots(&outcome);
            let expected: Vec<_> = outcome.report.iterations.iter().filter(|row| row.iteration % every == 0).collect();
            assert_eq!(kept.len(), expected.len(), "{parameters:?}");
            assert_eq!(outcome.report.snapshots, kept.iter().map(|kept| kept.0).collect::<Vec<_>>());
            for ((iteration, labels), row) in kept.iter().zip(expected) {
                assert_eq!(*iteration, row.iteration);
                assert_eq!(Some(energy(&prepared, labels)), row.energy, "{parameters:?} {row:?}");
                after_repairs += usize::from(row.phase == Phase::Repair);
            }
            if every == 1 {
                assert_eq!(kept.last().map(|(_, labels)| labels), outcome.labels.as_ref(), "the numbers are the same");
            }
            different += kept.windows(2).filter(|pair| pair[0].1 != pair[1].1).count();
        }
    }
    assert!(after_repairs > 0, "no repair was seen");
    assert!(different > 100, "hardly anything moved");
}

/// What a device's refinement does from some labels, with stops after every so many iterations.
fn refine(
    device: &mut dyn Device,
    surface: &Surface,
    (labels, component_of_cluster): (&[u32], &[u32]),
    (stop_after, resume): (u32, bool),
) -> (Vec<Step>, Vec<u32>) {
    let mut steps = device.open(surface, component_of_cluster).expect("it takes everything");
    steps.set_labels(labels).expect("labels fit");
    let mut told = Vec::new();
    loop {
        let mut on_step = |step| told.push(step);
        let cancel = Cancel::default();
        let ending = steps.refine(stop_after, &cancel, &mut on_step);
        let labels = steps.labels().expect("there are labels");
        if ending.expect("nobody cancels") == Ending::Converged {
            return (told, labels);
        }
        if resume {
            steps.resume();
        }
    }
}

#[test]
fn a_phase_that_is_stopped_goes_on_as_if_it_had_not_been() {
    let mut gpu = gpu::device();
    let mut different = 0;
    let small = zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() < 1000);
    for (at, (name, mesh)) in small.enumerate() {
        let surface = Surface::build(&mesh).expect("a surface");
        let (fewest, most) = (surface.components.len() as u64, surface.faces() as u64);
        for (turn, clusters) in [fewest + 2, most / 20, most / 4].into_iter().enumerate() {
            let seeds = gpu::seeds(&surface, clusters.clamp(fewest, most), &Seeds::Random, 9);
            let grown = Options { max_iterations: Some(0), refine: false, allow_disconnected: true };
            let labels = gpu::run(&mut CpuDevice::new(), &surface, &seeds, grown).expect("a run").0;
            let start = (&labels[..], &seeds.component_of_cluster[..]);
            let whole = refine(&mut CpuDevice::new(), &surface, start, (u32::MAX, false));
            for stop_after in zoo::in_turn(at + turn, &[1, 3]) {
                let here = refine(&mut CpuDevice::new(), &surface, start, (stop_after, true));
                assert!(here == whole, "{name} k={clusters} {stop_after}");
                let there = refine(&mut *gpu, &surface, start, (stop_after, true));
                assert!(there == whole, "gpu: {name} k={clusters} {stop_after}");
            }
            let anew = refine(&mut CpuDevice::new(), &surface, start, (1, false));
            different += usize::from(anew != whole);
        }
    }
    println!("without going on, runs that differ: {different}");
    assert!(different > 0, "the comparison cannot fail");
}

#[test]
fn both_devices_keep_the_same() {
    let mut gpu = gpu::device();
    let mut phases_after_repairs = 0;
    for (mesh, parameters) in cases().into_iter().filter(|(_, parameters)| parameters.algorithm == Algorithm::Bb) {
        for wanted in [Snapshots::Every(5), Snapshots::At(vec![0, 6, 7, 46, 100_000])] {
            let parameters = Parameters { snapshots: Some(wanted), ..parameters.clone() };
            let prepared = prepare(&mesh, &parameters);
            let (one, other) = (run(&prepared, &mut CpuDevice::new()), run(&prepared, &mut *gpu));
            assert_eq!(snapshots(&one), snapshots(&other), "{parameters:?}");
            assert_eq!(one.labels, other.labels, "{parameters:?}");
            phases_after_repairs += one.report.iterations.iter().filter(|row| row.phase == Phase::Repair).count();
        }
    }
    assert!(phases_after_repairs > 20, "connected refinement was hardly reached");
}

#[test]
fn the_command_line_writes_them_beside_the_labels() {
    let folder = Folder::new();
    folder.sample("knot", 2000, "k.obj");
    let run = |arguments: &[&str]| folder.run(&[&["cluster", "k.obj", "-k", "40"], arguments].concat());
    run(&["--labels", "plain.bin"]).expect_success();
    let done = run(&["--labels", "l.bin", "--snapshots", "0,6,100000", "--report", "r.json"]);
    assert_eq!(done.status, Some(0), "{done:?}");
    assert!(done.stderr.starts_with("tesserae: k.obj: warning: ") && done.stderr.contains("100000"), "{done:?}");
    assert_eq!(folder.files(), ["k.obj", "l.bin", "l.iteration-0.bin", "l.iteration-6.bin", "plain.bin", "r.json"]);
    assert_eq!(folder.read("l.bin"), folder.read("plain.bin"));
    assert_eq!(folder.json("r.json")["snapshots"], serde_json::json!([0, 6]));
    assert_ne!(folder.read("l.iteration-0.bin"), folder.read("l.iteration-6.bin"));
    run(&["--snapshots", "5"]).expect_usage_error(&["--labels"]);
    run(&["--snapshots", "5", "--labels", "-"]).expect_usage_error(&["--labels"]);
    run(&["--snapshots", "x", "--labels", "l.bin"]).expect_usage_error(&["0,6,46", "\"x\""]);
    run(&["--snapshots", "5", "--algorithm", "pml", "--labels", "l.bin"]).expect_usage_error(&["snapshots", "pml"]);
    folder.write("w.iteration-0.npy", tesserae_mesh::artifacts::npy_header("<f4", "(0,)"));
    run(&["--weights", "w.iteration-0.npy", "--snapshots", "0", "--labels", "w.npy"]).expect_failure(&["weight"]);
}
