//! What goes wrong on a gpu: limits, lost devices, refused calls, cancelled jobs. Each is an error, never a panic, and
//! the device works again afterwards.

use crate::common::gpu::{ALL, adapter, device, device_with, opened, run, seeds, without_pages};
use tesserae_mesh::Kind;
use tesserae_mesh::cluster::seeds::SeedFaces;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::gpu::{self, Fault, FaultPoint, GpuDevice, Overrides, Tuning};
use tesserae_mesh::device::select::{self, DeviceChoice, FACES_FOR_GPU};
use tesserae_mesh::device::{Cancel, Device, FREE};
use tesserae_mesh::job::{self, DeviceFor, InMemory};
use tesserae_mesh::mesh::Limits;
use tesserae_mesh::parameters::{Parameters, Seeds};
use tesserae_mesh::report::{DeviceKind, Input};
use tesserae_mesh::surface::Surface;

fn example() -> (Surface, SeedFaces) {
    let mesh = generate(Sample::Knot, 5000).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let seeds = seeds(&surface, 1500, &Seeds::Random, 2);
    (surface, seeds)
}

#[test]
fn any_number_of_workgroups_gives_the_same() {
    let mesh = generate(Sample::Knot, 20_000).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let seeds = seeds(&surface, 3000, &Seeds::Random, 2);
    let expected = run(&mut *device(), &surface, &seeds, ALL).expect("a run");
    for most in [1, 7, 50] {
        let mut narrow = device_with(Overrides { workgroups_per_dimension: Some(most), ..Overrides::default() });
        let found = run(&mut narrow, &surface, &seeds, ALL).expect("a run");
        assert!(found == expected, "{most} workgroups at most");
    }
}

#[test]
fn a_mesh_over_the_limit_of_a_binding_is_refused_with_both_sizes() {
    let (surface, seeds) = example();
    // the largest: where the neighbours of a face begin, and one number more, and three neighbours
    let needed = 16 * surface.faces() as u64 + 4;
    assert_eq!(surface.neighbours.items.len(), 3 * surface.faces());
    let with_limit = |bytes| {
        let mut device = device_with(without_pages(bytes));
        run(&mut device, &surface, &seeds, ALL)
    };
    let error = with_limit(needed - 1).expect_err("one byte too many");
    assert_eq!(error.kind, Kind::DeviceUnsuitable);
    for number in [needed, needed - 1] {
        assert!(error.message.contains(&number.to_string()), "{error}");
    }
    // what a cluster takes in the largest buffer of clusters
    assert!(with_limit(needed.max(64 * 1500)).is_ok());
}

#[test]
fn a_lost_device_is_an_error_and_the_next_job_works() {
    let (surface, seeds) = example();
    let mut gpu = device();
    let expected = run(&mut *gpu, &surface, &seeds, ALL).expect("a run");
    for point in [
        FaultPoint::Upload,
        FaultPoint::Grow,
        FaultPoint::Boundary,
        FaultPoint::Refine,
        FaultPoint::Pieces,
        FaultPoint::Labels,
    ] {
        gpu.inject(Fault::Lose(point));
        let error = run(&mut *gpu, &surface, &seeds, ALL).expect_err("lost");
        assert_eq!(error.kind, Kind::DeviceLost, "{point:?}: {error}");
        assert!(!error.message.contains('\n'), "{point:?}: {error}");
        let again = run(&mut *gpu, &surface, &seeds, ALL).expect("it works again");
        assert_eq!(again, expected, "{point:?}");
    }
}

#[test]
fn a_refused_call_is_an_error_and_the_next_job_works() {
    let (surface, seeds) = example();
    let mut gpu = device();
    let expected = run(&mut *gpu, &surface, &seeds, ALL).expect("a run");
    for point in [FaultPoint::Upload, FaultPoint::Boundary, FaultPoint::Refine, FaultPoint::Pieces, FaultPoint::Labels]
    {
        gpu.inject(Fault::Misuse(point));
        let error = run(&mut *gpu, &surface, &seeds, ALL).expect_err("refused");
        assert_eq!(error.kind, Kind::Internal, "{point:?}: {error}");
        assert!(!error.message.contains('\n'), "{point:?}: {error}");
        let again = run(&mut *gpu, &surface, &seeds, ALL).expect("it works again");
        assert_eq!(again, expected, "{point:?}");
    }
}

