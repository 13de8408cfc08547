//! The steps of the gpu device, one by one, against the plain version of their definition.

use crate::common::gpu::{cluster_counts, device, numbers, seeds, tuned};
use crate::common::zoo;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::gpu::{GpuDevice, Tuning};
use tesserae_mesh::device::pieces;
use tesserae_mesh::device::plain;
use tesserae_mesh::device::{Cancel, Device, Ending, FREE, Step};
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::{Rows, Surface};

fn surface(sample: Sample, faces: u64) -> Surface {
    Surface::build(&generate(sample, faces).expect("a sample")).expect("a surface")
}

#[test]
fn every_step_is_the_one_that_the_definition_says() {
    // an iteration as one dispatch, and as several
    let tunings = [Tuning::default().chain_items, 0].map(|chain_items| Tuning { chain_items, ..Tuning::default() });
    let mut gpus = tunings.map(tuned);
    for (at, (name, mesh)) in zoo::all().into_iter().enumerate() {
        let surface = Surface::build(&mesh).expect("the zoo can be put on the lattice");
        for (turn, clusters) in cluster_counts(&surface).into_iter().enumerate() {
            for gpu in zoo::in_turn(at + turn, &[0, 1]) {
                check_every_step(&mut gpus[gpu], &format!("{name} k={clusters}"), &surface, clusters);
            }
        }
    }
}

fn check_every_step(gpu: &mut GpuDevice, context: &str, surface: &Surface, clusters: u64) {
    let seeds = seeds(surface, clusters, &Seeds::Random, 5);
    let components = &seeds.component_of_cluster;
    let mut labels = vec![FREE; surface.faces()];
    for (cluster, &face) in (0..).zip(&seeds.face_of_cluster) {
        labels[face as usize] = cluster;
    }
    let mut steps = gpu.open(surface, components).expect("it fits");
    steps.set_labels(&labels).expect("set");
    steps.grow(&Cancel::default()).expect("grow");
    let mut labels = plain::grow(surface, &labels);
    assert_eq!(steps.labels().expect("labels"), labels, "{context}: growth");
    let energy = steps.energy().expect("energy").explained;
    assert_eq!(energy, plain::explained(surface, components, &labels), "{context}");

    let mut found: Vec<Step> = Vec::new();
    let ending = steps.optimise_boundary(u32::MAX, &Cancel::default(), &mut |step| found.push(step)).expect("optimise");
    assert_eq!(ending, Ending::Converged, "{context}");
    for (at, step) in (1..).zip(&found) {
        let state = plain::iterate(surface, components, &labels, at)
            .unwrap_or_else(|| panic!("{context}: only {at} iterations"));
        assert_eq!((step.moves, step.energy.explained), (state.moves, state.explained), "{context}: iteration {at}");
        labels = state.labels;
    }
    assert_eq!(plain::iterate(surface, components, &labels, 1), None, "{context}");
    assert_eq!(steps.labels().expect("labels"), labels, "{context}");
    let energy = steps.energy().expect("energy").explained;
    assert_eq!(energy, plain::explained(surface, components, &labels), "{context}");
}

#[test]
fn the_limit_of_iterations_is_exact_and_work_can_go_on_after_it() {
    let surface = surface(Sample::Knot, 2500);
    let seeds = seeds(&surface, 40, &Seeds::Random, 1);
    let mut gpu = device();
    let mut steps = gpu.open(&surface, &seeds.component_of_cluster).expect("it fits");
    let mut labels = vec![FREE; surface.faces()];
    for (cluster, &face) in (0..).zip(&seeds.face_of_cluster) {
        labels[face as usize] = cluster;
    }
    steps.set_labels(&labels).expect("set");
    steps.grow(&Cancel::default()).expect("grow");
    let mut labels = steps.labels().expect("labels");
    for limit in [0, 1, 8, 2, 9] {
        let mut count = 0;
        let ending = steps.optimise_boundary(limit, &Cancel::default(), &mut |_| count += 1).expect("optimise");
        assert_eq!((ending, count), (Ending::IterationLimit, limit));
        for number in 1..=limit {
            labels = plain::iterate(&surface, &seeds.component_of_cluster, &labels, number)
                .expect("it takes more iterations than that")
                .labels;
        }
        assert_eq!(steps.labels().expect("labels"), labels, "after {limit} more");
    }
}

