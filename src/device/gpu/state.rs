//! What is known about a surface on the device between the steps, and commands for its kernels.

use std::cell::RefCell;
use std::sync::Arc;

use super::buffers::Buffer;
use super::connection::Connection;
use super::kernels::{self, Kernel};
use super::layout::Move;
use super::memory::{BETWEEN, SurfaceMemory};
use crate::device::DualEdge;
use crate::device::dual_edge::Ties;
use crate::energy::{ClusterSums, LatticeEnergy};
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;

/// Whether cluster sums and boundary list belong to the labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sums {
    /// The labels were replaced.
    Stale,
    /// They do; the energy once known.
    Current(Option<LatticeEnergy>),
}

/// What happened since the labels were set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum History {
    /// No clusters merged.
    Unmerged,
    /// Clusters merged, and no face has moved since.
    Merged,
    /// Clusters merged, and faces may have moved since.
    MovedSinceMerge,
}

/// A search for dual edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Search {
    /// The best of each cluster.
    Best(Ties),
    /// The cheapest of all.
    Cheapest(Ties),
}

/// What a search has found.
#[derive(Debug)]
pub(super) enum Found {
    /// In the order of the clusters.
    Best(Vec<DualEdge>),
    /// The ends, the smaller number first.
    Cheapest(Option<(u32, u32)>),
}

/// A surface on the gpu.
pub(super) struct GpuSteps<'a> {
    pub(super) connection: Arc<Connection>,
    pub(super) graph: &'a DualGraph,
    pub(super) component_of_cluster: &'a [u32],
    pub(super) memory: SurfaceMemory,
    /// The clusters that may have faces, ascending.
    pub(super) living: Vec<u32>,
    pub(super) sums: Sums,
    pub(super) history: History,
    /// Whether a face may be free.
    pub(super) has_free: bool,
    /// Whether faces may have moved since pieces were last searched.
    pub(super) may_have_pieces: bool,
    /// Whether a repair was the last to free faces: few of them move then.
    pub(super) is_repaired: bool,
    /// Iterations since the boundary list was made of boundary faces only.
    pub(super) iterations_listed: u32,
    /// The faces that moved since the last merge, if they were read and nothing has moved since.
    pub(super) moves: Option<Vec<Move>>,
    /// The last search for dual edges.
    pub(super) last_search: Option<Search>,
    /// Whether proxies, bids and dispatches are as [`PROXIES_FIT`](kernels::PROXIES_FIT) left them between batches.
    pub(super) is_fitted: bool,
    /// Whether that search came right after a boundary phase: then the next one may, too.
    pub(super) search_follows: bool,
    /// Whether nothing has happened since a boundary phase.
    pub(super) is_after_boundary: bool,
    /// What that search would find now, if it was made ahead and nothing has changed since.
    pub(super) found_ahead: Option<Found>,
    /// The labels, if they were read or set and nothing has changed since.
    pub(super) known_labels: Option<Vec<u32>>,
    /// Whether the last phase had no limit: what follows are a search for pieces and, where there are none, the labels.
    pub(super) was_unlimited: bool,
    /// The sums of some clusters, ascending, if they were read and nothing has changed since.
    pub(super) known_sums: Vec<(u32, ClusterSums)>,
    /// The number of the next iteration of a phase that stopped at its limit. Of refinement, `face_bids` has the
    /// iteration of each refusal.
    pub(super) stopped: Option<u32>,
    /// The same of the phase that goes on with the next call.
    pub(super) resumed: Option<u32>,
    /// Buffers that the host reads results through, those in flight taken out.
    pub(super) host_buffers: RefCell<Vec<wgpu::Buffer>>,
}

