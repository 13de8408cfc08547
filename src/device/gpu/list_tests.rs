//! The list of faces on boundaries, after each kind of step: it has every one of them once, and hardly any others. Needs a
//! Vulkan driver, as the tests of the device do.

use std::mem::{offset_of, size_of};

use super::adapter::enumerate;
use super::buffers::Buffers;
use super::layout::Lists;
use super::merging::Merging;
use super::steps::GpuSteps;
use super::{GpuDevice, energy_shifts};
use crate::cluster::dual_edge::{Rank, Ties, mutual};
use crate::cluster::seeds;
use crate::device::{Cancel, MergeSteps, Steps};
use crate::sample::{Sample, generate};
use crate::surface::{DualGraph, Surface};

/// The faces with a neighbour of another cluster.
fn boundary(graph: &DualGraph, labels: &[u32]) -> Vec<u32> {
    let differs = |face: u32, near: u32| labels[near as usize] != labels[face as usize];
    let is_on_boundary = |&face: &u32| graph.neighbours_of(face).iter().any(|&near| differs(face, near));
    (0..labels.len() as u32).filter(is_on_boundary).collect()
}

/// What is listed, sorted, once it was checked that all faces on boundaries are there, each once.
fn listed(steps: &mut GpuSteps<'_, Merging>, graph: &DualGraph, context: &str) -> Vec<u32> {
    let head = offset_of!(Lists, entries) / size_of::<u32>();
    let words = head + 2 * graph.faces();
    let (_, words) = steps.download::<u32>(steps.encoder(), &steps.buffers.lists, words).expect("the list");
    let first = head + words[offset_of!(Lists, first) / 4] as usize;
    let mut listed = words[first..][..words[offset_of!(Lists, length) / 4] as usize].to_vec();
    listed.sort_unstable();
    assert!(listed.windows(2).all(|pair| pair[0] < pair[1]), "{context}: each once");
    let labels = steps.labels().expect("labels");
    let missing = boundary(graph, &labels).into_iter().find(|face| listed.binary_search(face).is_err());
    assert_eq!(missing, None, "{context}");
    listed
}

#[test]
fn the_list_has_the_faces_on_boundaries_and_few_others() {
    let found = enumerate().into_iter().filter(|found| found.report.usable).min_by_key(|found| found.report.kind);
    let mut device = GpuDevice::new(&found.expect("a Vulkan driver")).expect("it opens");
    let connection = device.connection().expect("it is open");
    let surface = Surface::build(&generate(Sample::Knot, 6000).expect("a sample")).expect("a surface");
    let graph = &surface.graph;
    let seeds = seeds::stratified(graph, &[60], 1);
    let components = &seeds.component_of_cluster;
    let buffers = Buffers::new(connection, graph, &energy_shifts(graph, components).expect("shifts")).expect("it fits");
    let merging = Merging::new(connection, &buffers, 60, true).expect("it fits");
    let mut steps = GpuSteps::new(connection, graph, components, buffers, merging);
    let cancel = Cancel::default();

    steps.set_labels(&seeds.labels(graph.faces())).expect("set");
    steps.grow(&cancel).expect("grow");
    assert!(listed(&mut steps, graph, "growth").len() < graph.faces(), "all were free");
    let few = |listed: Vec<u32>, labels: Vec<u32>, context: &str| {
        let (listed, needed) = (listed.len(), boundary(graph, &labels).len());
        assert!(listed < graph.faces() / 2 && 2 * listed < 3 * needed, "{context}: {listed} for {needed}");
    };
    steps.optimise_boundary(100, &cancel, &mut |_| {}).expect("optimise");
    few(listed(&mut steps, graph, "boundary"), steps.labels().expect("labels"), "boundary");
    steps.refine(100, &cancel, &mut |_| {}).expect("refine");
    few(listed(&mut steps, graph, "refinement"), steps.labels().expect("labels"), "refinement");
    for round in 0..4 {
        let pairs: Vec<(u32, u32)> =
            mutual(&steps.optimal_dual_edges(Ties::Hash).expect("edges")).iter().map(Rank::ends).collect();
        steps.merge(&pairs[..1 + pairs.len() / 2]).expect("a merge");
        listed(&mut steps, graph, "merge");
        steps.optimal_dual_edges(Ties::Hash).expect("edges");
        let weeded = listed(&mut steps, graph, "dual edges");
        assert_eq!(weeded, boundary(graph, &steps.labels().expect("labels")), "round {round}: nothing moved");
        steps.optimise_boundary(3, &cancel, &mut |_| {}).expect("optimise");
        steps.refine(3, &cancel, &mut |_| {}).expect("refine");
        steps.repair(&cancel).expect("a repair");
        few(listed(&mut steps, graph, "round"), steps.labels().expect("labels"), "round");
    }
}