#[test]
fn energies_are_exact_at_the_ends_of_the_lattice() {
    // two faces out of three at opposite corners, weights that sum to nearly 2³⁴, and the largest shift
    let mut surface = surface(Sample::Torus, 700);
    let mut next = numbers(3);
    let far = (1 << 27) - 1;
    for face in 0..surface.faces() {
        let sign = |bit: u64| if bit == 0 { -far } else { far };
        surface.items.graph.points[face] = std::array::from_fn(|_| sign(next(2)));
        surface.items.graph.weights[face] = ((1u64 << 34) / surface.faces() as u64 - 1) as u32 - next(5) as u32;
    }
    surface.items.graph.components[0].energy_shift = 30;
    let mut gpu = device();
    for clusters in [1, 2, 255, 256, 257, 600] {
        let components = vec![0; clusters];
        let mut steps = gpu.open(&surface, &components).expect("it fits");
        let labels: Vec<u32> = (0..surface.faces()).map(|_| next(clusters as u64) as u32).collect();
        steps.set_labels(&labels).expect("set");
        let energy = steps.energy().expect("energy").explained;
        assert_eq!(energy, plain::explained(&surface, &components, &labels));
    }
    // all in one corner: the largest magnitude there is
    for corner in [far, -far] {
        surface.items.graph.points.fill([corner; 3]);
        let mut steps = gpu.open(&surface, &[0]).expect("it fits");
        let labels = vec![0; surface.faces()];
        steps.set_labels(&labels).expect("set");
        let energy = steps.energy().expect("energy").explained;
        assert_eq!(energy, plain::explained(&surface, &[0], &labels));
        assert!(energy > 1 << 119, "{energy}");
    }
}

#[test]
fn weights_of_all_32_bits_count_in_full() {
    // a few faces, each as heavy as a face can be
    let mut surface = surface(Sample::Strip, 4);
    let mut gpu = device();
    for weight in [u32::MAX, 1 << 31, (1 << 31) - 1] {
        surface.items.graph.weights.fill(weight);
        for (face, centroid) in surface.items.graph.points.iter_mut().enumerate() {
            *centroid = [(1 << 27) - 1, -(1 << 26), face as i32 * 1000];
        }
        let mut steps = gpu.open(&surface, &[0, 0]).expect("it fits");
        let labels = [0, 0, 1, 1];
        steps.set_labels(&labels).expect("set");
        let energy = steps.energy().expect("energy").explained;
        assert_eq!(energy, plain::explained(&surface, &[0, 0], &labels), "{weight}");
    }
}

#[test]
fn faces_that_no_cluster_reaches_stay_free() {
    let mesh = generate(Sample::Parts, 2500).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    let mut labels = vec![FREE; surface.faces()];
    labels[17] = 0;
    let mut gpu = device();
    let mut steps = gpu.open(&surface, &[0]).expect("it fits");
    assert_eq!(steps.labels().expect("labels"), vec![FREE; surface.faces()]);
    steps.set_labels(&labels).expect("set");
    steps.grow(&Cancel::default()).expect("grow");
    let grown = steps.labels().expect("labels");
    assert_eq!(grown, plain::grow(&surface, &labels));
    assert!(grown.contains(&FREE) && grown.iter().filter(|&&label| label == 0).count() > 1);
}

/// Labels in patches of all sizes, so that clusters are in many pieces, many of them equally large.
fn patches(surface: &Surface, clusters: u64, next: &mut impl FnMut(u64) -> u64) -> Vec<u32> {
    let mut labels = vec![FREE; surface.faces()];
    for start in 0..surface.faces() as u32 {
        let cluster = next(clusters) as u32;
        let mut patch = vec![start];
        for _ in 0..next(30) {
            let near = surface.neighbours_of(patch[next(patch.len() as u64) as usize]);
            patch.extend(near.get(next(3) as usize));
        }
        patch.iter().for_each(|&face| labels[face as usize] = cluster);
    }
    labels
}

#[test]
fn pieces_are_cut_off_and_grown_over_as_a_walk_finds_them() {
    let mut gpu = device();
    let mut next = numbers(21);
    let mut found = 0;
    for (sample, faces) in [(Sample::Knot, 2500), (Sample::Quads, 3000), (Sample::Strip, 700)] {
        let surface = surface(sample, faces);
        for clusters in [1, 2, 7, 300] {
            let context = format!("{} k={clusters}", sample.name());
            let components = vec![0; clusters];
            let mut cpu = CpuDevice::new();
            let mut steps = gpu.open(&surface, &components).expect("it fits");
            let mut on_cpu = cpu.open(&surface, &components).expect("it fits");
            // twice: what is known of the pieces of earlier labels is forgotten
            for _ in 0..2 {
                let mut labels = patches(&surface, clusters as u64, &mut next);
                let cut_off = pieces::cut_off_faces(&surface, clusters, &labels);
                for steps in [&mut steps, &mut on_cpu] {
                    steps.set_labels(&labels).expect("set");
                    assert_eq!(steps.repair(&Cancel::default()).expect("a repair"), cut_off.len() as u64, "{context}");
                }
                cut_off.iter().for_each(|&face| labels[face as usize] = FREE);
                let labels = plain::grow(&surface, &labels);
                assert_eq!(steps.labels().expect("labels"), labels, "{context}");
                assert_eq!(on_cpu.labels().expect("labels"), labels, "{context}");
                let energy = steps.energy().expect("energy").explained;
                assert_eq!(energy, plain::explained(&surface, &components, &labels), "{context}");
                assert_eq!(steps.repair(&Cancel::default()).expect("a repair"), 0, "{context}: all are whole");
                found += cut_off.len();
            }
        }
    }
    assert!(found > 5000, "{found}");
}

