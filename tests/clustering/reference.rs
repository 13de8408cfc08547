//! The references, ACVD and variational clustering, against brute force and against what their definitions say.

use crate::common::zoo;
use tesserae_mesh::cluster::flat::{Clustering, Options};
use tesserae_mesh::cluster::record::Record;
use tesserae_mesh::cluster::reference::acvd::acvd;
use tesserae_mesh::cluster::reference::variational::variational;
use tesserae_mesh::cluster::run::Row;
use tesserae_mesh::cluster::{seeds, seeds::SeedFaces};
use tesserae_mesh::dev::sample::hard::cone;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::pieces;
use tesserae_mesh::device::plain;
use tesserae_mesh::device::{Cancel, Device, Ending, FLOOD_FROM, FREE, MergeSteps, Steps};
use tesserae_mesh::job::{self, Request};
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::{Algorithm, Parameters, Seeds};
use tesserae_mesh::report::{DeviceInfo, DeviceKind};
use tesserae_mesh::surface::{Component, DualGraph, Surface};
use tesserae_mesh::{Error, Kind};

const FREELY: Options = Options { max_iterations: None, refine: false, allow_disconnected: true };
const CONNECTED: Options = Options { allow_disconnected: false, ..FREELY };

/// Surfaces with seeds: everything in the zoo, in several numbers of clusters.
fn cases() -> impl Iterator<Item = (String, Surface, SeedFaces)> {
    zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() < 1000).flat_map(|(name, mesh)| {
        let number = |k: u64, surface: &Surface| k.clamp(surface.components.len() as u64, surface.faces() as u64);
        [1, 9, 90, u64::MAX].into_iter().map(move |k| {
            let surface = Surface::build(&mesh).expect("the zoo can be put on the lattice");
            let k = number(k, &surface);
            let seeds = seeds::choose(&surface, k, &Seeds::Random, 4, None).expect("the number is possible");
            (format!("{name} k={k}"), surface, seeds)
        })
    })
}

fn run_acvd(surface: &Surface, seeds: &SeedFaces, options: Options) -> (Clustering, Vec<Row>) {
    let mut device = CpuDevice::new();
    let mut steps = device.open(surface, &seeds.component_of_cluster).expect("the cpu takes everything");
    let mut rows = Vec::new();
    let cancel = Cancel::default();
    let clustering =
        acvd(surface, seeds, options, steps.as_mut(), &cancel, &mut |row| rows.push(row), &mut Record::default())
            .expect("nobody cancels");
    (clustering, rows)
}

fn run_vc(surface: &Surface, seeds: &SeedFaces, options: Options) -> (Clustering, Vec<Row>) {
    let mut rows = Vec::new();
    let clustering =
        variational(surface, seeds, options, &Cancel::default(), &mut |row| rows.push(row), &mut Record::default())
            .expect("nobody cancels");
    (clustering, rows)
}

#[test]
fn a_larger_cone_takes_acvd_no_more_passes() {
    for triangles in [8000, 16_000] {
        let surface = Surface::build(&cone(triangles)).expect("a surface");
        let seeds = seeds::choose(&surface, 3, &Seeds::Random, 4, None).expect("the number is possible");
        let (clustering, rows) = run_acvd(&surface, &seeds, CONNECTED);
        check_rows("cone", &surface, &seeds, &clustering, &rows);
        assert!((FLOOD_FROM as usize..350).contains(&rows.len()), "{triangles} triangles: {} rows", rows.len());
    }
}

/// F falls with every row, except where pieces were repaired, and the last row's is that of the labels.
fn check_rows(name: &str, surface: &Surface, seeds: &SeedFaces, clustering: &Clustering, rows: &[Row]) {
    for pair in rows.windows(2) {
        assert_eq!(pair[1].iteration, pair[0].iteration + 1, "{name}");
        let is_repair = pair[1].phase == tesserae_mesh::report::Phase::Repair;
        assert!(is_repair || pair[1].energy > pair[0].energy, "{name}: F falls in {pair:?}");
    }
    let explained = plain::explained(surface, &seeds.component_of_cluster, &clustering.labels);
    assert_eq!(rows.last().map(|row| row.energy.explained), Some(explained), "{name}");
    let mut faces = vec![0; seeds.face_of_cluster.len()];
    clustering.labels.iter().for_each(|&label| faces[label as usize] += 1);
    assert!(faces.iter().all(|&faces| faces > 0), "{name}: an empty cluster");
}

