//! The list of faces on boundaries, after each kind of step: it has every one of them once, and hardly any others. Needs a
//! Vulkan driver, as the tests of the device do.

use std::mem::{offset_of, size_of};
use std::sync::Arc;

use super::adapter::enumerate;
use super::buffers::Buffers;
use super::connection::lock;
use super::layout::Lists;
use super::merging::Merging;
use super::steps::GpuSteps;
use super::{GpuDevice, Overrides, energy_shifts};
use crate::cluster::dual_edge::{Rank, Ties, keep_cheaper_half, mutual};
use crate::cluster::seeds;
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device, FREE, MergeSteps, Steps};
use crate::sample::{Sample, generate};
use crate::surface::{DualGraph, Surface};

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
    let mut device = device(Overrides::default());
    let connection = device.connection().expect("it is open");
    let surface = Surface::build(&generate(Sample::Knot, 6000).expect("a sample")).expect("a surface");
    let graph = &surface.graph;
    let seeds = seeds::stratified(graph, &[60], 1);
    let components = &seeds.component_of_cluster;
    let shifts = energy_shifts(graph, components).expect("shifts");
    let buffers = Buffers::new(connection, graph, None, &shifts, true).expect("it fits");
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

#[test]
fn buffers_serve_again_and_what_was_in_them_is_not_read() {
    let mut device = device(Overrides::default());
    let surface = Surface::build(&generate(Sample::Knot, 3000).expect("a sample")).expect("a surface");
    let graph = &surface.graph;
    let components = vec![0; 30];
    assert_eq!(device.spoil_spare_buffers().expect("it is open"), 0, "nothing was left yet");
    drop(device.open(graph, &components).expect("it fits"));
    let left = device.spoil_spare_buffers().expect("it is open");
    assert!(left > 52 * graph.faces() as u64, "{left}");

    let connection = device.connection().expect("it is open");
    let shifts = energy_shifts(graph, &components).expect("shifts");
    let buffers = Buffers::new(connection, graph, None, &shifts, false).expect("it fits");
    let steps = GpuSteps::new(connection, graph, &components, buffers, ());
    let (_, garbage) = steps.download::<u32>(steps.encoder(), &steps.buffers.ring, 1).expect("garbage");
    assert_eq!(garbage, [0xa5a5_a5a5], "nobody has written there for this surface: it is the same buffer");
}

#[test]
fn buffers_of_a_surface_outlast_coarse_ones_until_nobody_wants_them_for_long() {
    let mut device = device(Overrides::default());
    let surface = |faces| Surface::build(&generate(Sample::Knot, faces).expect("a sample")).expect("a surface");
    let (coarse, fine) = (surface(500), surface(5000));
    let mut kept_after = |surface: &Surface| {
        drop(device.open(&surface.graph, &[0; 30]).expect("it fits"));
        device.spoil_spare_buffers().expect("it is open")
    };
    let alone = kept_after(&coarse);
    let both = kept_after(&fine);
    assert!(both > alone + 64 * 4500, "{both} after {alone}");
    for _ in 0..3 {
        assert_eq!([kept_after(&coarse), kept_after(&fine)], [both; 2], "nothing was made anew, or freed");
    }
    let kept: Vec<u64> = (0..40).map(|_| kept_after(&coarse)).collect();
    assert_eq!((kept[20], kept[39]), (both, alone), "{kept:?}");
}

#[test]
fn two_surfaces_take_turns_with_the_buffers_that_are_filled_ahead() {
    let mut device = device(Overrides::default());
    let uploader = device.uploader().expect("a gpu has memory of its own");
    let surface = Surface::build(&generate(Sample::Knot, 3000).expect("a sample")).expect("a surface");
    let components = vec![0; 30];
    let pool = Arc::clone(device.connection.as_ref().expect("it is open"));
    let mut filled: Vec<wgpu::Buffer> = Vec::new();
    let mut uploaded = uploader.upload(&surface.graph).expect("there is room");
    for _ in 0..6 {
        device.receive(uploaded);
        let steps = device.open(&surface.graph, &components).expect("it fits");
        uploaded = uploader.upload(&surface.graph).expect("there is room");
        let faces = lock(&pool.pool).ahead().expect("it waits").faces.clone();
        drop(steps);
        assert!(filled.last() != Some(&faces), "the surface that is open has it");
        filled.push(faces);
    }
    assert!(filled.iter().all(|buffer| filled[..2].contains(buffer)), "{filled:?}");
    drop(uploaded);
    assert!(lock(&pool.pool).ahead().is_none(), "nobody wants it any more");
}

