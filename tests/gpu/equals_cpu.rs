//! The gpu and the cpu device give the same rows and labels for whole runs, over generated and real meshes.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use crate::common::gpu::{ALL, PLAIN, cluster_counts, device, opened, run, seeds, tuned};
use crate::common::{floods, zoo};
use tesserae_mesh::cluster::coarse::CoarseStart;
use tesserae_mesh::cluster::flat::Options;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::cluster::run::Row;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::gpu::{GpuDevice, Tuning};
use tesserae_mesh::device::{Cancel, Device, FLOOD_FROM};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::{Surface, Wanted, WantedFeatures};

/// Compares a run on both devices.
pub fn compare(
    gpu: &mut GpuDevice,
    context: &str,
    surface: &Surface,
    (clusters, kind, seed): (u64, &Seeds, u64),
    options: Options,
) -> Vec<Row> {
    let context = format!("{context} k={clusters} seeds={kind} seed={seed} {options:?}");
    let seeds = seeds(surface, clusters, kind, seed);
    let cpu_run = run(&mut CpuDevice::new(), surface, &seeds, options).expect("the cpu runs");
    let gpu_run = run(gpu, surface, &seeds, options).expect("the gpu runs");
    assert_eq!(gpu_run.3, cpu_run.3, "{context}: rows");
    // labels are long: a failure prints the first difference
    for (name, gpu, cpu) in [("initial", &gpu_run.0, &cpu_run.0), ("final", &gpu_run.1, &cpu_run.1)] {
        assert_eq!(gpu.len(), cpu.len(), "{context}");
        let difference = (0..gpu.len()).find(|&face| gpu[face] != cpu[face]);
        assert_eq!(difference, None, "{context}: {name} labels");
    }
    assert_eq!(gpu_run.2, cpu_run.2, "{context}: ending");
    gpu_run.3
}

#[test]
fn the_zoo_is_clustered_alike() {
    // iterations as one dispatch, and as several
    let mut gpus = [opened(), tuned(Tuning { chain_items: 0, ..Tuning::default() })];
    for (at, (name, mesh)) in zoo::all().into_iter().enumerate() {
        let surface = Surface::build(&mesh).expect("the zoo can be put on the lattice");
        for (turn, clusters) in cluster_counts(&surface).into_iter().enumerate() {
            for (gpu, kind, seed) in zoo::in_turn(at + turn, &[(0, Seeds::Morton, 0), (1, Seeds::Random, 1)]) {
                compare(&mut gpus[gpu], &name, &surface, (clusters, &kind, seed), ALL);
            }
        }
    }
}

#[test]
fn floods_are_made_alike() {
    let mut gpu = device();
    for (name, surface, seeds) in floods() {
        for max_iterations in [Some(FLOOD_FROM - 1), Some(FLOOD_FROM + 1), None] {
            let options = Options { max_iterations, ..ALL };
            let expected = run(&mut CpuDevice::new(), &surface, &seeds, options).expect("the cpu runs");
            let found = run(&mut *gpu, &surface, &seeds, options).expect("the gpu runs");
            assert!(expected.3.len() >= FLOOD_FROM as usize, "{name}: {} rows", expected.3.len());
            assert_eq!(found.3, expected.3, "{name} {max_iterations:?}: rows");
            assert!(found == expected, "{name} {max_iterations:?}: labels or ending");
        }
    }
}

#[test]
fn larger_meshes_are_clustered_alike() {
    let mut gpu = device();
    let mut phases = BTreeSet::new();
    for (at, (sample, faces, clusters)) in [
        (Sample::Knot, 20_000, 300),
        (Sample::Parts, 20_000, 100),
        (Sample::Quads, 10_000, 5_000),
        (Sample::Strip, 3_000, 4),
        (Sample::Terrain, 20_000, 1),
    ]
    .into_iter()
    .enumerate()
    {
        let mesh = generate(sample, zoo::sized(faces)).expect("a sample");
        let surface = Surface::build(&mesh).expect("a surface");
        let all = [
            ALL,
            PLAIN,
            Options { refine: false, ..ALL },
            Options { max_iterations: Some(13), ..ALL },
            Options { max_iterations: Some(60), ..ALL },
        ];
        for options in zoo::in_turn(at, &all) {
            let what = (clusters.min(surface.faces() as u64 / 2), &Seeds::Random, 7);
            for row in compare(&mut gpu, sample.name(), &surface, what, options) {
                phases.insert(format!("{:?}", row.phase));
            }
        }
    }
    // otherwise the comparison says little
    assert_eq!(Vec::from_iter(phases), ["Boundary", "Refine", "Repair"]);
}

