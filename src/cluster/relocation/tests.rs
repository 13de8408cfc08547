//! Tests of relocation, on surfaces with some heavy faces among light ones.

use super::connection::Connection;
use super::split::Split;
use super::*;
use crate::cluster::merging::Pairs;
use crate::cluster::seeds;
use crate::dev::sample::{Sample, generate};
use crate::device::cpu::CpuDevice;
use crate::device::pieces::{cut_off_faces, disconnected_clusters};
use crate::device::plain::PlainDevice;
use crate::surface::{Component, Surface};

/// One face in five weighs a million times as much as the others, in units that differ by component.
fn uneven(sample: Sample, faces: u64) -> Surface {
    let mut surface = Surface::build(&generate(sample, faces).expect("a mesh")).expect("a surface");
    let graph = &mut surface.items.graph;
    for (number, component) in graph.components.iter_mut().enumerate() {
        component.energy_shift = number as u32 % 3;
        for face in component.range() {
            graph.weights[face] = if face * 7 % 5 == 0 { 1 << 20 } else { 1 };
        }
        component.weight = graph.weights[component.range()].iter().map(|&weight| u64::from(weight)).sum();
    }
    surface
}

/// Grown from seeds in shares by area, which is far from the best.
fn start(surface: &Surface, clusters: u64) -> Vec<u32> {
    let shares = seeds::shares(surface, clusters).expect("that many are possible");
    let seeds = seeds::stratified(surface, &shares, 1);
    let mut device = CpuDevice::new();
    let mut steps = device.open(surface, &seeds.component_of_cluster).expect("it opens");
    steps.set_labels(&seeds.labels(surface.faces())).expect("labels");
    steps.grow(&Cancel::default()).expect("no cancellation");
    steps.labels().expect("labels")
}

/// What the clusters of some labels explain, summed up anew.
fn explained(graph: &DualGraph, labels: &[u32]) -> i128 {
    Clusters::new(graph, labels.to_vec()).energy().explained
}

/// Labels after a relocation, and the kind of each change and what it explained.
fn relocated(
    surface: &Surface,
    labels: Vec<u32>,
    effort: Effort,
    device: &mut dyn Device,
) -> (Vec<u32>, Vec<(Phase, i128)>) {
    let mut changes = Vec::new();
    let clusters = labels.iter().max().map_or(0, |&last| u64::from(last) + 1);
    let mut cheaper = std::iter::once_with(|| Ok(start(surface, clusters)));
    let relocation = Relocation { graph: surface, effort, pairs: Pairs::CheaperHalf, cancel: &Cancel::default() };
    let labels =
        relocation.labels(labels.clone(), device, || Ok(labels), &mut cheaper, &mut |phase, energy, _, labels| {
            assert_eq!(energy.explained, explained(surface, labels), "{phase:?}: sums follow every change");
            changes.push((phase, energy.explained));
            Ok(())
        });
    (labels.expect("no cancellation").0, changes)
}

#[test]
fn relocation_lowers_f_and_keeps_the_number_of_clusters_and_their_connection() {
    for (sample, faces, clusters) in
        [(Sample::Parts, 1200, 80), (Sample::Sphere, 1100, 60), (Sample::Strip, 64, 20), (Sample::Plane, 200, 5)]
    {
        let surface = uneven(sample, faces);
        let before = start(&surface, clusters);
        let mut last = i128::MIN;
        for effort in [Effort::Swaps, Effort::Some, Effort::All] {
            let (labels, changes) = relocated(&surface, before.clone(), effort, &mut CpuDevice::new());
            let energies: Vec<i128> =
                std::iter::once(explained(&surface, &before)).chain(changes.iter().map(|change| change.1)).collect();
            assert!(energies.is_sorted(), "{effort:?} {changes:?}");
            assert!(energies.len() > 1, "{}: nothing to test", sample.name());
            assert_eq!(explained(&surface, &labels), energies[energies.len() - 1]);
            let mut sizes = vec![0; clusters as usize];
            labels.iter().for_each(|&label| sizes[label as usize] += 1);
            assert!(sizes.iter().all(|&size| size > 0), "{effort:?} {sizes:?}");
            assert_eq!(disconnected_clusters(&surface, clusters as usize, &labels), 0);
            assert!(energies[energies.len() - 1] >= last, "{effort:?} does no worse than less effort");
            last = energies[energies.len() - 1];
        }
    }
}

