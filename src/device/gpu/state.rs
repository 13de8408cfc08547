//! A surface on the gpu: what the host knows about its state, and submissions.

use std::cell::Cell;
use std::mem::offset_of;
use std::ops::Range;
use std::sync::Arc;

use super::buffers::Buffer;
use super::connection::Connection;
use super::kernels::{self, Kernel};
use super::layout::{BoundaryList, Move};
use super::memory::{BEFORE, Numbers, SurfaceMemory};
use super::numbering::Numbering;
use crate::device::DualEdge;
use crate::device::dual_edge::Ties;
use crate::energy::{LatticeEnergy, Words};
use crate::error::{Error, Result};
use crate::surface::DualGraph;

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
#[derive(Debug, Default)]
pub(super) struct Found {
    /// The best dual edges, in the order of the clusters.
    pub best: Vec<DualEdge>,
    /// The ends of the cheapest one, the smaller number first.
    pub cheapest: Option<(u32, u32)>,
}

/// A change of the device's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    /// The host replaces all labels.
    Labels,
    /// Faces may move.
    Moves,
    /// Clusters merge.
    Merge,
}

/// What the host knows about the device's state.
#[derive(Debug)]
pub(super) struct Known<E: Words> {
    pub history: History,
    /// Whether a face may be free.
    pub has_free: bool,
    /// Whether clusters may be in pieces.
    pub may_have_pieces: bool,
    /// Whether a repair was the last to free faces: few of them move then.
    pub is_repaired: bool,
    /// Whether cluster sums and boundary list belong to the labels.
    pub has_sums: bool,
    /// Whether the proxies do, too, and no cluster has leavers or bids.
    pub is_fitted: bool,
    /// Movers of the first iteration of the last phase.
    pub movers: u32,
    /// Listed faces when the boundary list was last made, of boundary faces only: 0 if of others too, none before a
    /// batch has told.
    pub listed: Option<u32>,
    pub energy: Option<LatticeEnergy>,
    pub labels: Option<Vec<u32>>,
    /// The faces that moved since the last merge, or some, and their number.
    pub moves: Option<(Vec<Move>, usize)>,
    /// The sums of some clusters, ascending.
    pub sums: Vec<(u32, E::Sums)>,
    /// What a search finds.
    pub found: Option<(Search, Found)>,
}

impl<E: Words> Known<E> {
    /// Of a new surface: all faces are free.
    const NEW: Self = Self {
        history: History::Unmerged,
        has_free: true,
        may_have_pieces: true,
        is_repaired: false,
        has_sums: false,
        is_fitted: false,
        movers: u32::MAX,
        listed: Some(0),
        energy: None,
        labels: None,
        moves: None,
        sums: Vec::new(),
        found: None,
    };

    /// Forgets what a change makes untrue.
    pub fn invalidate(&mut self, change: Change) {
        let Self { has_free, has_sums, is_fitted, movers, listed, .. } = *self;
        let history = match (change, self.history) {
            (Change::Merge, _) => History::Merged,
            (_, History::Merged) => History::MovedSinceMerge,
            (_, history) => history,
        };
        let kept = Self { history, has_free, has_sums, is_fitted, movers, listed, ..Self::NEW };
        *self = match change {
            Change::Labels => Self { history, ..Self::NEW },
            Change::Moves => Self { is_repaired: self.is_repaired, ..kept },
            Change::Merge => Self { may_have_pieces: self.may_have_pieces, ..kept },
        };
    }
}

/// A surface on the gpu.
pub(super) struct GpuSteps<'a, E: Words> {
    pub(super) connection: Arc<Connection>,
    pub(super) graph: &'a DualGraph<E>,
    component_of_cluster: &'a [u32],
    pub(super) memory: SurfaceMemory,
    /// Which clusters the device knows, and at which places.
    pub(super) numbering: Numbering,
    /// The component of the cluster at each place.
    pub(super) component_of_place: Vec<u32>,
    /// The places of clusters that may have faces, ascending.
    pub(super) living: Vec<u32>,
    /// Whether the place of a cluster is one of them.
    pub(super) is_living: Vec<bool>,
    /// Memory for [`mutual`](crate::device::dual_edge::mutual).
    pub(super) chosen: Vec<u32>,
    pub(super) known: Known<E>,
    /// The last search for dual edges.
    pub(super) last_search: Option<Search>,
    /// The number of the first iteration of the last phase.
    pub(super) phase_from: u32,
    /// The number of the iteration after those of the last phase: clusters keep numbers, so none is used twice.
    pub(super) next: u32,
    /// Whether the next phase goes on with the last one.
    pub(super) is_resumed: bool,
    /// A buffer that the host reads results through.
    pub(super) host_buffer: Cell<Option<wgpu::Buffer>>,
}

