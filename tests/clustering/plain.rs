//! The cpu device against the plain one: whole clusterings, driven alike, give the same steps and labels.

use crate::common::{floods, zoo};
use tesserae_mesh::cluster::coarse::CoarseStart;
use tesserae_mesh::cluster::flat::{self, Options};
use tesserae_mesh::cluster::hierarchy::{self, Hierarchy, RoundRow, hierarchical};
use tesserae_mesh::cluster::merging::Pairs;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::cluster::record::{Record, Snapshots};
use tesserae_mesh::cluster::run::{Phase, Row};
use tesserae_mesh::cluster::seeds::{self, SeedFaces};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::dual_edge::Ties;
use tesserae_mesh::device::plain::PlainDevice;
use tesserae_mesh::device::{Cancel, Device, FLOOD_FROM};
use tesserae_mesh::hierarchy::Tree;
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::Surface;

/// Meshes on which the plain device does not take long.
fn small_surfaces(most_faces: usize) -> Vec<(String, Surface)> {
    let small = zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() < most_faces);
    small.map(|(name, mesh)| (name, Surface::build(&mesh).expect("the zoo can be put on the lattice"))).collect()
}

fn flat(surface: &Surface, device: &mut dyn Device, clusters: u64, options: Options) -> (Vec<u32>, Vec<Row>) {
    let seeds = seeds::choose(surface, clusters, &Seeds::Random, 4, None).expect("the number is possible");
    from_seeds(surface, device, &seeds, options, &mut Record::default())
}

fn from_seeds(
    surface: &Surface,
    device: &mut dyn Device,
    seeds: &SeedFaces,
    options: Options,
    record: &mut Record,
) -> (Vec<u32>, Vec<Row>) {
    let mut steps = device.open(surface, &seeds.component_of_cluster).expect("it opens");
    let mut rows = Vec::new();
    let start = seeds.labels(surface.faces());
    let clustering = flat::boundary_based(
        surface,
        &start,
        options,
        steps.as_mut(),
        &Cancel::default(),
        &mut |row| rows.push(row),
        record,
    );
    (clustering.expect("no cancellation").labels, rows)
}

/// Iterations of boundary phases that were floods, if no phase was interrupted.
fn flooded(rows: &[Row]) -> usize {
    let phases = rows.chunk_by(|a, b| a.phase == b.phase).filter(|rows| rows[0].phase == Phase::Boundary);
    phases.map(|rows| (rows.len() + 1).saturating_sub(FLOOD_FROM as usize)).sum()
}

#[test]
fn floods_take_the_steps_of_the_plain_device() {
    for (name, surface, seeds) in floods() {
        let options = Options { max_iterations: None, refine: true, allow_disconnected: false };
        let run = |device: &mut dyn Device, record: &mut Record| from_seeds(&surface, device, &seeds, options, record);
        let expected = run(&mut PlainDevice::default(), &mut Record::default());
        println!("{name}: {} rows, {} floods", expected.1.len(), flooded(&expected.1));
        assert!(flooded(&expected.1) > 0, "{name}: {} rows", expected.1.len());
        assert_eq!(run(&mut CpuDevice::new(), &mut Record::default()), expected, "{name}");
        // an interrupted phase counts its iterations on
        let at = vec![0, 100, FLOOD_FROM - 1, FLOOD_FROM, FLOOD_FROM + 1];
        for device in [&mut PlainDevice::default() as &mut dyn Device, &mut CpuDevice::new()] {
            let mut record = Record::new(Some(Snapshots::At(at.clone())));
            assert_eq!(run(device, &mut record), expected, "{name}");
        }
        // refinement between clusters that may be cut would move a few faces an iteration
        let mut free = expected.1.iter().take_while(|row| row.phase != Phase::Repair);
        assert!(free.all(|row| row.phase != Phase::Refine), "{name}");
    }
}