#[test]
fn relocation_does_not_depend_on_the_device() {
    let surface = uneven(Sample::Parts, 400);
    let before = start(&surface, 50);
    let cpu = relocated(&surface, before.clone(), Effort::All, &mut CpuDevice::new());
    let plain = relocated(&surface, before, Effort::All, &mut PlainDevice::default());
    assert_eq!(cpu, plain);
    let is_start = |phase| matches!(phase, Phase::MergedStart | Phase::FastStart | Phase::SettledStart);
    assert!(cpu.1.iter().any(|&(phase, _)| is_start(phase)), "{:?}", cpu.1);
}

#[test]
fn swaps_take_clusters_from_one_component_to_another() {
    let surface = uneven(Sample::Parts, 1200);
    let counts = |labels: &[u32]| {
        let of_component = |component: &Component| {
            let mut numbers = labels[component.range()].to_vec();
            numbers.sort_unstable();
            numbers.dedup();
            numbers.len()
        };
        surface.components.iter().map(of_component).collect::<Vec<_>>()
    };
    let before = start(&surface, 80);
    let (after, changes) = relocated(&surface, before.clone(), Effort::Swaps, &mut CpuDevice::new());
    assert!(changes.iter().all(|&(phase, _)| phase == Phase::Swap), "{changes:?}");
    assert_ne!(counts(&before), counts(&after));
    assert!(counts(&after).iter().all(|&count| count > 0));
}

#[test]
fn bounds_show_that_no_swap_pays_on_an_even_sphere_and_do_not_where_one_pays() {
    let even = Surface::build(&generate(Sample::Icosphere, 5120).expect("a mesh")).expect("a surface");
    let labels = start(&even, 80);
    let relocation =
        Relocation { graph: &even, effort: Effort::Swaps, pairs: Pairs::CheaperHalf, cancel: &Cancel::default() };
    let settled = relocation.labels(
        labels.clone(),
        &mut CpuDevice::new(),
        || Ok(labels),
        &mut std::iter::empty(),
        &mut |_, _, _, _| Ok(()),
    );
    assert!(!gate::may_pay(&even, &settled.expect("no cancellation").0, 80));
    let uneven = uneven(Sample::Parts, 3000);
    let labels = start(&uneven, 60);
    assert!(!relocated(&uneven, labels.clone(), Effort::Swaps, &mut CpuDevice::new()).1.is_empty(), "swaps pay");
    assert!(gate::may_pay(&uneven, &labels, 60));
}

#[test]
fn a_split_gains_what_it_says_and_leaves_two_connected_parts() {
    let surface = uneven(Sample::Parts, 500);
    let labels = start(&surface, 30);
    let mut clusters = Clusters::new(&surface, labels);
    let mut gained = 0;
    for cluster in 0..clusters.numbers() as u32 {
        let mut faces = clusters.faces(cluster).to_vec();
        faces.sort_unstable();
        let Some(split) = Split::of(&surface, &faces, clusters.shift(cluster)) else {
            assert_eq!(faces.len(), 1);
            continue;
        };
        assert!(split.gain >= 0 && split.gain <= clusters.energy_of(cluster));
        assert!(!split.leaving.is_empty() && !split.leaving.contains(&faces[0]));
        let before = clusters.energy().explained;
        clusters.split(cluster, &split.leaving);
        assert_eq!(clusters.energy().explained - before, split.gain);
        gained += split.gain;
    }
    assert!(gained > 0);
    assert_eq!(disconnected_clusters(&surface, clusters.numbers(), clusters.labels()), 0);
    assert_eq!(clusters.energy().explained, explained(&surface, clusters.labels()));
}

#[test]
fn a_merge_costs_what_it_says() {
    let surface = uneven(Sample::Parts, 500);
    let mut clusters = Clusters::new(&surface, start(&surface, 60));
    for cluster in 0..clusters.numbers() as u32 {
        if let Some(&other) = clusters.beside(cluster).first() {
            let (before, cost) = (clusters.energy().explained, clusters.merge_cost(cluster, other));
            assert!(cost >= 0);
            clusters.merge(cluster, other);
            assert_eq!(before - clusters.energy().explained, cost);
        }
    }
    assert_eq!(clusters.energy().explained, explained(&surface, clusters.labels()));
    assert!(clusters.count() >= surface.components.len() && clusters.count() <= 30);
}