#[test]
fn a_device_without_memory_is_an_error_and_the_next_job_works() {
    let (surface, seeds) = example();
    let mut gpu = device();
    let expected = run(&mut *gpu, &surface, &seeds, ALL).expect("a run");
    for point in [FaultPoint::Upload, FaultPoint::Labels] {
        gpu.inject(Fault::Exhaust(point));
        let error = run(&mut *gpu, &surface, &seeds, ALL).expect_err("no memory");
        assert_eq!(error.kind, Kind::DeviceLost, "{point:?}: {error}");
        assert!(error.message.contains("memory"), "{point:?}: {error}");
        let again = run(&mut *gpu, &surface, &seeds, ALL).expect("it works again");
        assert_eq!(again, expected, "{point:?}");
    }
}

#[test]
fn a_cancelled_job_ends_and_leaves_the_device_usable() {
    let (surface, _) = example();
    let seeds = seeds(&surface, 10, &Seeds::Random, 2);
    let mut gpu = device();
    {
        let mut steps = gpu.open(&surface, &seeds.component_of_cluster).expect("it fits");
        let mut labels = vec![FREE; surface.faces()];
        for (cluster, &face) in (0..).zip(&seeds.face_of_cluster) {
            labels[face as usize] = cluster;
        }
        steps.set_labels(&labels).expect("set");
        let cancel = Cancel::default();
        cancel.cancel();
        let ended = steps.grow(&cancel).map_err(|error| error.kind);
        assert_eq!(ended, Err(Kind::Cancelled));
        assert_eq!(steps.labels().expect("labels"), labels);

        steps.grow(&Cancel::default()).expect("grow");
        let cancel = Cancel::default();
        let mut count = 0;
        let ended = steps.optimise_boundary(u32::MAX, &cancel, &mut |_| {
            count += 1;
            cancel.cancel();
        });
        assert_eq!(ended.map_err(|error| error.kind), Err(Kind::Cancelled));
        // what was queued comes back, nothing else is queued
        assert_eq!(count, Tuning::default().first_batch, "iterations of the first batch");
        // and the labels are those of the last row that was told
        let after = steps.labels().expect("labels");
        let energy = steps.energy().expect("energy");
        steps.set_labels(&after).expect("set");
        assert_eq!(steps.energy().expect("energy"), energy);
    }
    run(&mut *gpu, &surface, &seeds, ALL).expect("a run");
}

#[test]
fn the_gpu_can_be_chosen_and_says_what_it_is() {
    let report = adapter().report;
    let reports = select::adapters();
    assert!(reports.contains(&report), "{reports:?}");
    for wanted in [None, Some(report.index.to_string()), Some(report.name.to_uppercase())] {
        let gpu = select::open(DeviceChoice::Gpu, wanted.as_deref(), None).expect("it opens");
        let info = gpu.info();
        assert_eq!(info.kind, DeviceKind::Gpu);
        assert_eq!((&info.name, &info.backend), (&report.name, &report.backend));
        assert!(!info.driver.is_empty());
    }
    let error = select::open(DeviceChoice::Gpu, Some("no such card"), None).map(|_| ()).expect_err("no such card");
    assert_eq!(error.kind, Kind::InvalidParameter);
    assert!(error.message.contains(&report.name), "{error}");
    let expected = select::auto_adapter(&reports).map_or(DeviceKind::Cpu, |_| DeviceKind::Gpu);
    let auto = select::open(DeviceChoice::Auto, None, None).expect("there is always the cpu");
    assert_eq!(auto.info().kind, expected);
}

