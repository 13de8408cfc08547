//! Tests of relocation, on surfaces with some heavy faces among light ones.

use std::collections::BTreeSet;

use super::split::Split;
use super::*;
use crate::cluster::seeds;
use crate::dev::sample::Sample;
use crate::device::cpu::CpuDevice;
use crate::device::pieces::disconnected_clusters;
use crate::device::plain::{self, PlainDevice};
use crate::surface::tests::of_sample;
use crate::surface::{Component, Surface};

/// One face in five weighs a million times as much as the others, in units that differ by component.
pub(in crate::cluster) fn uneven(sample: Sample, faces: u64) -> Surface {
    let mut surface = of_sample(sample, faces);
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
pub(in crate::cluster) fn start(surface: &Surface, clusters: u64) -> Vec<u32> {
    let shares = seeds::shares(surface, clusters).expect("that many are possible");
    plain::grow(surface, &seeds::stratified(surface, &shares, 1).labels(surface.faces()))
}

/// What the clusters of some labels explain, summed up anew.
fn explained(graph: &DualGraph, labels: &[u32]) -> i128 {
    Clusters::new(graph, labels.to_vec()).energy().explained
}

/// Labels after a relocation, and the kind of each change and what it explained.
fn relocated(
    surface: &Surface,
    labels: Vec<u32>,
    quality: Quality,
    device: &mut dyn Device,
) -> (Vec<u32>, Vec<(Phase, i128)>) {
    let mut changes = Vec::new();
    let clusters = labels.iter().max().map_or(0, |&last| u64::from(last) + 1);
    let cheaper = std::iter::once_with(|| Ok(start(surface, clusters)));
    let relocation = Relocation { graph: surface, quality, pairs: Pairs::CheaperHalf, cancel: &Cancel::default() };
    let labels = relocation.labels(labels.clone(), device, || Ok(labels), cheaper, &mut |phase, energy, _, labels| {
        assert_eq!(energy.explained, explained(surface, labels), "{phase:?}: sums follow every change");
        changes.push((phase, energy.explained));
    });
    (labels.expect("no cancellation").0, changes)
}

#[test]
fn relocation_lowers_f_and_keeps_the_number_of_clusters_and_their_connection_on_all_devices() {
    for (sample, faces, clusters) in [
        (Sample::Parts, 1200, 80),
        (Sample::Parts, 400, 50),
        (Sample::Sphere, 1100, 60),
        (Sample::Strip, 64, 20),
        (Sample::Plane, 200, 5),
    ] {
        let surface = uneven(sample, faces);
        let before = start(&surface, clusters);
        let counts = |labels: &[u32]| {
            let of = |component: &Component| labels[component.range()].iter().collect::<BTreeSet<_>>().len();
            surface.components.iter().map(of).collect::<Vec<_>>()
        };
        let mut last = i128::MIN;
        for quality in [Quality::Fast, Quality::Default, Quality::Best] {
            let (labels, changes) = relocated(&surface, before.clone(), quality, &mut CpuDevice::new());
            let energies: Vec<i128> =
                std::iter::once(explained(&surface, &before)).chain(changes.iter().map(|change| change.1)).collect();
            assert!(energies.is_sorted(), "{quality:?} {changes:?}");
            assert!(energies.len() > 1, "{}: nothing to test", sample.name());
            assert_eq!(explained(&surface, &labels), energies[energies.len() - 1]);
            assert_eq!(counts(&labels).iter().sum::<usize>(), clusters as usize, "{quality:?}");
            assert_eq!(disconnected_clusters(&surface, clusters as usize, &labels), 0);
            assert!(energies[energies.len() - 1] >= last, "{quality:?} does no worse than a lower quality");
            last = energies[energies.len() - 1];
            if quality == Quality::Fast {
                assert!(changes.iter().all(|&(phase, _)| phase == Phase::Swap), "{changes:?}");
                assert_eq!(counts(&before) != counts(&labels), sample == Sample::Parts, "swaps cross components");
            }
            if faces == 400 {
                let is_start = |phase| matches!(phase, Phase::MergedStart | Phase::FastStart | Phase::SettledStart);
                let has_start = changes.iter().any(|&(phase, _)| is_start(phase));
                assert!(has_start || quality != Quality::Best, "{changes:?}");
                let plain = relocated(&surface, before.clone(), quality, &mut PlainDevice::default());
                assert_eq!((labels, changes), plain);
            }
        }
    }
}

#[test]
fn bounds_show_that_no_swap_pays_on_an_even_sphere_and_do_not_where_one_pays() {
    let even = of_sample(Sample::Icosphere, 5120);
    let (settled, _) = relocated(&even, start(&even, 80), Quality::Fast, &mut CpuDevice::new());
    assert!(!swap::may_pay(&even, &settled, 80));
    let uneven = uneven(Sample::Parts, 3000);
    let labels = start(&uneven, 60);
    assert!(!relocated(&uneven, labels.clone(), Quality::Fast, &mut CpuDevice::new()).1.is_empty(), "swaps pay");
    assert!(swap::may_pay(&uneven, &labels, 60));
}

#[test]
fn a_split_gains_and_a_merge_costs_what_it_says() {
    let surface = uneven(Sample::Parts, 500);
    let mut clusters = Clusters::new(&surface, start(&surface, 30));
    let mut gained = 0;
    for cluster in clusters.numbers() {
        let mut faces = clusters.faces(cluster).to_vec();
        faces.sort_unstable();
        let Some(split) = Split::of(&surface, &faces, clusters.totals(cluster).shift) else {
            assert_eq!(faces.len(), 1);
            continue;
        };
        assert!(split.gain >= 0 && split.gain <= clusters.totals(cluster).energy());
        assert!(!split.leaving.is_empty() && !split.leaving.contains(&faces[0]));
        let before = clusters.energy().explained;
        clusters.split(&split.leaving);
        assert_eq!(clusters.energy().explained - before, split.gain);
        gained += split.gain;
    }
    assert!(gained > 0);
    assert_eq!(disconnected_clusters(&surface, clusters.numbers().len(), clusters.labels()), 0);
    let split = clusters.count();
    for cluster in clusters.numbers() {
        if let Some(&other) = clusters.beside(cluster).first() {
            let before = clusters.energy().explained;
            let cost = clusters.totals(cluster).merge_cost(clusters.totals(other));
            assert!(cost >= 0);
            clusters.merge(cluster, other);
            assert_eq!(before - clusters.energy().explained, cost);
        }
    }
    assert_eq!(clusters.energy().explained, explained(&surface, clusters.labels()));
    assert!(clusters.count() >= surface.components.len() && clusters.count() <= split / 2);
}

#[test]
fn every_number_of_clusters_can_be_made() {
    let surface = uneven(Sample::Parts, 250);
    let (fewest, most) = (surface.components.len(), surface.faces());
    for wanted in [fewest, fewest + 1, most / 3, most - 1, most] {
        let mut offers = Offers::new(&surface, start(&surface, 20));
        assert_eq!(resize(&mut offers, wanted, &Cancel::default()), Ok(true), "{wanted}");
        assert_eq!(offers.clusters.count(), wanted);
        assert_eq!(disconnected_clusters(&surface, wanted, &numbers::compact(offers.clusters.labels())), 0);
    }
}

#[test]
fn effective_faces_are_all_where_they_are_equal_and_the_heavy_ones_else() {
    let mut surface = of_sample(Sample::Cube, 300);
    surface.items.graph.weights.fill(5);
    assert_eq!(effective_faces(&surface), surface.faces());
    surface.items.graph.weights.iter_mut().for_each(|weight| *weight = 1);
    surface.items.graph.weights[..30].fill(1 << 20);
    assert_eq!(effective_faces(&surface), 30);
}