impl<'a, E: Words> GpuSteps<'a, E> {
    /// Opens a surface, all faces free. Hierarchies need more buffers, and get those of clusters with their labels.
    /// `is_paged` is that of [`SurfaceMemory::new`].
    pub(super) fn new(
        connection: Arc<Connection>,
        graph: &'a DualGraph<E>,
        component_of_cluster: &'a [u32],
        is_merging: bool,
        is_paged: bool,
    ) -> Result<Self> {
        if component_of_cluster.is_empty() {
            return Err(Error::internal("a surface needs a cluster"));
        }
        let mut memory = SurfaceMemory::new(&connection, graph, is_merging, is_paged)?;
        memory.number(&connection.queue, Numbers::NONE, false);
        let mut steps = Self {
            connection,
            graph,
            component_of_cluster,
            memory,
            numbering: Numbering::default(),
            component_of_place: Vec::new(),
            living: Vec::new(),
            is_living: Vec::new(),
            chosen: Vec::new(),
            known: Known::NEW,
            last_search: None,
            phase_from: 1,
            next: 1,
            is_resumed: false,
            host_buffer: Cell::default(),
        };
        if !is_merging {
            steps.set_numbering(Numbering::all(component_of_cluster.len()))?;
        }
        let mut encoder = steps.connection.encoder();
        steps.encode(&mut encoder, "upload", &[kernels::LABELS_FREE], BEFORE);
        steps.connection.submit(Some(encoder));
        Ok(steps)
    }

    /// Gives the device other clusters, all of which may have faces.
    fn set_numbering(&mut self, numbering: Numbering) -> Result<()> {
        let component = |&cluster: &u32| self.component_of_cluster[cluster as usize];
        let components: Vec<u32> = numbering.numbers().iter().map(component).collect();
        self.memory.set_clusters(&self.connection, self.graph, numbering.numbers(), &components)?;
        self.component_of_place = components;
        let clusters = numbering.numbers().len();
        self.living = (0..clusters as u32).collect();
        self.memory.list_clusters(&self.connection, &self.living);
        self.is_living = vec![true; clusters];
        self.numbering = numbering;
        Ok(())
    }

    /// Forgets merges, and where clusters may merge, clusters without faces.
    pub(super) fn number_clusters(&mut self, labels: &[u32]) -> Result<()> {
        self.known.history = History::Unmerged;
        let clusters = self.component_of_cluster.len();
        if self.memory.is_merging { self.set_numbering(Numbering::of(labels, clusters)?) } else { Ok(()) }
    }

    /// Begins a submission: after its first commands, sums and boundary list belong to the labels. `is_listed_anew`
    /// removes faces from the list that are no longer on a boundary; `is_fitted` fits the proxies, and adds up the
    /// energy at [`BEFORE`].
    pub(super) fn begin(&mut self, numbers: Numbers, is_listed_anew: bool, is_fitted: bool) -> wgpu::CommandEncoder {
        let gathers = !self.known.has_sums;
        let is_listed_anew = is_listed_anew || gathers;
        let keeps_moved = self.known.history != History::Unmerged;
        self.memory.number(&self.connection.queue, Numbers { keeps_moved, ..numbers }, is_listed_anew);
        let mut encoder = self.connection.encoder();
        self.memory.get(Buffer::Stats).clear(&mut encoder);
        if is_listed_anew {
            let length = offset_of!(BoundaryList, lengths) + 4 * self.memory.half();
            encoder.clear_buffer(self.memory.get(Buffer::BoundaryList).first(), length as u64, Some(4));
            self.known.listed = self.known.has_free.then_some(0);
        }
        if gathers {
            self.memory.get(Buffer::Clusters).clear(&mut encoder);
            self.encode(&mut encoder, "gather", &[kernels::SUMS_GATHER, kernels::BOUNDARY_BUILD], BEFORE);
            self.known.has_sums = true;
        } else if is_listed_anew {
            self.encode(&mut encoder, "list", &[kernels::BOUNDARY_COMPACT], BEFORE);
        }
        if gathers || is_fitted {
            self.encode(&mut encoder, "fit", &[kernels::PROXIES_FIT], BEFORE);
            self.known.is_fitted = true;
        }
        encoder
    }

    /// Encodes kernels one after the other.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        stage: &'static str,
        kernels: &[&Kernel],
        slot: u32,
    ) {
        self.encode_slots(encoder, stage, kernels, slot..slot + 1);
    }

    /// The same once for each slot, in one pass.
    pub(super) fn encode_slots(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        stage: &'static str,
        kernels: &[&Kernel],
        slots: Range<u32>,
    ) {
        let mut pass = self.connection.pass(encoder, stage);
        for slot in slots {
            kernels.iter().for_each(|kernel| self.memory.dispatch(&self.connection, &mut pass, kernel, slot));
        }
    }
}