#[test]
fn an_adapter_that_computes_wrongly_when_it_is_opened_is_unsuitable_and_says_what_differed() {
    let fault = Some(Fault::Miscompute(FaultPoint::Labels));
    let overrides = Overrides { fault, ..Overrides::default() };
    let error = GpuDevice::with_overrides(&adapter(), overrides).map(|_| ()).expect_err("a wrong label");
    assert_eq!(error.kind, Kind::DeviceUnsuitable);
    assert!(error.message.contains("self-test") && error.message.contains("explain"), "{error}");
    // without a name, an adapter that fails is passed over
    let mut adapters = Vec::new();
    let error = gpu::open(None, overrides, &mut adapters).map(|_| ()).expect_err("no adapter is left");
    assert!(error.message.contains("no gpu can be used") && error.message.contains("self-test"), "{error}");
    assert!(adapters.iter().all(|report| !report.usable && report.reason.is_some()), "{adapters:?}");
    assert!(select::tested_adapters().iter().any(|report| report.usable));
}

#[test]
fn labels_without_the_energy_that_the_device_gave_are_an_error_and_the_next_job_works() {
    let (surface, seeds) = example();
    let mut gpu = device();
    let expected = run(&mut *gpu, &surface, &seeds, ALL).expect("a run");
    gpu.inject(Fault::Miscompute(FaultPoint::Labels));
    let error = run(&mut *gpu, &surface, &seeds, ALL).expect_err("a wrong label");
    assert_eq!(error.kind, Kind::DeviceWrong, "{error}");
    assert!(error.message.contains("explain"), "{error}");
    assert_eq!(run(&mut *gpu, &surface, &seeds, ALL).expect("it works again"), expected);
}

#[test]
fn an_unusable_adapter_is_refused_with_its_reason() {
    let mut found = adapter();
    found.report.usable = false;
    found.report.reason = Some("it is old".to_owned());
    let error = GpuDevice::new(&found).map(|_| ()).expect_err("unusable");
    assert_eq!(error.kind, Kind::DeviceUnsuitable);
    assert!(error.message.ends_with("it is old"), "{error}");
}

#[test]
fn the_cpu_clusters_what_is_too_large_for_the_gpu_of_auto_or_came_back_wrong_and_the_report_warns() {
    let mesh = generate(Sample::Knot, 5000).expect("a sample");
    let parameters = Parameters { clusters: Some(40), ..Parameters::default() };
    let in_memory = InMemory {
        mesh: (&mesh).into(),
        limits: Limits::default(),
        parameters: &parameters,
        seeds: None,
        weights: None,
    };
    let mut prepared = job::prepare_in_memory(&in_memory).expect("a job");
    // what `auto` goes by
    let Input::Mesh(input) = &mut prepared.input else { panic!("a mesh") };
    input.faces = FACES_FOR_GPU;
    let run = |choice, gpu: GpuDevice| {
        let device = DeviceFor { choice, adapter: None };
        job::run_on(device, Some(Ok(Box::new(gpu))), &prepared, &Cancel::default(), &mut |_| {})
    };
    // enough for the self-test
    let narrow = || device_with(without_pages(60_000));
    let wrong = || {
        let mut gpu = opened();
        gpu.inject(Fault::Miscompute(FaultPoint::Labels));
        gpu
    };
    let sound = run(DeviceChoice::Auto, opened()).expect("a result");
    assert_eq!((sound.report.device.kind, &*sound.report.warnings), (DeviceKind::Gpu, &[][..]));
    for (choice, gpu, why) in [
        (DeviceChoice::Auto, narrow(), "60000"),
        (DeviceChoice::Auto, wrong(), "explain"),
        (DeviceChoice::Gpu, wrong(), "explain"),
    ] {
        let outcome = run(choice, gpu).expect("the cpu's result");
        assert_eq!(outcome.report.device.kind, DeviceKind::Cpu);
        assert_eq!(outcome.labels, sound.labels);
        let warning = outcome.report.warnings.join("; ");
        assert!(warning.contains("the cpu clustered the mesh") && warning.contains(why), "{warning}");
    }
    // a gpu that was wanted is not replaced
    let error = run(DeviceChoice::Gpu, narrow()).map(|_| ()).expect_err("it does not fit");
    assert_eq!(error.kind, Kind::DeviceUnsuitable);
}
