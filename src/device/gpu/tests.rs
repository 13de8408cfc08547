//! Tests of the inside of the device: the boundary list after each kind of step, the table of kernels, transfers. They
//! need a Vulkan driver.

use std::mem::{offset_of, size_of};
use std::sync::Arc;

use super::adapter::{FACES_A_CLUSTER, enumerate, largest_meshes};
use super::buffers::{Buffer, Sizes};
use super::kernels::{KERNELS, needed};
use super::layout::BoundaryList;
use super::memory::items_of;
use super::state::GpuSteps;
use super::{GpuDevice, Overrides};
use crate::cluster::quality::Quality;
use crate::cluster::seeds;
use crate::dev::sample::{Sample, generate};
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{Cancel, Device, FREE, MergeSteps, Steps};
use crate::energy::Energy;
use crate::surface::{Component, DualGraph, Moves, Rows, Surface};

/// The best adapter, opened.
fn device(overrides: Overrides) -> GpuDevice {
    let found = enumerate().into_iter().filter(|found| found.report.usable).min_by_key(|found| found.report.kind);
    GpuDevice::with_overrides(&found.expect("a Vulkan driver"), overrides).expect("it opens")
}

/// The faces with a neighbour of another cluster.
fn boundary(graph: &DualGraph, labels: &[u32]) -> Vec<u32> {
    let differs = |face: u32, near: u32| labels[near as usize] != labels[face as usize];
    let is_on_boundary = |&face: &u32| graph.neighbours_of(face).iter().any(|&near| differs(face, near));
    (0..labels.len() as u32).filter(is_on_boundary).collect()
}

/// What is listed, sorted, once it was checked that all faces on boundaries are there, each once.
fn listed(steps: &mut GpuSteps<'_, Energy>, graph: &DualGraph, context: &str) -> Vec<u32> {
    let head = offset_of!(BoundaryList, entries) / size_of::<u32>();
    let words = head + 2 * graph.faces();
    let words: Vec<u32> = steps.download(Buffer::BoundaryList, words).expect("the list");
    let half = steps.memory.half();
    let length = words[offset_of!(BoundaryList, lengths) / 4 + half] as usize;
    let mut listed = words[head + half * graph.faces()..][..length].to_vec();
    listed.sort_unstable();
    assert!(listed.windows(2).all(|pair| pair[0] < pair[1]), "{context}: each once");
    let labels = steps.labels().expect("labels");
    let missing = boundary(graph, &labels).into_iter().find(|face| listed.binary_search(face).is_err());
    assert_eq!(missing, None, "{context}");
    listed
}