#[test]
fn flat_clusterings_take_the_steps_of_the_plain_device() {
    let mut phases = Vec::new();
    for (name, surface) in small_surfaces(1000) {
        let fewest = surface.components.len() as u64;
        let clusters = (surface.faces() as u64 / 12).max(fewest);
        for allow_disconnected in [false, true] {
            let options = Options { max_iterations: None, refine: true, allow_disconnected };
            let expected = flat(&surface, &mut PlainDevice::default(), clusters, options);
            assert_eq!(flat(&surface, &mut CpuDevice::new(), clusters, options), expected, "{name}");
            phases.extend(expected.1.iter().map(|row| row.phase));
        }
    }
    phases.dedup();
    assert!(phases.len() > 20, "{phases:?}");
}

#[test]
fn coarse_starts_are_those_of_the_plain_device() {
    let mut differ_from_fast = 0;
    for (name, surface) in small_surfaces(1000) {
        let clusters = (surface.faces() as u64 / 20).max(surface.components.len() as u64);
        let labels = |quality: Quality, device: &mut dyn Device| {
            let start =
                CoarseStart::new(&surface, clusters, 3, quality.start(surface.moves)).expect("the number is possible");
            start.labels(&surface, device, &Cancel::default()).expect("no cancellation")
        };
        let expected = [Quality::Fast, Quality::Default].map(|q| labels(q, &mut PlainDevice::default()));
        assert_eq!([Quality::Fast, Quality::Default].map(|q| labels(q, &mut CpuDevice::new())), expected, "{name}");
        differ_from_fast += usize::from(expected[0] != expected[1]);
    }
    assert!(differ_from_fast > 0, "no mesh shows a difference");
}

fn hierarchy(
    surface: &Surface,
    device: &mut dyn Device,
    options: &hierarchy::Options,
) -> (Tree, Vec<u32>, Vec<RoundRow>) {
    let mut rounds = Vec::new();
    let run = hierarchical(surface, options, device, &Cancel::default(), &mut |_| {}, &mut |row| rounds.push(row));
    let Hierarchy { tree, labels, .. } = run.expect("no cancellation");
    (tree, labels, rounds)
}

#[test]
fn hierarchies_take_the_steps_of_the_plain_device() {
    let mut moves = 0;
    for (name, surface) in small_surfaces(800) {
        let parallel = hierarchy::Options {
            sequential_at: 0,
            collapse_fraction: None,
            optimise: true,
            refine: true,
            iterations_a_round: [2, u32::MAX],
            optimised_from: 2,
            pairs: Pairs::CheaperHalf,
            ties: Ties::Hash,
            clusters: None,
            levels: vec![surface.components.len().max(surface.faces() / 7) as u64],
            allow_disconnected: false,
            relocation: Some(Quality::Default),
        };
        let nested = hierarchy::Options { optimise: false, ties: Ties::LargestId, ..parallel.clone() };
        let sequential_at = surface.components.len() as u64 + 20;
        let mixed = hierarchy::Options { sequential_at, optimised_from: 1, pairs: Pairs::All, ..parallel.clone() };
        for options in [parallel, nested, mixed] {
            let expected = hierarchy(&surface, &mut PlainDevice::default(), &options);
            assert_eq!(hierarchy(&surface, &mut CpuDevice::new(), &options), expected, "{name} {options:?}");
            moves += expected.2.iter().map(|row| row.moves).sum::<u64>();
        }
    }
    assert!(moves > 100, "hardly any face moved: {moves}");
}

#[test]
fn a_changed_weight_shows_in_the_comparison() {
    let (_, mut surface) = small_surfaces(1000).into_iter().max_by_key(|(_, surface)| surface.faces()).expect("a mesh");
    let clusters = (surface.faces() as u64 / 12).max(surface.components.len() as u64);
    let options = Options { max_iterations: None, refine: true, allow_disconnected: false };
    let expected = flat(&surface, &mut PlainDevice::default(), clusters, options);
    surface.items.graph.weights[0] += 1;
    assert_ne!(flat(&surface, &mut CpuDevice::new(), clusters, options), expected);
}