#[test]
fn what_was_brought_of_a_surface_waits_through_coarser_ones_and_the_upload_of_the_next() {
    let mut device = device(Overrides::default());
    let uploader = device.uploader().expect("a gpu has memory of its own");
    let surface = |faces| Surface::build(&generate(Sample::Knot, faces).expect("a sample")).expect("a surface");
    let (coarse, first, second) = (surface(500), surface(3000), surface(3000));
    let pool = Arc::clone(device.connection.as_ref().expect("it is open"));
    let brought = |surface: &Surface| {
        let uploaded = uploader.upload(&surface.graph).expect("there is room");
        let faces = lock(&pool.pool).ahead().expect("it waits").faces.clone();
        (uploaded, faces)
    };
    let (of_first, faces_of_first) = brought(&first);
    drop(device.open(&coarse.graph, &[0; 30]).expect("it fits"));
    let (of_second, faces_of_second) = brought(&second);
    for (uploaded, surface, faces) in [(of_first, &first, faces_of_first), (of_second, &second, faces_of_second)] {
        device.receive(uploaded);
        let steps = device.open(&surface.graph, &[0; 30]).expect("it fits");
        assert!(lock(&pool.pool).lends(&faces), "it was brought anew");
        drop(steps);
    }
}

#[test]
fn faces_are_free_in_a_new_surface_of_any_size() {
    let mut device = device(Overrides::default());
    for faces in [12, 4096, 4098, 16_384, 50_000] {
        let surface = Surface::build(&generate(Sample::Strip, faces).expect("a sample")).expect("a surface");
        device.spoil_spare_buffers().expect("it is open");
        let mut steps = device.open(&surface.graph, &[0, 0]).expect("it fits");
        assert!(steps.labels().expect("labels").iter().all(|&label| label == FREE), "{faces} faces");
    }
}

#[test]
fn the_host_reads_through_one_buffer_that_grows_and_outlasts_the_surface() {
    let mut device = device(Overrides::default());
    let surface = Surface::build(&generate(Sample::Knot, 3000).expect("a sample")).expect("a surface");
    let components = vec![0; 30];
    let read = |device: &mut GpuDevice, expected: u32, items: usize| {
        let connection = device.connection().expect("it is open");
        let shifts = energy_shifts(&surface.graph, &components).expect("shifts");
        let buffers = Buffers::new(connection, &surface.graph, None, &shifts, false).expect("it fits");
        let mut steps = GpuSteps::new(connection, &surface.graph, &components, buffers, ());
        steps.set_labels(&vec![expected; surface.faces()]).expect("set");
        let (_, labels) = steps.download::<u32>(steps.encoder(), &steps.buffers.labels, items).expect("labels");
        assert_eq!(labels, vec![expected; items]);
        drop(steps);
        lock(&connection.pool).for_host().expect("it is kept").clone()
    };
    let small = read(&mut device, 1, 100);
    let large = read(&mut device, 2, 2000);
    assert!(large != small && large.size() >= 8000);
    for (expected, items) in [(3, 1), (4, 2000), (5, 700)] {
        assert_eq!(read(&mut device, expected, items), large);
    }
}

/// What the late rounds of a hierarchy look at.
#[derive(Debug, Default)]
struct Late {
    rounds: usize,
    /// Faces listed, summed over the rounds.
    listed: usize,
    /// Faces whose labels merges wrote.
    relabelled: usize,
    /// Faces that changed their cluster by merging.
    merged: usize,
    moves: usize,
    cut_off: u64,
    /// Searches for pieces that went over all faces.
    everywhere: usize,
    /// The same in earlier rounds.
    everywhere_before: usize,
}