#[test]
fn pieces_that_moves_cut_off_are_found() {
    let surface = surface(Sample::Knot, 2500);
    let components = vec![0; 60];
    let mut next = numbers(5);
    let mut gpu = device();
    let mut steps = gpu.open(&surface, &components).expect("it fits");
    steps.set_labels(&patches(&surface, 60, &mut next)).expect("set");
    let mut found = [0; 2];
    for _ in 0..6 {
        steps.repair(&Cancel::default()).expect("a repair");
        assert_eq!(steps.repair(&Cancel::default()).expect("a repair"), 0, "all are whole");
        for (refines, found) in found.iter_mut().enumerate() {
            if refines == 1 {
                steps.refine(1, &Cancel::default(), &mut |_| {}).expect("refine");
            } else {
                steps.optimise_boundary(1, &Cancel::default(), &mut |_| {}).expect("optimise");
            }
            let mut labels = steps.labels().expect("labels");
            let cut_off = pieces::cut_off_faces(&surface, 60, &labels);
            assert_eq!(steps.repair(&Cancel::default()).expect("a repair"), cut_off.len() as u64);
            cut_off.iter().for_each(|&face| labels[face as usize] = FREE);
            assert_eq!(steps.labels().expect("labels"), plain::grow(&surface, &labels));
            *found += cut_off.len();
        }
    }
    assert!(found.iter().all(|&found| found > 0), "{found:?}");
}

#[test]
fn impossible_labels_are_refused() {
    let surface = surface(Sample::Cube, 48);
    let mut gpu = device();
    assert!(gpu.open(&surface, &[]).is_err());
    assert!(gpu.open(&surface, &[9]).is_err());
    let mut steps = gpu.open(&surface, &[0, 0]).expect("it fits");
    assert!(steps.set_labels(&[0]).is_err());
    assert!(steps.set_labels(&vec![2; surface.faces()]).is_err());
    assert!(steps.set_labels(&vec![1; surface.faces()]).is_ok());
}

#[test]
fn a_changed_label_or_weight_shows_in_the_comparison() {
    let mut surface = surface(Sample::Knot, 2500);
    let components = vec![0; 10];
    let mut next = numbers(8);
    let labels: Vec<u32> = (0..surface.faces()).map(|_| next(10) as u32).collect();
    let mut gpu = device();
    let energy = {
        let mut steps = gpu.open(&surface, &components).expect("it fits");
        steps.set_labels(&labels).expect("set");
        steps.energy().expect("energy").explained
    };
    let mut other = labels.clone();
    other[100] = (other[100] + 1) % 10;
    assert_ne!(energy, plain::explained(&surface, &components, &other));
    surface.items.graph.weights[100] += 1;
    assert_ne!(energy, plain::explained(&surface, &components, &labels));
}

#[test]
fn of_two_equally_near_clusters_the_smaller_number_wins() {
    // a row of four faces; the second lies halfway between the first and the third, and far from its own cluster's
    // proxy
    let mut surface = surface(Sample::Strip, 4);
    surface.items.graph.points = vec![[-10, 0, 0], [0, 0, 0], [10, 0, 0], [0, 1000, 0]];
    surface.items.graph.weights = vec![5; 4];
    surface.items.graph.neighbours = Rows { offsets: vec![0, 1, 3, 5, 6], items: vec![1, 0, 2, 1, 3, 2] };
    let components = [0, 0, 0];
    let mut gpu = device();
    for (labels, expected) in [([1, 0, 2, 0], [1, 1, 2, 0]), ([2, 0, 1, 0], [2, 1, 1, 0])] {
        let mut steps = gpu.open(&surface, &components).expect("it fits");
        steps.set_labels(&labels).expect("set");
        steps.optimise_boundary(1, &Cancel::default(), &mut |_| {}).expect("optimise");
        assert_eq!(steps.labels().expect("labels"), expected);
        let state = plain::iterate(&surface, &components, &labels, 1).expect("it moves");
        assert_eq!(state.labels, expected);
    }
}
