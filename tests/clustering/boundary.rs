//! Boundary-based clustering against its definition, and the promises that every clustering keeps.

use crate::common::zoo;
use tesserae_mesh::cluster::flat::Options;
use tesserae_mesh::cluster::record::Record;
use tesserae_mesh::cluster::run::Row;
use tesserae_mesh::cluster::{self, seeds::SeedFaces};
use tesserae_mesh::dev::sample::hard::stacked_boxes;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Cancel, Device, FLOOD_FROM, FREE, pieces, plain};
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::report::Phase;
use tesserae_mesh::surface::Surface;

/// Numbers of clusters worth trying on a surface.
fn cluster_counts(surface: &Surface) -> Vec<u64> {
    let (fewest, most) = (surface.components.len() as u64, surface.faces() as u64);
    let mut counts: Vec<u64> =
        [fewest, fewest + 1, most / 50, most / 7, most - 1, most].map(|k| k.clamp(fewest, most)).to_vec();
    counts.sort_unstable();
    counts.dedup();
    counts
}

fn seeds(surface: &Surface, clusters: u64, kind: &Seeds, seed: u64) -> SeedFaces {
    cluster::seeds::choose(surface, clusters, kind, seed, None).expect("the number is possible")
}

/// Runs a clustering on the cpu device.
fn run(surface: &Surface, seeds: &SeedFaces, options: Options) -> (cluster::flat::Clustering, Vec<Row>) {
    let mut device = CpuDevice::new();
    let mut steps = device.open(surface, &seeds.component_of_cluster).expect("the cpu takes everything");
    let mut rows = Vec::new();
    let clustering = cluster::flat::boundary_based(
        surface,
        &seeds.labels(surface.faces()),
        options,
        steps.as_mut(),
        &Cancel::default(),
        &mut |row| rows.push(row),
        &mut Record::default(),
    )
    .expect("nobody cancels");
    (clustering, rows)
}

const PLAIN: Options = Options { max_iterations: None, refine: false, allow_disconnected: true };
const REFINED: Options = Options { max_iterations: None, refine: true, allow_disconnected: false };
const CONNECTED: Options = Options { max_iterations: None, refine: false, allow_disconnected: false };

#[test]
fn every_iteration_is_the_one_that_the_definition_says() {
    for (name, mesh) in zoo::all() {
        let surface = Surface::build(&mesh).expect("the zoo can be put on the lattice");
        for clusters in cluster_counts(&surface) {
            for kind in [Seeds::Morton, Seeds::Random] {
                let seeds = seeds(&surface, clusters, &kind, 7);
                let mut free = vec![FREE; surface.faces()];
                for (cluster, &face) in seeds.face_of_cluster.iter().enumerate() {
                    free[face as usize] = cluster as u32;
                }
                let mut labels = plain::grow(&surface, &free);
                let (clustering, rows) = run(&surface, &seeds, PLAIN);
                assert_eq!(clustering.initial, labels, "{name} k={clusters}: growth");
                let explained = plain::explained(&surface, &seeds.component_of_cluster, &labels);
                assert_eq!(rows[0].energy.explained, explained, "{name} k={clusters}: energy of the growth");
                for row in &rows[1..] {
                    let state = plain::iterate(&surface, &seeds.component_of_cluster, &labels, row.iteration)
                        .unwrap_or_else(|| {
                            panic!("{name} k={clusters}: the plain version has converged before {row:?}")
                        });
                    assert_eq!(
                        (row.moves, row.energy.explained),
                        (state.moves, state.explained),
                        "{name} k={clusters} iteration {}",
                        row.iteration
                    );
                    labels = state.labels;
                }
                assert_eq!(clustering.labels, labels, "{name} k={clusters}: final labels");
                assert_eq!(
                    plain::iterate(&surface, &seeds.component_of_cluster, &labels, 1),
                    None,
                    "{name} k={clusters}: the plain version goes on"
                );
            }
        }
    }
}

#[test]
fn a_higher_stack_of_boxes_takes_no_more_iterations() {
    let most = 300;
    for boxes in [200, 800] {
        let surface = Surface::build(&stacked_boxes(boxes)).expect("a surface");
        let (clustering, rows) = run(&surface, &seeds(&surface, 10, &Seeds::Random, 1), REFINED);
        assert!((FLOOD_FROM as usize..most).contains(&rows.len()), "{boxes} boxes: {} rows", rows.len());
        assert_eq!(pieces::disconnected_clusters(&surface, 10, &clustering.labels), 0, "{boxes} boxes");
        for rows in rows.chunk_by(|a, b| a.phase == b.phase).filter(|rows| rows[0].phase == Phase::Boundary) {
            assert!(rows.is_sorted_by(|a, b| a.energy < b.energy), "{boxes} boxes: F falls within a phase");
        }
    }
}

#[test]
fn every_refinement_is_the_one_that_the_definition_says() {
    let mut iterations = 0;
    for (name, mesh) in zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() < 1000) {
        let surface = Surface::build(&mesh).expect("the zoo can be put on the lattice");
        for clusters in cluster_counts(&surface) {
            let seeds = seeds(&surface, clusters, &Seeds::Random, 5);
            let options = Options { max_iterations: None, refine: true, allow_disconnected: true };
            let boundary = run(&surface, &seeds, PLAIN).0.labels;
            let (refined, rows) = run(&surface, &seeds, options);
            let mut plain = plain::Refinement::new(&surface, &seeds.component_of_cluster, boundary);
            for row in rows.iter().filter(|row| row.phase == Phase::Refine) {
                let state = plain.iterate().unwrap_or_else(|| panic!("{name} k={clusters}: no bids before {row:?}"));
                assert_eq!(
                    (row.moves, row.energy.explained),
                    (state.moves, state.explained),
                    "{name} k={clusters} iteration {}",
                    row.iteration
                );
                iterations += 1;
            }
            assert_eq!(refined.labels, plain.labels, "{name} k={clusters}: final labels");
            assert_eq!(plain.iterate(), None, "{name} k={clusters}: the plain version goes on");
        }
    }
    assert!(iterations > 100, "hardly anything was compared: {iterations} iterations");
}

