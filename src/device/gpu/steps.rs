//! The steps on one surface, as sequences of kernels.

use std::cell::RefCell;
use std::mem::take;
use std::sync::Arc;

use super::batches::{BOUNDARY, GROWTH, REFINEMENT};
use super::buffers::Buffer;
use super::connection::Connection;
use super::kernels::{self, Kernel};
use super::layout::Move;
use super::memory::{BETWEEN, SurfaceMemory};
use super::merge_steps::{Found, Search};
use super::upload::upload;
use crate::device::cpu;
use crate::device::{Cancel, Ending, FREE, Step, Steps};
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

/// A phase that stopped at its limit of iterations.
enum Stopped<'a> {
    /// On the device, with the number of the next iteration. Of refinement, `face_bids` has the iteration of each
    /// refusal.
    OnDevice(u32),
    /// On the cpu.
    OnCpu(Box<dyn Steps + 'a>),
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
    may_have_pieces: bool,
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
    /// The labels, if they were read and nothing has changed since.
    pub(super) known_labels: Option<Vec<u32>>,
    /// Whether the last phase had no limit: what follows are a search for pieces and, where there are none, the labels.
    pub(super) was_unlimited: bool,
    /// The sums of some clusters, ascending, if they were read and nothing has changed since.
    pub(super) known_sums: Vec<(u32, ClusterSums)>,
    stopped: Option<Stopped<'a>>,
    /// Whether `stopped` goes on with the next call.
    is_resumed: bool,
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
            is_resumed: false,
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

    /// Replaces all labels; the history stays.
    fn replace_labels(&mut self, labels: &[u32]) -> Result<()> {
        let faces = self.graph.faces();
        if labels.len() != faces {
            let message = format_args!("{faces} faces need as many labels: {}", labels.len());
            return Err(Error::new(Kind::Internal, message));
        }
        self.check_clusters(labels.iter().copied().filter(|&label| label != FREE))?;
        let (from, to) = (self.memory.get(Buffer::Labels), self.memory.get(Buffer::LabelAtMerge));
        upload(&self.connection.queue, from, 0, labels);
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(from, 0, to, 0, None);
        self.connection.queue.submit([encoder.finish()]);
        self.sums = Sums::Stale;
        self.has_free = labels.contains(&FREE);
        self.is_repaired = false;
        self.forget();
        self.note_moves();
        self.connection.check()
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

    /// Makes clusters ready for a phase: leavers and bids are counted from none.
    fn begin_phase(&mut self) {
        if !self.is_fitted {
            let encoder = self.encode_fit();
            self.connection.queue.submit([encoder.finish()]);
        }
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

    /// Grows the clusters over the free faces, all of which are listed once `encoder` has run.
    fn grow_listed(&mut self, encoder: wgpu::CommandEncoder, cancel: &Cancel) -> Result<()> {
        self.connection.queue.submit([encoder.finish()]);
        self.run(&GROWTH, (1, u32::MAX), cancel, |_, _| {})?;
        self.has_free = false;
        Ok(())
    }

    /// The phase that goes on with this call.
    fn take_resumed(&mut self) -> Option<Stopped<'a>> {
        let is_resumed = take(&mut self.is_resumed);
        self.stopped.take().filter(|_| is_resumed)
    }
}

/// Whether a limit is none: that of a run falls from the largest number with each iteration.
fn is_unlimited(max_iterations: u32) -> bool {
    max_iterations > u32::MAX / 2
}

impl Steps for GpuSteps<'_> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        if self.history != History::Unmerged {
            self.history = History::Unmerged;
            self.living = (0..self.clusters()).collect();
            self.memory.list_clusters(&self.connection.queue, &self.living);
        }
        self.take_resumed();
        self.replace_labels(labels)
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        if !self.has_free {
            return Ok(());
        }
        let encoder = self.encode_fit();
        self.grow_listed(encoder, cancel)
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        if let Sums::Current(Some(energy)) = self.sums {
            return Ok(energy);
        }
        if let Some(search) = self.last_search.filter(|_| self.history == History::Merged) {
            // of a round without optimisation: the next round begins with this search
            let energy;
            (energy, self.found_ahead) = self.search(search)?;
            return Ok(energy);
        }
        let encoder = self.encode_fit();
        let energy = self.read_between(encoder)?.energy();
        self.set_energy(Some(energy));
        Ok(energy)
    }

    fn optimise_boundary(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        let first = match self.take_resumed() {
            Some(Stopped::OnDevice(next)) => next,
            Some(Stopped::OnCpu(_)) | None => 1,
        };
        self.begin_phase();
        self.was_unlimited = is_unlimited(max_iterations);
        let mut last = if let Sums::Current(energy) = self.sums { energy } else { None };
        let outcome = self.run(&BOUNDARY, (first, max_iterations), cancel, |stats, moves| {
            last = Some(stats.energy());
            on_iteration(Step { energy: stats.energy(), moves });
        });
        self.set_energy(last);
        self.is_after_boundary = true;
        let (ending, next) = outcome?;
        self.stopped = (ending == Ending::IterationLimit).then_some(Stopped::OnDevice(next));
        Ok(ending)
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_iteration: &mut dyn FnMut(Step)) -> Result<Ending> {
        // iterations only report the rise
        let mut explained = self.energy()?.explained;
        let first = match self.take_resumed() {
            Some(Stopped::OnDevice(next)) => next,
            Some(Stopped::OnCpu(_)) | None => {
                self.begin_phase();
                1
            }
        };
        self.was_unlimited = is_unlimited(max_iterations);
        let outcome = self.run(&REFINEMENT, (first, max_iterations), cancel, |stats, moves| {
            explained += stats.explained();
            on_iteration(Step { energy: LatticeEnergy { explained }, moves });
        });
        self.set_energy(Some(LatticeEnergy { explained }));
        let (ending, next) = outcome?;
        self.stopped = (ending == Ending::IterationLimit).then_some(Stopped::OnDevice(next));
        Ok(ending)
    }

    /// On the cpu: few runs need it, for few moves, and a walk through a cluster is no work for a gpu.
    fn refine_connected(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        let before = self.labels()?;
        let at_merge = if self.history == History::Unmerged { Vec::new() } else { self.labels_at_merge(&before)? };
        let mut steps = match self.take_resumed() {
            Some(Stopped::OnCpu(steps)) => steps,
            Some(Stopped::OnDevice(_)) | None => {
                let mut steps = cpu::open(self.graph, self.component_of_cluster);
                steps.set_labels(&before)?;
                steps
            }
        };
        let ending = steps.refine_connected(max_iterations, cancel, on_iteration)?;
        let labels = steps.labels()?;
        self.replace_labels(&labels)?;
        upload(&self.connection.queue, self.memory.get(Buffer::LabelAtMerge), 0, &at_merge);
        self.stopped = (ending == Ending::IterationLimit).then_some(Stopped::OnCpu(steps));
        Ok(ending)
    }

    fn resume(&mut self) {
        self.is_resumed = true;
        if let Some(Stopped::OnCpu(steps)) = &mut self.stopped {
            steps.resume();
        }
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        if !self.may_have_pieces {
            return Ok(0);
        }
        let freed = self.detach_pieces()?;
        if freed != 0 {
            self.grow_listed(self.encoder(), cancel)?;
        }
        self.may_have_pieces = false;
        Ok(freed)
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        self.read_labels()
    }
}