/// Carries out the rounds of a hierarchy of a knot, those from 27 clusters on counted. Pieces are looked for near moves.
fn late_rounds(faces: u64) -> Late {
    let mut device = device(Overrides { always_near: true, ..Overrides::default() });
    let connection = device.connection().expect("it is open");
    let surface = Surface::build(&generate(Sample::Knot, faces).expect("a sample")).expect("a surface");
    let graph = &surface.graph;
    let components = surface.component_of_face();
    let shifts = energy_shifts(graph, &components).expect("shifts");
    let buffers = Buffers::new(connection, graph, None, &shifts, true).expect("it fits");
    let merging = Merging::new(connection, &buffers, shifts.len() as u32, true).expect("it fits");
    let mut steps = GpuSteps::new(connection, graph, &components, buffers, merging);
    let cancel = Cancel::default();
    let raw = |steps: &GpuSteps<'_, Merging>| {
        steps.download::<u32>(steps.encoder(), &steps.buffers.labels, graph.faces()).expect("labels").1
    };
    let word = |steps: &GpuSteps<'_, Merging>, at: usize| {
        let words = steps.download::<u32>(steps.encoder(), &steps.buffers.lists, size_of::<Lists>() / 4);
        words.expect("the list").1[at / 4]
    };
    let every_face: Vec<u32> = (0..graph.faces() as u32).collect();
    let mut cpu = CpuDevice::new();
    let mut on_cpu = cpu.open_merging(graph, &components).expect("the cpu");
    steps.set_labels(&every_face).expect("set");
    on_cpu.set_labels(&every_face).expect("set");
    let mut late = Late::default();
    while steps.living.len() > 1 {
        let mut mutual = mutual(&steps.optimal_dual_edges(Ties::Hash).expect("edges"));
        keep_cheaper_half(&mut mutual);
        let pairs: Vec<(u32, u32)> = mutual.iter().map(Rank::ends).collect();
        let is_late = steps.living.len() <= 27;
        let ends: Vec<u32> = pairs.iter().map(|&(_, from)| from).collect();
        let merged: u32 = steps.sums_of(&ends).expect("sums").iter().map(|sums| sums.faces).sum();
        let before = raw(&steps);
        let turned: Vec<(u32, u32)> = pairs.iter().map(|&(into, from)| (from, into)).collect();
        steps.merge(&turned).expect("a merge");
        on_cpu.merge(&turned).expect("a merge");
        let relabelled = before.iter().zip(raw(&steps)).filter(|&(&before, after)| before != after).count();
        steps.optimise_boundary(2, &cancel, &mut |_| {}).expect("optimise");
        on_cpu.optimise_boundary(2, &cancel, &mut |_| {}).expect("optimise");
        let looks_for_pieces = steps.may_be_cut;
        let cut_off = steps.repair(&cancel).expect("a repair");
        assert_eq!(on_cpu.repair(&cancel).expect("a repair"), cut_off);
        let moves = steps.moves_since_merge().expect("moves");
        assert_eq!(moves, on_cpu.moves_since_merge().expect("moves"));
        let everywhere = usize::from(looks_for_pieces && word(&steps, offset_of!(Lists, everywhere)) != 0);
        if !is_late {
            late.everywhere_before += everywhere;
        } else {
            late.rounds += 1;
            late.listed += word(&steps, offset_of!(Lists, length)) as usize;
            late.relabelled += relabelled;
            late.merged += merged as usize;
            late.moves += moves.len();
            late.cut_off += cut_off;
            late.everywhere += everywhere;
        }
    }
    let stale = raw(&steps);
    let labels = steps.labels().expect("labels");
    assert!(labels.iter().all(|&label| label == steps.living[0]), "one cluster");
    assert!(stale.iter().zip(labels).filter(|&(&stale, label)| stale != label).count() > graph.faces() / 2);
    late
}

#[test]
fn late_rounds_look_at_boundaries_and_not_at_the_mesh() {
    let (small, large) = (late_rounds(6000), late_rounds(24_000));
    let context = format!("{small:?} {large:?}");
    // as many clusters, of four times as many faces each: their boundaries are twice as long
    assert!(small.rounds > 10 && large.rounds.abs_diff(small.rounds) < 5, "{context}");
    assert!(large.moves > 1000, "{context}");
    assert!(large.listed < 3 * small.listed, "{context}");
    assert!(large.relabelled < 3 * small.relabelled && 2 * large.relabelled < large.merged, "{context}");
    // most of them without a doubt, which others had, so that the search among all faces was tried, too
    assert!(small.everywhere_before + large.everywhere_before > 0, "{context}");
    assert!(4 * (small.everywhere + large.everywhere) < small.rounds + large.rounds, "{context}");
}