impl<'a> GpuSteps<'a> {
    /// Opens a surface, all faces free. Hierarchies need more buffers.
    pub(super) fn new(
        connection: Arc<Connection>,
        graph: &'a DualGraph,
        component_of_cluster: &'a [u32],
        is_merging: bool,
    ) -> Result<Self> {
        let memory = SurfaceMemory::new(&connection, graph, component_of_cluster, is_merging)?;
        let steps = Self {
            connection,
            graph,
            component_of_cluster,
            memory,
            living: (0..component_of_cluster.len() as u32).collect(),
            sums: Sums::Stale,
            history: History::Unmerged,
            has_free: true,
            may_have_pieces: true,
            is_repaired: false,
            iterations_listed: u32::MAX,
            moves: None,
            last_search: None,
            search_follows: false,
            is_after_boundary: false,
            is_fitted: false,
            found_ahead: None,
            known_labels: None,
            was_unlimited: false,
            known_sums: Vec::new(),
            stopped: None,
            resumed: None,
            host_buffers: RefCell::default(),
        };
        let mut encoder = steps.encoder();
        steps.encode(&mut encoder, "upload", &[kernels::LABELS_FREE]);
        steps.connection.queue.submit([encoder.finish()]);
        Ok(steps)
    }

    /// Number of clusters, with those that have merged.
    pub(super) fn clusters(&self) -> u32 {
        self.component_of_cluster.len() as u32
    }

    /// Refuses clusters that do not exist.
    pub(super) fn check_clusters(&self, mut clusters: impl Iterator<Item = u32>) -> Result<()> {
        let limit = self.clusters();
        clusters.find(|&cluster| cluster >= limit).map_or(Ok(()), |cluster| {
            Err(Error::new(Kind::Internal, format_args!("clusters must be below {limit}: {cluster}")))
        })
    }

    /// Notes that faces may have moved.
    pub(super) fn note_moves(&mut self) {
        self.may_have_pieces = true;
        if self.history == History::Merged {
            self.history = History::MovedSinceMerge;
        }
    }

    /// Forgets what was read about clusters and moves, because faces will move or clusters merge.
    pub(super) fn forget(&mut self) {
        self.is_fitted = false;
        self.is_after_boundary = false;
        self.moves = None;
        self.found_ahead = None;
        self.known_labels = None;
        self.known_sums.clear();
    }

    /// Stores the energy of the labels, the sums being current; none when it is not known.
    pub(super) fn set_energy(&mut self, energy: Option<LatticeEnergy>) {
        self.sums = Sums::Current(energy);
    }

    /// Encodes proxies and energy of the labels, after sums and boundary list if those are stale. The indirect
    /// dispatches that follow go over the listed faces.
    pub(super) fn encode_fit(&mut self) -> wgpu::CommandEncoder {
        let mut encoder = self.encoder_without_stats();
        if self.sums == Sums::Stale {
            encoder.clear_buffer(self.memory.get(Buffer::Clusters), 0, None);
            let gather = [kernels::SUMS_GATHER, kernels::BOUNDARY_BUILD, kernels::BOUNDARY_PUBLISH];
            self.encode(&mut encoder, "gather", &gather);
            self.sums = Sums::Current(None);
            self.iterations_listed = if self.has_free { u32::MAX } else { 0 };
        }
        self.encode(&mut encoder, "fit", &[kernels::PROXIES_FIT]);
        self.is_fitted = true;
        encoder
    }

    /// An encoder after whose commands the sums are current.
    pub(super) fn encoder_with_sums(&mut self) -> wgpu::CommandEncoder {
        if self.sums == Sums::Stale { self.encode_fit() } else { self.encoder() }
    }

    /// An encoder that clears the statistics.
    pub(super) fn encoder_without_stats(&self) -> wgpu::CommandEncoder {
        let mut encoder = self.encoder();
        encoder.clear_buffer(self.memory.get(Buffer::Stats), 0, None);
        encoder
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.connection.encoder()
    }

    /// Encodes kernels one after the other, between batches.
    pub(super) fn encode(&self, encoder: &mut wgpu::CommandEncoder, stage: &'static str, kernels: &[&Kernel]) {
        let mut pass = self.connection.pass(encoder, stage);
        for kernel in kernels {
            self.memory.dispatch(&self.connection, &mut pass, kernel, BETWEEN);
        }
    }
}
