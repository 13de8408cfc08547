//! Hierarchies on the gpu: the same trees, rows and labels as on the cpu, at every level.

use std::collections::BTreeSet;

use crate::common::gpu::{ALL, adapter, device, device_with, numbers, run as run_flat, seeds, surface, without_pages};
use crate::common::{pml, zoo};
use tesserae_mesh::Kind;
use tesserae_mesh::cluster::hierarchy::{Hierarchy, Options, RoundRow, hierarchical};
use tesserae_mesh::cluster::merging::Pairs;
use tesserae_mesh::cluster::run::Row;
use tesserae_mesh::dev::sample::hard::star;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::adapter::AdapterKind;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::dual_edge::{Rank, Ties, mutual};
use tesserae_mesh::device::gpu::{Fault, FaultPoint, GpuDevice, Overrides, Tuning};
use tesserae_mesh::device::{Cancel, Device, FREE};
use tesserae_mesh::energy::cvd::ClusterSums;
use tesserae_mesh::error::Result;
use tesserae_mesh::hierarchy::Tree;
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::Surface;

/// Sequential rounds with optimisation.
fn ml() -> Options {
    Options { sequential_at: u64::MAX, ..pml() }
}

/// Everything that a run says; equal means equal to the last bit of every energy.
#[derive(Debug, PartialEq)]
pub struct Outcome {
    tree: Tree,
    labels: Vec<u32>,
    rows: Vec<Row>,
    rounds: Vec<RoundRow>,
}

fn run(device: &mut dyn Device, surface: &Surface, options: &Options) -> Result<Outcome> {
    let (mut rows, mut rounds) = (Vec::new(), Vec::new());
    let cancel = Cancel::default();
    let (on_row, on_round) = (&mut |row| rows.push(row), &mut |round| rounds.push(round));
    let Hierarchy { tree, labels, .. } = hierarchical(surface, options, device, &cancel, on_row, on_round)?;
    Ok(Outcome { tree, labels, rows, rounds })
}

/// Runs on both devices; the outcome when they agree.
pub fn compare(gpu: &mut GpuDevice, context: &str, surface: &Surface, options: &Options) -> Outcome {
    let cpu_run = run(&mut CpuDevice::new(), surface, options).expect("the cpu runs");
    let gpu_run = run(gpu, surface, options).expect("the gpu runs");
    // the first difference tells more than two whole trees
    let rounds = gpu_run.rounds.iter().zip(&cpu_run.rounds).find(|(gpu, cpu)| gpu != cpu);
    assert_eq!(rounds, None, "{context} {options:?}: rounds");
    let rows = gpu_run.rows.iter().zip(&cpu_run.rows).find(|(gpu, cpu)| gpu != cpu);
    assert_eq!(rows, None, "{context} {options:?}: rows");
    // merges and moves of all rounds, so the labels at every level
    assert!(gpu_run.tree == cpu_run.tree, "{context} {options:?}: trees");
    assert!(gpu_run == cpu_run, "{context} {options:?}: labels");
    gpu_run
}

fn small_zoo(most: usize) -> Vec<(String, Surface)> {
    let small = zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() <= most);
    small.map(|(name, mesh)| (name, Surface::build(&mesh).expect("the zoo can be put on the lattice"))).collect()
}

#[test]
fn parallel_hierarchies_of_the_zoo_are_alike() {
    let mut gpu = device();
    let mut phases = BTreeSet::new();
    for (at, (name, surface)) in small_zoo(700).into_iter().enumerate() {
        for ties in zoo::in_turn(at / 2, &[Ties::Hash, Ties::LargestId]) {
            compare(&mut gpu, &name, &surface, &Options { ties, optimised_from: 4, ..pml() });
            let outcome = compare(&mut gpu, &name, &surface, &Options { ties, ..pml() });
            phases.extend(outcome.rows.iter().map(|row| format!("{:?}", row.phase)));
        }
        let others = [
            Options { optimise: false, ..pml() },
            Options { refine: false, ..pml() },
            Options { refine: false, pairs: Pairs::All, ..pml() },
        ];
        for options in zoo::in_turn(at, &others) {
            compare(&mut gpu, &name, &surface, &options);
        }
    }
    // otherwise the comparison says little
    assert_eq!(Vec::from_iter(phases), ["Boundary", "Refine", "Repair"]);
}