#[test]
fn where_repairs_go_round_in_circles_the_last_word_lowers_the_energy_and_keeps_clusters_whole() {
    let mut settled = 0;
    for seed in 0..60 {
        let surface = Surface::build(&zoo::tangle(60, 400, seed)).expect("a surface");
        let most = surface.faces() as u64;
        let k = (surface.components.len() as u64 + 40).min(most);
        let (clustering, rows) = run(&surface, &seeds(&surface, k, &Seeds::Random, seed), REFINED);
        let repairs = rows.iter().filter(|row| row.phase == Phase::Repair).count();
        assert!(repairs <= 3, "{repairs} repairs");
        assert_eq!(pieces::disconnected_clusters(&surface, k as usize, &clustering.labels), 0);
        let last_repair = rows.iter().rposition(|row| row.phase == Phase::Repair);
        settled += usize::from(repairs == 3 && last_repair.is_some_and(|at| at + 1 < rows.len()));
    }
    assert!(settled > 0, "no run needed it");
}

#[test]
fn a_changed_weight_shows_in_the_comparison_with_the_definition() {
    let mesh = tesserae_mesh::dev::sample::generate(tesserae_mesh::dev::sample::Sample::Knot, 2500).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let seeds = seeds(&surface, 40, &Seeds::Morton, 1);
    let (clustering, rows) = run(&surface, &seeds, PLAIN);
    let mut other = Surface::build(&mesh).expect("a surface");
    other.items.graph.weights[100] += 1;
    let explained = plain::explained(&other, &seeds.component_of_cluster, &clustering.labels);
    assert_ne!(rows.last().map(|row| row.energy.explained), Some(explained));
}

#[test]
fn energy_never_rises_within_a_phase_and_clusters_are_whole() {
    for (name, mesh) in zoo::all() {
        let surface = Surface::build(&mesh).expect("the zoo can be put on the lattice");
        for clusters in cluster_counts(&surface) {
            for (seed, options) in [(0, CONNECTED), (0, REFINED), (1, CONNECTED), (2, REFINED)] {
                let seeds = seeds(&surface, clusters, &Seeds::Random, seed);
                let (clustering, rows) = run(&surface, &seeds, options);
                let context = format!("{name} k={clusters} seed={seed} {options:?}");
                for pair in rows.windows(2) {
                    if pair[1].phase != Phase::Repair {
                        assert!(pair[1].energy > pair[0].energy, "{context}: F falls in {pair:?}");
                        assert!(
                            surface.energy(pair[1].energy) <= surface.energy(pair[0].energy),
                            "{context}: {pair:?}"
                        );
                    }
                }
                let clusters = clusters as usize;
                let mut faces = vec![0; clusters];
                clustering.labels.iter().for_each(|&label| faces[label as usize] += 1);
                assert!(faces.iter().all(|&faces| faces > 0), "{context}: an empty cluster");
                assert_eq!(
                    pieces::disconnected_clusters(&surface, clusters, &clustering.labels),
                    0,
                    "{context}: a cluster in pieces"
                );
            }
        }
    }
}

#[test]
fn repair_is_needed_somewhere() {
    // otherwise the test above would pass without any repair
    let mesh =
        tesserae_mesh::dev::sample::generate(tesserae_mesh::dev::sample::Sample::Knot, 20_000).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let (_, rows) = run(&surface, &seeds(&surface, 300, &Seeds::Random, 0), CONNECTED);
    assert!(rows.iter().any(|row| row.phase == Phase::Repair), "{}", rows.len());
}

#[test]
fn a_limit_on_iterations_ends_with_whole_clusters_too() {
    let mesh = tesserae_mesh::dev::sample::generate(tesserae_mesh::dev::sample::Sample::Knot, 2500).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let seeds = seeds(&surface, 100, &Seeds::Random, 3);
    for limit in [0, 1, 2, 5] {
        let options = Options { max_iterations: Some(limit), refine: true, allow_disconnected: false };
        let (clustering, rows) = run(&surface, &seeds, options);
        assert_eq!(rows.iter().skip(1).filter(|row| row.phase == Phase::Boundary).count(), limit as usize);
        assert_eq!(pieces::disconnected_clusters(&surface, 100, &clustering.labels), 0);
    }
}

#[test]
fn a_cancelled_run_stops() {
    let mesh = tesserae_mesh::dev::sample::generate(tesserae_mesh::dev::sample::Sample::Knot, 2500).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let seeds = seeds(&surface, 100, &Seeds::Random, 3);
    let mut device = CpuDevice::new();
    let mut steps = device.open(&surface, &seeds.component_of_cluster).expect("the cpu takes everything");
    let cancel = Cancel::default();
    let mut rows = 0;
    let start = seeds.labels(surface.faces());
    let mut on_row = |_| {
        rows += 1;
        if rows == 3 {
            cancel.cancel();
        }
    };
    let mut record = Record::default();
    let ended =
        cluster::flat::boundary_based(&surface, &start, CONNECTED, steps.as_mut(), &cancel, &mut on_row, &mut record);
    assert_eq!(ended.map(|_| ()).map_err(|error| error.kind), Err(tesserae_mesh::Kind::Cancelled));
    assert_eq!(rows, 3);
}