#[test]
fn searches_find_the_faces_that_hold_a_cluster_together() {
    let mut held = 0;
    for sample in [Sample::Strip, Sample::Parts, Sample::Plane] {
        let surface = uneven(sample, 300);
        let labels = start(&surface, 20);
        let mut connection = Connection::new(surface.faces(), Moves::Free);
        for face in 0..surface.faces() as u32 {
            let label = labels[face as usize];
            if labels.iter().filter(|&&other| other == label).count() == 1 {
                continue;
            }
            let mut without = labels.clone();
            without[face as usize] = 20;
            let expected = cut_off_faces(&surface, 21, &without).is_empty();
            let found = connection.stays_without(&surface, face, |near| labels[near as usize] == label);
            assert_eq!(found, expected, "{} {face}", sample.name());
            held += u32::from(!expected);
        }
    }
    assert!(held > 0);
}

/// Faces in a ring: without one of them, the way between its neighbours is as long as the ring.
fn ring(faces: u32) -> DualGraph {
    DualGraph {
        points: vec![[0; 3]; faces as usize],
        weights: vec![1; faces as usize],
        neighbour_offsets: (0..=faces).map(|face| 2 * face).collect(),
        neighbours: (0..faces).flat_map(|face| [(face + 1) % faces, (face + faces - 1) % faces]).collect(),
        components: vec![Component { first_face: 0, faces, weight: u64::from(faces), energy_shift: 0 }],
        moves: Moves::Free,
    }
}

#[test]
fn after_many_steps_a_face_that_is_refused_is_held_until_a_face_beside_it_moves() {
    let ring = ring(100);
    let mut connection = Connection::new(100, Moves::Free);
    let has_gap = |near| near != 0;
    for _ in 0..1000 {
        assert!(!connection.stays_without(&ring, 50, has_gap), "0 is a gap, so that 50 holds two arcs together");
    }
    assert!(connection.is_bounded());
    assert!(connection.stays_without(&ring, 20, |_| true), "faces that were not refused since then are not held");
    assert!(!connection.stays_without(&ring, 50, has_gap));
    assert!(!connection.stays_without(&ring, 50, |_| true), "the gap is closed, far from 50");
    connection.moved(&ring, 0);
    assert!(!connection.stays_without(&ring, 50, |_| true));
    connection.moved(&ring, 49);
    assert!(connection.stays_without(&ring, 50, |_| true));
}

#[test]
fn searches_end_at_a_bound_in_proportion_to_the_faces() {
    let ring = ring(400);
    let mut connection = Connection::new(400, Moves::Free);
    let unite = (0..10_000).take_while(|_| connection.stays_without(&ring, 7, |_| true)).count();
    // a search looks at two dual edges a face
    assert!((500..=520).contains(&unite), "{unite}");
    connection.moved(&ring, 7);
    assert!(!connection.stays_without(&ring, 7, |_| true), "there are no more searches");
    assert!(connection.stays_without(&ring, 7, |near| near != 8), "short ways are seen");
}

#[test]
fn every_number_of_clusters_can_be_made() {
    let surface = uneven(Sample::Parts, 250);
    let (fewest, most) = (surface.components.len(), surface.faces());
    for wanted in [fewest, fewest + 1, most / 3, most - 1, most] {
        let mut clusters = Clusters::new(&surface, start(&surface, 20));
        let is_made = resize(&mut clusters, wanted, &mut Candidates::default(), &Cancel::default());
        assert!(is_made.expect("no cancellation"), "{wanted}");
        assert_eq!(clusters.count(), wanted);
        assert_eq!(disconnected_clusters(&surface, wanted, &clusters.compacted()), 0);
    }
}

#[test]
fn effective_faces_are_all_where_they_are_equal_and_the_heavy_ones_else() {
    let mut surface = Surface::build(&generate(Sample::Cube, 300).expect("a mesh")).expect("a surface");
    surface.items.graph.weights.fill(5);
    assert_eq!(effective_faces(&surface), surface.faces());
    surface.items.graph.weights.iter_mut().for_each(|weight| *weight = 1);
    surface.items.graph.weights[..30].fill(1 << 20);
    assert_eq!(effective_faces(&surface), 30);
}