#[test]
fn sequential_hierarchies_of_the_zoo_are_alike() {
    let mut gpu = device();
    let of = |ties, optimise| Options { ties, optimise, ..ml() };
    let all = [of(Ties::Hash, true), of(Ties::Hash, false), of(Ties::LargestId, true), of(Ties::LargestId, false)];
    for (at, (name, surface)) in small_zoo(130).into_iter().enumerate() {
        for options in zoo::in_turn(at, &all) {
            compare(&mut gpu, &name, &surface, &options);
        }
    }
    let knot = surface(Sample::Knot, 300);
    let fifth = Options { collapse_fraction: Some(20.0), ..ml() };
    let rounds = all.iter().chain([&fifth]).flat_map(|options| compare(&mut gpu, "knot", &knot, options).rounds);
    assert!(rounds.map(|round| round.moves).sum::<u64>() > 100, "the optimisation has something to do");
}

#[test]
fn hierarchies_around_a_hub_are_alike() {
    let surface = Surface::build(&star(300)).expect("a surface");
    for options in [pml(), Options { optimise: false, ..pml() }] {
        let outcome = compare(&mut device(), "star", &surface, &options);
        assert!(outcome.rounds.iter().skip(256).any(|round| round.merges > 1), "{options:?}: one pair a round");
    }
}

#[test]
fn larger_hierarchies_stops_and_mixtures_are_alike() {
    let mut gpu = device();
    let samples = [(Sample::Knot, 2000), (Sample::Parts, 1500), (Sample::Quads, 1000)];
    for (at, options) in [
        Options { levels: vec![321, 40], ..pml() },
        Options { optimised_from: 4, levels: vec![900], ..pml() },
        Options { levels: vec![321], clusters: Some(77), iterations_a_round: [3; 2], ..pml() },
        Options { clusters: Some(50), allow_disconnected: true, ..pml() },
        Options { sequential_at: 30, ..pml() },
        Options { iterations_a_round: [30; 2], pairs: Pairs::All, ..pml() },
        Options { iterations_a_round: [u32::MAX; 2], ..pml() },
    ]
    .into_iter()
    .enumerate()
    {
        for (sample, faces) in zoo::in_turn(at, &samples) {
            let outcome = compare(&mut gpu, sample.name(), &surface(sample, faces), &options);
            let levels: Vec<u64> =
                outcome.rounds.iter().filter(|round| round.is_level).map(|round| round.clusters).collect();
            assert!(options.levels.iter().all(|level| levels.contains(level)), "{levels:?}");
        }
    }
}

#[test]
fn hierarchies_whose_first_merges_are_the_cpus_are_alike() {
    let tuning = Tuning { merges_up_to: 0, ..Tuning::default() };
    let mut gpu = device_with(Overrides { tuning, ..Overrides::default() });
    let dispatches = |gpu: &mut GpuDevice| {
        let profile = (gpu as &mut dyn Device).take_profile().expect("a profile");
        profile.map(|profile| profile.total().dispatches)
    };
    let late = Options { optimised_from: 4, ..pml() };
    for (at, (name, surface)) in small_zoo(700).into_iter().enumerate() {
        for ties in zoo::in_turn(at / 2, &[Ties::Hash, Ties::LargestId]) {
            compare(&mut gpu, &name, &surface, &Options { ties, ..late.clone() });
        }
    }
    let samples = [(Sample::Knot, 2000), (Sample::Parts, 1500), (Sample::Quads, 1000)];
    let all = [
        late.clone(),
        Options { levels: vec![900, 40], ..late.clone() },
        Options { sequential_at: 30, clusters: Some(20), ..late.clone() },
        Options { sequential_at: 700, levels: vec![600], clusters: Some(590), ..late.clone() },
    ];
    for (at, options) in all.iter().enumerate() {
        for (sample, faces) in zoo::in_turn(at, &samples) {
            compare(&mut gpu, sample.name(), &surface(sample, faces), options);
        }
    }
    // the device makes fewer rounds
    let knot = surface(Sample::Knot, 2000);
    let mut counts = Vec::new();
    for merges_up_to in [0, u32::MAX] {
        let tuning = Tuning { merges_up_to, ..Tuning::default() };
        let mut gpu = device_with(Overrides { tuning, timed: true, ..Overrides::default() });
        dispatches(&mut gpu);
        run(&mut gpu, &knot, &late).expect("a run");
        counts.extend(dispatches(&mut gpu));
    }
    assert!(counts.is_sorted_by(|few, many| few < many), "{counts:?}");
}