/// All meshes of the folder that TESSERAE_TEST_MESHES names, the smallest first, until the time is up: every
/// mesh for several k and seeds.
#[test]
fn real_meshes_are_clustered_alike() {
    let Some(folder) = zoo::shared_meshes() else {
        return;
    };
    let end = Instant::now() + Duration::from_secs(if zoo::is_long() { 1200 } else { 2 });
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .filter_map(|path| {
            let format = match path.extension()?.to_str()? {
                "obj" => Format::Obj,
                "glb" => Format::Glb,
                _ => return None,
            };
            let bytes = std::fs::read(&path).expect("a file");
            let mesh = mesh::read(&bytes, format, &NoResources, &Limits::default())
                .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            Some((mesh.faces.len(), path, mesh))
        })
        .collect();
    files.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
    assert!(!files.is_empty(), "the folder has meshes");
    let mut gpu = device();
    // the bunny in any case
    if let Some((_, path, mesh)) =
        files.iter().find(|file| file.1.file_stem().is_some_and(|name| name == "stanford-bunny"))
    {
        let surface = Surface::build(mesh).expect("a surface");
        let what = (1000, &Seeds::Morton, 0);
        compare(&mut gpu, &path.display().to_string(), &surface, what, ALL);
    }
    for (at, (_, path, mesh)) in files.iter().enumerate() {
        let surface = Surface::build(mesh).expect("a surface");
        let (fewest, most) = (surface.components.len() as u64, surface.faces() as u64);
        for clusters in [fewest, 8, 100, 1000, most / 20] {
            let clusters = clusters.clamp(fewest, most);
            for (kind, seed) in [(Seeds::Morton, 0), (Seeds::Random, 1)] {
                if Instant::now() > end {
                    let left = files.len() - at;
                    eprintln!("notice: {left} meshes left when the time was up (make test-long has more)");
                    return;
                }
                let what = (clusters, &kind, seed);
                compare(&mut gpu, &path.display().to_string(), &surface, what, ALL);
            }
        }
    }
}

#[test]
fn coarse_starts_are_alike_whatever_the_quality() {
    let mut gpu = tuned(Tuning { start_on_cpu: 0, ..Tuning::default() });
    for (sample, faces, clusters) in [(Sample::Knot, 3000, 40), (Sample::Parts, 1200, 60)] {
        let surface = Surface::build(&generate(sample, zoo::sized(faces)).expect("a sample")).expect("a surface");
        let mut starts = Vec::new();
        for quality in [Quality::Fast, Quality::Default, Quality::Best] {
            let on = |device: &mut dyn Device| {
                let start = CoarseStart::new(&surface, clusters, 7, quality.start(surface.moves));
                start.and_then(|start| start.labels(&surface, device, &Cancel::default())).expect("it runs")
            };
            let start = on(&mut CpuDevice::new());
            assert_eq!(on(&mut gpu), start, "{} {quality:?}", sample.name());
            starts.push(start.labels);
        }
        assert!(starts[0] != starts[1] && starts[1] != starts[2], "the presets differ");
    }
}

#[test]
fn density_changes_labels_alike() {
    let mut gpu = device();
    for (sample, faces) in [(Sample::Knot, 5000), (Sample::Parts, 3000), (Sample::Quads, 3000)] {
        let mesh = generate(sample, faces).expect("a sample");
        let weights: Vec<f64> = (0..mesh.faces.len()).map(|face| 1.0 + (face % 97) as f64 * 0.3).collect();
        let wanted = Wanted { weights: Some(&weights), curvature_exponent: Some(1.5) };
        let surface = Surface::build_with(&mesh, false, wanted, None).expect("a surface");
        compare(&mut gpu, sample.name(), &surface, (80, &Seeds::Morton, 0), ALL);
    }
}

#[test]
fn feature_edges_keep_clusters_apart_alike() {
    let mut gpu = device();
    for (sample, angle) in [(Sample::Cube, 30.0), (Sample::Knot, 20.0), (Sample::Parts, 25.0)] {
        let mesh = generate(sample, 2500).expect("a sample");
        let groups: Vec<u32> = (0..mesh.faces.len() as u32).map(|face| face / 700).collect();
        let features = WantedFeatures { angle: Some(angle), groups: Some(&groups) };
        let surface = Surface::build_with(&mesh, false, Wanted::default(), Some(features)).expect("a surface");
        assert!(!surface.features.is_empty());
        let clusters = surface.components.len() as u64 + 40;
        compare(&mut gpu, sample.name(), &surface, (clusters, &Seeds::Morton, 0), ALL);
    }
}

#[test]
fn the_comparison_fails_when_the_devices_see_different_meshes_or_seeds() {
    let mesh = generate(Sample::Knot, 2500).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let seeds_here = seeds(&surface, 40, &Seeds::Random, 7);
    let cpu_run = run(&mut CpuDevice::new(), &surface, &seeds_here, ALL).expect("a run");
    let mut gpu = device();
    let same = run(&mut *gpu, &surface, &seeds_here, ALL).expect("a run");
    assert_eq!(same, cpu_run);

    let mut heavier = Surface::build(&mesh).expect("a surface");
    heavier.items.graph.weights[100] += 1;
    let other = run(&mut *gpu, &heavier, &seeds_here, ALL).expect("a run");
    assert_ne!(other.3, cpu_run.3, "a weight");

    let mut moved = Surface::build(&mesh).expect("a surface");
    moved.items.graph.points[100][1] += 1;
    let other = run(&mut *gpu, &moved, &seeds_here, ALL).expect("a run");
    assert_ne!(other.3, cpu_run.3, "a centroid");

    let mut seeds_there = seeds(&surface, 40, &Seeds::Random, 7);
    seeds_there.face_of_cluster.swap(3, 4);
    let other = run(&mut *gpu, &surface, &seeds_there, ALL).expect("a run");
    assert_ne!(other.1, cpu_run.1, "seeds");
}