/// Whether some single face can go to a cluster beside it and lower F.
fn can_be_improved(surface: &Surface, components: &[u32], labels: &[u32]) -> bool {
    let before = plain::explained(surface, components, labels);
    let mut labels = labels.to_vec();
    (0..labels.len()).any(|face| {
        let own = labels[face];
        let is_alone = labels.iter().filter(|&&label| label == own).count() == 1;
        !is_alone
            && surface.neighbours_of(face as u32).iter().any(|&near| {
                let to = labels[near as usize];
                labels[face] = to;
                let lower = plain::explained(surface, components, &labels) > before;
                labels[face] = own;
                lower
            })
    })
}

#[test]
fn acvd_ends_where_no_face_can_go_across_a_boundary_and_lower_the_energy() {
    let mut moved = 0;
    for (name, surface, seeds) in cases() {
        let (clustering, rows) = run_acvd(&surface, &seeds, FREELY);
        check_rows(&name, &surface, &seeds, &clustering, &rows);
        assert_eq!(clustering.ending, Ending::Converged);
        assert!(!can_be_improved(&surface, &seeds.component_of_cluster, &clustering.labels), "{name}");
        moved += usize::from(can_be_improved(&surface, &seeds.component_of_cluster, &clustering.initial));
    }
    assert!(moved > 10, "hardly anything had to move: {moved}");
}

#[test]
fn clusters_of_the_references_are_connected() {
    for (name, surface, seeds) in cases() {
        let k = seeds.face_of_cluster.len();
        for (clustering, rows) in [run_acvd(&surface, &seeds, CONNECTED), run_vc(&surface, &seeds, CONNECTED)] {
            check_rows(&name, &surface, &seeds, &clustering, &rows);
            assert_eq!(pieces::disconnected_clusters(&surface, k, &clustering.labels), 0, "{name}");
        }
    }
}

/// Flooding as its definition says it: of all pairs there are, the smallest.
fn flood(surface: &Surface, proxies: &[[i128; 3]], seeds: &[u32]) -> Vec<u32> {
    let mut labels = vec![FREE; surface.faces()];
    seeds.iter().enumerate().for_each(|(cluster, &face)| labels[face as usize] = cluster as u32);
    loop {
        let energy = |face: usize, cluster: u32| {
            let square =
                |axis: usize| (i128::from(surface.points[face][axis]) - proxies[cluster as usize][axis]).pow(2);
            i128::from(surface.weights[face]) * (square(0) + square(1) + square(2))
        };
        let free = (0..labels.len()).filter(|&face| labels[face] == FREE);
        let pairs = free.flat_map(|face| {
            let near = surface.neighbours_of(face as u32).iter().map(|&near| labels[near as usize]);
            near.filter(|&cluster| cluster != FREE).map(move |cluster| (energy(face, cluster), face, cluster))
        });
        let Some((_, face, cluster)) = pairs.min() else { return labels };
        labels[face] = cluster;
    }
}

#[test]
fn every_variational_iteration_is_the_one_that_the_definition_says() {
    let mut iterations = 0;
    for (name, surface, seeds) in cases() {
        let (clustering, rows) = run_vc(&surface, &seeds, FREELY);
        let components = &seeds.component_of_cluster;
        let at_seeds: Vec<[i128; 3]> =
            seeds.face_of_cluster.iter().map(|&face| surface.points[face as usize].map(i128::from)).collect();
        let mut labels = flood(&surface, &at_seeds, &seeds.face_of_cluster);
        assert_eq!(clustering.initial, labels, "{name}");
        for row in &rows {
            assert_eq!(row.energy.explained, plain::explained(&surface, components, &labels), "{name} {row:?}");
            let sums = plain::sums(&surface, components.len(), &labels);
            let proxies: Vec<[i128; 3]> = sums.iter().map(|sums| sums.proxy()).collect();
            let distance = |face: usize| -> i128 {
                let proxy = proxies[labels[face] as usize];
                (0..3).map(|axis| (i128::from(surface.points[face][axis]) - proxy[axis]).pow(2)).sum()
            };
            let central = |cluster: u32| {
                (0..labels.len()).filter(|&f| labels[f] == cluster).min_by_key(|&f| (distance(f), f)).expect("a face")
            };
            let seeds: Vec<u32> = (0..components.len() as u32).map(|cluster| central(cluster) as u32).collect();
            let next = flood(&surface, &proxies, &seeds);
            if row.iteration == rows[rows.len() - 1].iteration {
                let before = plain::explained(&surface, components, &labels);
                assert!(plain::explained(&surface, components, &next) <= before, "{name}: it ends too early");
                assert_eq!(clustering.labels, labels, "{name}");
            }
            labels = next;
            iterations += 1;
        }
    }
    assert!(iterations > 100, "hardly anything was compared: {iterations} iterations");
}