#[test]
fn jobs_of_all_kinds_one_after_the_other_are_alike() {
    let mut gpu = device();
    for (round, faces) in [2000, 500, 900].into_iter().enumerate() {
        let surface = surface(Sample::Knot, faces);
        let options = Options { sequential_at: 8, levels: vec![40], ..pml() };
        compare(&mut gpu, &format!("job {round}"), &surface, &options);
        let seeds = seeds(&surface, 40, &Seeds::Random, 3);
        let expected = run_flat(&mut CpuDevice::new(), &surface, &seeds, ALL).expect("the cpu runs");
        assert!(run_flat(&mut *gpu, &surface, &seeds, ALL).expect("the gpu runs") == expected, "job {round}");
    }
}

#[test]
fn the_comparison_fails_when_the_devices_see_different_meshes_or_options() {
    let mesh = generate(Sample::Knot, 700).expect("a sample");
    let here = Surface::build(&mesh).expect("a surface");
    let mut gpu = device();
    let expected = run(&mut CpuDevice::new(), &here, &pml()).expect("the cpu runs");
    assert!(run(&mut *gpu, &here, &pml()).expect("the gpu runs") == expected);

    let mut heavier = Surface::build(&mesh).expect("a surface");
    heavier.items.graph.weights[100] += 1;
    let other = run(&mut *gpu, &heavier, &pml()).expect("the gpu runs");
    assert!(other.tree != expected.tree, "a weight");

    let mut moved = Surface::build(&mesh).expect("a surface");
    moved.items.graph.points[100][1] += 1;
    let other = run(&mut *gpu, &moved, &pml()).expect("the gpu runs");
    assert!(other.tree != expected.tree, "a centroid");

    let cube = surface(Sample::Cube, 192);
    let by_hash = run(&mut CpuDevice::new(), &cube, &pml()).expect("the cpu runs");
    let by_id = run(&mut *gpu, &cube, &Options { ties: Ties::LargestId, ..pml() }).expect("the gpu runs");
    assert!(by_id.tree != by_hash.tree, "the order of equal costs");
}

#[test]
fn merges_keep_sums_and_labels_in_step_and_moves_are_counted_from_the_last() {
    let surface = surface(Sample::Knot, 2500);
    let components = surface.component_of_face();
    let all: Vec<u32> = (0..surface.faces() as u32).collect();
    let mut gpu = device();
    let mut cpu = CpuDevice::new();
    let mut on_gpu = gpu.open_merging(&surface, &components).expect("it fits");
    let mut on_cpu = cpu.open_merging(&surface, &components).expect("it fits");
    let mut moved = 0;
    // twice: labels that are set anew forget the merges
    for _ in 0..2 {
        on_gpu.set_labels(&all).expect("set");
        on_cpu.set_labels(&all).expect("set");
        assert_eq!(on_gpu.moves_since_merge().expect("moves"), []);
        for round in 0..6 {
            let edges = on_gpu.optimal_dual_edges(Ties::Hash).expect("a search");
            assert_eq!(edges, on_cpu.optimal_dual_edges(Ties::Hash).expect("a search"), "round {round}");
            let chose = |cluster| edges.iter().find(|edge| edge.cluster == cluster).map(|edge| edge.other);
            let pairs: Vec<(u32, u32)> = edges
                .iter()
                .filter(|edge| edge.cluster < edge.other && chose(edge.other) == Some(edge.cluster))
                .map(|edge| (edge.other, edge.cluster))
                .collect();
            on_gpu.merge(&pairs).expect("a merge");
            on_cpu.merge(&pairs).expect("a merge");
            assert_eq!(on_gpu.labels().expect("labels"), on_cpu.labels().expect("labels"), "round {round}");
            assert_eq!(on_gpu.energy().expect("energy"), on_cpu.energy().expect("energy"), "round {round}");
            assert_eq!(on_gpu.moves_since_merge().expect("moves"), [], "round {round}");
            on_gpu.optimise_boundary(2, &Cancel::default(), &mut |_| {}).expect("optimise");
            on_cpu.optimise_boundary(2, &Cancel::default(), &mut |_| {}).expect("optimise");
            let moves = on_gpu.moves_since_merge().expect("moves");
            assert_eq!(moves, on_cpu.moves_since_merge().expect("moves"), "round {round}");
            moved += moves.len();
            assert_eq!(on_gpu.sums_of(&all).expect("sums"), on_cpu.sums_of(&all).expect("sums"), "round {round}");
        }
    }
    assert!(moved > 0, "nothing moved");
    // a cluster that is gone has no sums
    let labels = on_gpu.labels().expect("labels");
    let gone = all.iter().copied().find(|cluster| !labels.contains(cluster)).expect("some merged");
    assert_eq!(on_gpu.sums_of(&[gone]).expect("sums"), [ClusterSums::default()]);
}