#[test]
fn the_list_has_the_faces_on_boundaries_and_few_others() {
    let device = device(Overrides::default());
    let connection = device.connection().expect("it is open");
    let surface = Surface::build(&generate(Sample::Knot, 6000).expect("a sample")).expect("a surface");
    let graph = &surface.graph;
    let seeds = seeds::stratified(graph, &[60], 1);
    let components = &seeds.component_of_cluster;
    let mut steps = GpuSteps::new(connection, graph, components, true, false).expect("it fits");
    let cancel = Cancel::default();

    steps.set_labels(&seeds.labels(graph.faces())).expect("set");
    steps.grow(&cancel).expect("grow");
    listed(&mut steps, graph, "growth");
    let few = |listed: Vec<u32>, labels: Vec<u32>, context: &str| {
        let (listed, needed) = (listed.len(), boundary(graph, &labels).len());
        assert!(listed < graph.faces() / 2 && 2 * listed < 3 * needed, "{context}: {listed} for {needed}");
    };
    steps.optimise_boundary(100, &cancel, &mut |_| {}).expect("optimise");
    // the list is made anew before a batch, and the last batches list all that moved in them
    listed(&mut steps, graph, "boundary");
    steps.refine(100, &cancel, &mut |_| {}).expect("refine");
    few(listed(&mut steps, graph, "refinement"), steps.labels().expect("labels"), "refinement");
    for round in 0..4 {
        let pairs: Vec<(u32, u32)> =
            steps.mutual_dual_edges(Ties::Hash).expect("pairs").iter().map(Rank::ends).collect();
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

#[test]
fn faces_are_free_in_a_new_surface_of_any_size() {
    let mut device = device(Overrides::default());
    for faces in [12, 4096, 4098, 16_384, 50_000] {
        let surface = Surface::build(&generate(Sample::Strip, faces).expect("a sample")).expect("a surface");
        let mut steps = device.open(&surface.graph, &[0, 0]).expect("it fits");
        assert!(steps.labels().expect("labels").iter().all(|&label| label == FREE), "{faces} faces");
    }
}

#[test]
fn the_host_reads_through_one_buffer_that_grows() {
    let device = device(Overrides::default());
    let surface = Surface::build(&generate(Sample::Knot, 3000).expect("a sample")).expect("a surface");
    let components = vec![0; 30];
    let connection = device.connection().expect("it is open");
    let mut steps = GpuSteps::new(connection, &surface.graph, &components, false, false).expect("it fits");
    let mut read = |expected: u32, items: usize| {
        steps.set_labels(&vec![expected; surface.faces()]).expect("set");
        let labels: Vec<u32> = steps.download(Buffer::Labels, items).expect("labels");
        assert_eq!(labels, vec![expected; items]);
        let kept = steps.host_buffer.take().expect("a buffer");
        steps.host_buffer.set(Some(kept.clone()));
        kept
    };
    let small = read(1, 100);
    let large = read(2, 2900);
    assert!(large != small && large.size() >= 11_600);
    for (expected, items) in [(3, 1), (4, 2900), (5, 700)] {
        assert_eq!(read(expected, items), large);
    }
}

#[test]
fn no_kernel_sees_two_buffers_of_one_memory_and_it_is_long_enough_for_both() {
    let sizes = Sizes::of(3, 1000, 250);
    for kernel in KERNELS {
        let memories = kernel.bindings().into_iter().map(|binding| binding.buffer.memory() as usize);
        let found: Vec<usize> = memories.collect();
        assert!(
            found.iter().all(|memory| found.iter().filter(|other| *other == memory).count() == 1),
            "{}",
            kernel.name
        );
    }
    let shared = Buffer::ALL.iter().filter(|buffer| buffer.memory() != **buffer);
    let bytes = |buffer: Buffer| buffer.spec().bytes(&sizes);
    assert!(shared.clone().all(|buffer| bytes(buffer.memory()) >= bytes(*buffer)));
    assert_eq!(shared.count(), 2);
}

#[test]
fn a_face_takes_no_more_memory_than_before() {
    assert_eq!(FACES_A_CLUSTER, Quality::Default.optimised_from());
    // a closed triangle mesh into clusters of 100 faces, and a hierarchy that is optimised from 4 faces a cluster on
    for (is_merging, faces_a_cluster, most) in [(false, 100, 58), (true, 4, 113)] {
        let faces = 10_000_000;
        let sizes = Sizes { face_groups: faces / 256, ..Sizes::of(3, faces, faces / faces_a_cluster) };
        let needed = needed(is_merging);
        let bytes = |&buffer: &Buffer| buffer.spec().bytes_of(items_of(buffer, &needed, &sizes), 3);
        let bytes: u64 = Buffer::ALL.iter().map(bytes).sum();
        assert_eq!(bytes.div_ceil(faces), most, "{bytes} of {faces} faces");
    }
}

#[test]
fn a_mesh_of_the_largest_size_that_is_reported_opens_and_one_with_a_face_more_does_not() {
    let device = device(Overrides { binding_size: Some(100_000), ..Overrides::default() });
    let connection = device.connection().expect("it is open");
    let largest = largest_meshes(&connection.bindings);
    for (most, is_merging) in [(largest.flat, false), (largest.hierarchy, true)] {
        let opens = |faces: u64| {
            let count = faces as u32;
            let graph: DualGraph = DualGraph {
                moves: Moves::Free,
                points: vec![[0; 3]; faces as usize],
                weights: vec![1; faces as usize],
                neighbours: Rows {
                    offsets: (0..=count).map(|face| 3 * face).collect(),
                    items: (0..3 * count).map(|at| (at / 3 + at % 3 + 1) % count).collect(),
                },
                components: vec![Component { first_face: 0, faces: count, weight: faces, energy_shift: 0 }],
            };
            let clusters = vec![0; (faces / 4) as usize];
            let labels: Vec<u32> = (0..count).map(|face| face % clusters.len() as u32).collect();
            GpuSteps::new(Arc::clone(&connection), &graph, &clusters, is_merging, false)
                .and_then(|mut steps| steps.set_labels(&labels))
                .is_ok()
        };
        assert!(opens(most) && !opens(most + 1), "{most} faces");
    }
}