/// The highest explained energy of all labellings with each cluster in its component, none empty, all connected.
fn optimum(surface: &Surface, components: &[u32]) -> i128 {
    let clusters = components.len();
    let labellings = clusters.pow(surface.faces() as u32);
    let labelling = |number: usize| -> Vec<u32> {
        (0..surface.faces()).map(|face| (number / clusters.pow(face as u32) % clusters) as u32).collect()
    };
    let in_its_component = |labels: &[u32]| {
        let within = |(number, component): (usize, &Component)| {
            component.range().all(|face| components[labels[face] as usize] == number as u32)
        };
        surface.components.iter().enumerate().all(within)
    };
    let is_allowed = |labels: &Vec<u32>| {
        in_its_component(labels)
            && (0..clusters as u32).all(|cluster| labels.contains(&cluster))
            && pieces::disconnected_clusters(surface, clusters, labels) == 0
    };
    let explained = |labels: Vec<u32>| plain::explained(surface, components, &labels);
    (0..labellings).map(labelling).filter(is_allowed).map(explained).max().expect("there is one")
}

#[test]
fn on_small_meshes_the_best_of_some_runs_is_the_best_there_is() {
    let small = [
        (generate(Sample::Cube, 12).expect("a sample"), 3),
        (generate(Sample::Sphere, 8).expect("a sample"), 3),
        (generate(Sample::Strip, 10).expect("a sample"), 2),
        (zoo::tangle(9, 9, 3), 3),
    ];
    for (mesh, clusters) in small {
        let surface = Surface::build(&mesh).expect("a surface");
        let clusters = clusters.max(surface.components.len() as u64);
        let mut best = [i128::MIN; 2];
        let mut highest = i128::MIN;
        for seed in 0..30 {
            let seeds = seeds::choose(&surface, clusters, &Seeds::Random, seed, None).expect("the number is possible");
            if seed == 0 {
                highest = optimum(&surface, &seeds.component_of_cluster);
            }
            let runs = [run_acvd(&surface, &seeds, CONNECTED), run_vc(&surface, &seeds, CONNECTED)];
            for (best, (clustering, _)) in best.iter_mut().zip(runs) {
                let explained = plain::explained(&surface, &seeds.component_of_cluster, &clustering.labels);
                assert!(explained <= highest, "better than the best of {} faces", surface.faces());
                *best = explained.max(*best);
            }
        }
        assert_eq!(best[0], highest, "acvd, {} faces", surface.faces());
        println!("{} faces: vc finds the best: {}", surface.faces(), best[1] == highest);
    }
}

#[test]
fn a_limit_on_iterations_is_kept() {
    let surface = Surface::build(&generate(Sample::Knot, 2500).expect("a sample")).expect("a surface");
    let seeds = seeds::choose(&surface, 60, &Seeds::Random, 1, None).expect("the number is possible");
    for limit in [0, 1, 3] {
        let options = Options { max_iterations: Some(limit), ..FREELY };
        for (clustering, rows) in [run_acvd(&surface, &seeds, options), run_vc(&surface, &seeds, options)] {
            assert_eq!(rows.len(), limit as usize + 1);
            assert_eq!(clustering.ending, Ending::IterationLimit);
        }
    }
}

/// A gpu that must not be opened.
#[derive(Debug)]
struct Untouched(DeviceInfo);

impl Device for Untouched {
    fn info(&self) -> &DeviceInfo {
        &self.0
    }

    fn open<'a>(&'a mut self, _: &'a DualGraph, _: &'a [u32]) -> tesserae_mesh::Result<Box<dyn Steps + 'a>> {
        Err(Error::new(Kind::Internal, "opened"))
    }

    fn open_merging<'a>(
        &'a mut self,
        _: &'a DualGraph,
        _: &'a [u32],
    ) -> tesserae_mesh::Result<Box<dyn MergeSteps + 'a>> {
        Err(Error::new(Kind::Internal, "opened"))
    }
}

#[test]
fn a_gpu_does_not_run_references_and_says_so() {
    for algorithm in [Algorithm::Acvd, Algorithm::Vc, Algorithm::Bb] {
        let parameters = Parameters { algorithm, clusters: Some(2), ..Parameters::default() };
        let prepared = job::prepare(&Request::new(
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n",
            Format::Obj,
            &parameters,
        ))
        .expect("a mesh");
        let info = CpuDevice::new().info().clone();
        let mut gpu = Untouched(DeviceInfo { kind: DeviceKind::Gpu, ..info });
        let error = job::run(&prepared, &mut gpu, &Cancel::default(), &mut |_| {}).expect_err("no device");
        match algorithm {
            Algorithm::Bb => assert_eq!(error.message, "opened"),
            _ => {
                assert_eq!(error.kind, Kind::DeviceUnsuitable);
                assert!(error.message.contains("cpu") && error.message.contains(algorithm.name()), "{error}");
            }
        }
    }
}
