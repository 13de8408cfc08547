//! What a hierarchy needs on the device beyond a flat clustering: buffers, and the bind groups over them.

use std::mem::size_of;

use super::buffers::{Buffers, bind, create, groups};
use super::connection::{Compiled, Connection, MergeKernels};
use super::layout::{Best, Choice, Dispatch, Found, Picked};
use crate::error::Result;

/// Sums that are read at a time.
const PICKED: u64 = 1 << 18;

/// The further buffers of a hierarchy.
#[derive(Debug)]
pub(super) struct Merging {
    pub(super) found: wgpu::Buffer,
    pub(super) bests: wgpu::Buffer,
    /// A list of the host's: pairs that merge, or clusters whose sums it wants.
    pub(super) entries: wgpu::Buffer,
    pub(super) picked: wgpu::Buffer,
    /// For each cluster 0, or one more than the cluster that it became part of.
    pub(super) merged_into: wgpu::Buffer,
    /// Sums that fit into `picked`, and clusters into `entries`.
    pub(super) most_picked: usize,
    pub(super) bindings: MergeBindings,
    row: u32,
    /// Whether the device is a driver that computes on the cpu.
    pub(super) is_software: bool,
}

/// What each kernel sees.
#[derive(Debug)]
pub(super) struct MergeBindings {
    pub(super) price: wgpu::BindGroup,
    pub(super) break_ties: wgpu::BindGroup,
    pub(super) prefer: wgpu::BindGroup,
    pub(super) list_choices: wgpu::BindGroup,
    pub(super) search: wgpu::BindGroup,
    pub(super) reduce: wgpu::BindGroup,
    pub(super) unite: wgpu::BindGroup,
    pub(super) relabel: wgpu::BindGroup,
    pub(super) list_moves: wgpu::BindGroup,
    pub(super) pick_sums: wgpu::BindGroup,
}

impl Merging {
    /// Makes room beside the buffers of a surface that was opened with so many clusters.
    pub(super) fn new(connection: &Connection, buffers: &Buffers, clusters: u32, is_software: bool) -> Result<Self> {
        let kernels = connection.merge_kernels()?;
        let storage = wgpu::BufferUsages::STORAGE;
        let (into, out) = (wgpu::BufferUsages::COPY_DST, wgpu::BufferUsages::COPY_SRC);
        let create = |what: &'static str, items: u64, size: usize, usage| {
            create(connection, what, items.max(1) * size as u64, usage)
        };
        let (faces, clusters) = (u64::from(buffers.faces), u64::from(clusters));
        let [columns, rows, _] = buffers.face_groups;
        let most_picked = clusters.min(PICKED);

        let choices = create("choices", clusters, size_of::<Choice>(), storage)?;
        // the longest list is that of all faces; there are no more clusters than faces
        let found = create("list", faces, size_of::<Found>(), storage | out)?;
        let bests = create("best dual edges", u64::from(columns) * u64::from(rows), size_of::<Best>(), storage | out)?;
        // pairs are half as many as clusters
        let entries = create("entries", clusters.max(2), 4, storage | into)?;
        let merged_into = create("merged clusters", clusters, 4, storage | into)?;
        let picked = create("sums for the host", most_picked, size_of::<Picked>(), storage | out)?;

        let Buffers { neighbours, labels, clusters: sums, proxies, ring, origins, lists, .. } = buffers;
        let bind = |compiled: &Compiled, storage: &[&wgpu::Buffer]| {
            bind(connection, compiled, buffers.turns.buffer(), storage)
        };
        let edges = |compiled, result| bind(compiled, &[neighbours, labels, proxies, sums, result, lists]);
        let MergeKernels { price, break_ties, prefer, list_choices, .. } = kernels;
        let bindings = MergeBindings {
            price: edges(price, &choices),
            break_ties: edges(break_ties, &choices),
            prefer: edges(prefer, &choices),
            list_choices: bind(list_choices, &[&choices, &found, ring, lists]),
            search: edges(&kernels.search, &bests),
            reduce: bind(&kernels.reduce, &[&bests, lists]),
            unite: bind(&kernels.unite, &[&entries, sums, &merged_into]),
            relabel: bind(&kernels.relabel, &[labels, origins, &merged_into]),
            list_moves: bind(&kernels.list_moves, &[labels, origins, &found, ring, lists]),
            pick_sums: bind(&kernels.pick_sums, &[&entries, sums, &picked]),
        };
        connection.check()?;
        Ok(Self {
            found,
            bests,
            entries,
            merged_into,
            picked,
            most_picked: most_picked as usize,
            bindings,
            row: connection.limits.max_compute_workgroups_per_dimension,
            is_software,
        })
    }

    /// Workgroups of a dispatch with a thread an entry.
    pub(super) fn groups(&self, entries: usize) -> Dispatch {
        groups(entries as u64, self.row)
    }
}