/// Labels in which one face in five is in the cluster of its first neighbour, as long as its own keeps a face.
fn mixed(surface: &Surface, labels: &[u32]) -> Vec<u32> {
    let mut labels = labels.to_vec();
    let mut sizes = vec![0; surface.faces()];
    labels.iter().for_each(|&label| sizes[label as usize] += 1);
    for face in (0..surface.faces()).step_by(5) {
        let (own, near) = (labels[face], labels[surface.neighbours_of(face as u32)[0] as usize]);
        if sizes[own as usize] > 1 {
            labels[face] = near;
            sizes[own as usize] -= 1;
            sizes[near as usize] += 1;
        }
    }
    labels
}

#[test]
fn moves_since_a_merge_are_all_known_whatever_made_them() {
    let surface = surface(Sample::Knot, 2500);
    let components = surface.component_of_face();
    let all: Vec<u32> = (0..surface.faces() as u32).collect();
    let mut gpu = device();
    let mut cpu = CpuDevice::new();
    let mut told = Vec::new();
    for device in [&mut *gpu as &mut dyn Device, &mut cpu] {
        let cancel = Cancel::default();
        let mut steps = device.open_merging(&surface, &components).expect("it fits");
        steps.set_labels(&all).expect("set");
        let mut found = Vec::new();
        for _ in 0..6 {
            let edges = steps.optimal_dual_edges(Ties::Hash).expect("a search");
            let pairs: Vec<(u32, u32)> = mutual(&edges, &mut Vec::new()).iter().map(Rank::ends).collect();
            steps.merge(&pairs).expect("a merge");
            steps.optimise_boundary(2, &cancel, &mut |_| {}).expect("optimise");
            let mut cut_off = steps.repair(&cancel).expect("a repair");
            let labels = steps.labels().expect("labels");
            steps.relabel(&mixed(&surface, &labels)).expect("relabel");
            steps.optimise_boundary(1, &cancel, &mut |_| {}).expect("optimise");
            // a search in between takes nothing off the list
            steps.optimal_dual_edges(Ties::Hash).expect("a search");
            steps.refine(2, &cancel, &mut |_| {}).expect("refine");
            cut_off += steps.repair(&cancel).expect("a repair");
            let labels = steps.labels().expect("labels");
            steps.relabel(&mixed(&surface, &labels)).expect("relabel");
            found.push((cut_off, steps.moves_since_merge().expect("moves"), steps.labels().expect("labels")));
        }
        told.push(found);
    }
    for (round, (on_gpu, on_cpu)) in told[0].iter().zip(&told[1]).enumerate() {
        assert!(on_gpu == on_cpu, "round {round}");
    }
    assert!(told[0].iter().any(|(cut_off, ..)| *cut_off > 0), "something was cut off");
    let moved: usize = told[0].iter().map(|(_, moves, _)| moves.len()).sum();
    assert!(moved > 100, "{moved}");
}

#[test]
fn more_moves_than_expected_are_all_listed() {
    let mut surface = surface(Sample::Strip, 16_000);
    let faces = surface.faces();
    let mut next = numbers(11);
    let labels: Vec<u32> = (0..faces).map(|_| next(50) as u32).collect();
    surface.items.graph.components[0].energy_shift = 0;
    let components = vec![0; 50];
    let mut gpu = device();
    let mut cpu = CpuDevice::new();
    let mut lists = Vec::new();
    for device in [&mut *gpu as &mut dyn Device, &mut cpu] {
        let mut steps = device.open_merging(&surface, &components).expect("it fits");
        steps.set_labels(&labels).expect("set");
        steps.merge(&[]).expect("a merge");
        steps.optimise_boundary(2, &Cancel::default(), &mut |_| {}).expect("optimise");
        lists.push(steps.moves_since_merge().expect("moves"));
    }
    assert!(lists[0].len() > 8192, "{}", lists[0].len());
    assert!(lists[0].is_sorted());
    assert!(lists[0] == lists[1]);
}

#[test]
fn narrow_dispatches_give_the_same_hierarchy() {
    let surface = surface(Sample::Knot, 2000);
    let options = Options { sequential_at: 5, ..pml() };
    let expected = run(&mut CpuDevice::new(), &surface, &options).expect("the cpu runs");
    let mut narrow = device_with(Overrides { workgroups_per_dimension: Some(3), ..Overrides::default() });
    assert!(run(&mut narrow, &surface, &options).expect("the gpu runs") == expected);
}

#[test]
fn what_a_device_cannot_do_is_refused_with_the_numbers() {
    let large = surface(Sample::Knot, 5000);
    let mut gpu = device();
    if adapter().report.kind == AdapterKind::Software {
        let error = run(&mut *gpu, &large, &ml()).expect_err("it would take hours");
        assert_eq!(error.kind, Kind::DeviceUnsuitable);
        assert!(error.message.contains("one by one") && error.message.contains("16777216"), "{error}");
    }
    // a cluster a face, of which the sums are too large
    let needed = 52 * large.faces() as u64;
    let mut small = device_with(without_pages(needed - 1));
    let error = run(&mut small, &large, &Options { optimise: false, ..pml() }).expect_err("one byte too many");
    assert_eq!(error.kind, Kind::DeviceUnsuitable);
    assert!(error.message.contains(&needed.to_string()), "{error}");
    // a cluster for 4 faces when the first round is optimised
    let needed = 4 * (large.faces() + 1 + large.neighbours.items.len()) as u64;
    let mut small = device_with(without_pages(needed));
    let late = Options { optimised_from: 4, ..pml() };
    compare(&mut small, "knot", &large, &late);
    // a level at which too many are left is refused before the first round
    let options = Options { levels: vec![4000], ..late };
    let (mut rounds, cancel) = (0, Cancel::default());
    let error = hierarchical(&large, &options, &mut small, &cancel, &mut |_| {}, &mut |_| rounds += 1);
    assert_eq!((error.expect_err("it does not fit").kind, rounds), (Kind::DeviceUnsuitable, 0));

    let small = surface(Sample::Cube, 48);
    let components = small.component_of_face();
    let mut steps = gpu.open_merging(&small, &components).expect("it fits");
    steps.set_labels(&vec![FREE; small.faces()]).expect("set");
    assert_eq!(steps.optimal_dual_edges(Ties::Hash).expect("a search"), []);
    assert_eq!(steps.cheapest_dual_edge(Ties::Hash).expect("a search"), None);
    assert!(steps.labels().expect("labels").iter().all(|&label| label == FREE));
    let outside = small.faces() as u32;
    assert!(steps.merge(&[(0, outside)]).is_err());
    assert!(steps.sums_of(&[outside]).is_err());
    assert!(steps.merge(&vec![(0, 1); small.faces()]).is_err());
}

#[test]
fn a_device_that_is_lost_while_clusters_merge_is_an_error_and_the_next_job_works() {
    let surface = surface(Sample::Knot, 300);
    let options = Options { sequential_at: 20, ..pml() };
    let mut gpu = device();
    let expected = run(&mut *gpu, &surface, &options).expect("a run");
    for point in [FaultPoint::DualEdges, FaultPoint::Merge] {
        for (fault, kind) in [(Fault::Lose(point), Kind::DeviceLost), (Fault::Misuse(point), Kind::Internal)] {
            gpu.inject(fault);
            let error = run(&mut *gpu, &surface, &options).expect_err("it failed");
            assert_eq!(error.kind, kind, "{point:?}: {error}");
            assert!(run(&mut *gpu, &surface, &options).expect("it works again") == expected, "{point:?}");
        }
    }
}
