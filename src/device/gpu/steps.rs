//! The steps on one surface: what is queued when, and what comes back.
//!
//! Batches of turns (iterations, or passes of the growth) are queued without waiting for each other's results: while the
//! device works on one, the host reads the ring of the one before. The device itself ends a run: the kernel that finds a
//! turn without moves writes zeros into the arguments of the indirect dispatches that follow, also those in the next batch.

use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::FaultPoint;
use super::buffers::{BETWEEN, Buffers, RING, upload};
use super::connection::{Compiled, Connection};
use super::layout::{Slot, UNLISTED};
use super::merging::Merging;
use super::readback::Batch;
use crate::device::cpu;
use crate::device::{Cancel, Ending, FREE, LatticeEnergy, Step, Steps};
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;

/// Turns in the first batch; even, as all batches of the growth are.
const FIRST_BATCH: u32 = 8;

/// A batch that takes less makes the next one larger: queueing should not cost more than the work.
const SHORT_BATCH: Duration = Duration::from_millis(25);

/// A batch that takes longer makes the next one smaller: a job that is cancelled ends after the batches that are queued.
const LONG_BATCH: Duration = Duration::from_millis(100);

/// What a turn does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Work {
    Grow,
    Boundary,
    Refine,
}

impl Work {
    /// Whether a turn found that there was nothing left to do.
    fn is_over(self, slot: &Slot) -> bool {
        match self {
            Work::Grow | Work::Boundary => slot.moves == 0,
            Work::Refine => slot.bids == 0,
        }
    }

    /// For who asks what the passes took.
    fn name(self) -> &'static str {
        match self {
            Work::Grow => "grow",
            Work::Boundary => "boundary",
            Work::Refine => "refine",
        }
    }

    fn fault_point(self) -> FaultPoint {
        match self {
            Work::Grow => FaultPoint::Grow,
            Work::Boundary => FaultPoint::Boundary,
            Work::Refine => FaultPoint::Refine,
        }
    }
}

/// A surface on the gpu.
pub(super) struct GpuSteps<'a> {
    pub(super) connection: Arc<Connection>,
    graph: &'a DualGraph,
    component_of_cluster: &'a [u32],
    pub(super) buffers: Buffers,
    /// What hierarchies need besides.
    merging: Option<Merging>,
    pub(super) clusters: u32,
    /// Whether sums and lists belong to the labels.
    pub(super) gathered: bool,
    /// Energy of the labels, once known.
    pub(super) energy: Option<LatticeEnergy>,
    /// Whether clusters merged since the labels were set.
    pub(super) has_merged: bool,
    /// Whether faces may have moved since the last merge.
    pub(super) has_moved: bool,
    /// Whether they may have since pieces were last looked for.
    pub(super) may_be_cut: bool,
    /// The clusters that may have faces, ascending.
    pub(super) living: Vec<u32>,
    /// Number of the next turn, while a phase goes on that stopped at its limit.
    resumed_at: Option<u32>,
    /// Number of the turn after the last.
    next_turn: u32,
    /// Does what the gpu leaves to the cpu, while that is going on.
    host: Option<Box<dyn Steps + 'a>>,
    /// The buffer that the host reads results through. It grows to the largest result.
    pub(super) host_buffer: Cell<Option<wgpu::Buffer>>,
}

impl<'a> GpuSteps<'a> {
    pub(super) fn new(
        connection: Arc<Connection>,
        graph: &'a DualGraph,
        component_of_cluster: &'a [u32],
        buffers: Buffers,
        merging: Option<Merging>,
    ) -> Self {
        let clusters = component_of_cluster.len() as u32;
        Self {
            connection,
            graph,
            component_of_cluster,
            buffers,
            merging,
            clusters,
            gathered: false,
            energy: None,
            has_merged: false,
            has_moved: true,
            may_be_cut: true,
            living: (0..clusters).collect(),
            resumed_at: None,
            next_turn: 1,
            host: None,
            host_buffer: Cell::default(),
        }
    }

    /// Replaces all labels, whatever merged before; no face has moved since.
    fn replace_labels(&mut self, labels: &[u32]) -> Result<()> {
        if labels.len() != self.buffers.faces as usize {
            return Err(Error::new(
                Kind::Internal,
                format_args!("{} faces need as many labels, not {}", self.buffers.faces, labels.len()),
            ));
        }
        let foreign = labels.iter().find(|&&label| label >= self.clusters && label != FREE);
        if let Some(label) = foreign {
            return Err(Error::new(
                Kind::Internal,
                format_args!("labels must be below {}, not {label}", self.clusters),
            ));
        }
        upload(&self.connection.queue, &self.buffers.labels, 0, labels);
        let mut encoder = self.encoder();
        let bytes = 4 * u64::from(self.buffers.faces);
        encoder.copy_buffer_to_buffer(&self.buffers.labels, 0, &self.buffers.origins, 0, Some(bytes));
        self.connection.queue.submit([encoder.finish()]);
        self.gathered = false;
        self.energy = None;
        self.has_moved = true;
        self.may_be_cut = true;
        self.connection.check()
    }

    /// The labels that all faces had after the last merge; `labels` are those that they have.
    fn origins(&self, labels: &[u32]) -> Result<Vec<u32>> {
        let (_, origins) = self.download::<u32>(self.encoder(), &self.buffers.origins, labels.len())?;
        let origin = |(&origin, &label): (&u32, &u32)| if origin == UNLISTED { label } else { origin };
        Ok(origins.iter().zip(labels).map(origin).collect())
    }

    /// Runs turns until one has nothing left to do (true) or `limit` of them moved something (false). `on_turn` is told of
    /// each that did, in order. Batches of the growth have an even number of turns, so that the labels end where they began.
    ///
    /// Turns are numbered from 1, or on from the last where a refinement goes on: a face remembers the turn that refused it.
    pub(super) fn run(
        &mut self,
        work: Work,
        limit: u32,
        cancel: &Cancel,
        mut on_turn: impl FnMut(&Slot),
    ) -> Result<bool> {
        let resumed_at = self.resumed_at.take().filter(|_| work == Work::Refine);
        // turns that may still move something, those on their way taken off
        let mut left = limit;
        let mut number = resumed_at.unwrap_or(1);
        let mut size = FIRST_BATCH;
        let mut staging = 0;
        let mut before: Option<Batch> = None;
        loop {
            let started = Instant::now();
            let turns = size.min(left);
            let next = if turns > 0 && !cancel.is_cancelled() {
                let batch = self.submit(work, number, turns, staging)?;
                left -= turns;
                number = number.wrapping_add(turns);
                self.next_turn = number;
                Some(batch)
            } else {
                None
            };
            let Some(batch) = before.take() else {
                if next.is_none() {
                    cancel.check()?;
                    return Ok(false);
                }
                before = next;
                staging = 1 - staging;
                continue;
            };
            for slot in self.collect(batch)? {
                if work.is_over(&slot) {
                    if let Some(idle) = next {
                        self.collect(idle)?;
                    }
                    cancel.check()?;
                    return Ok(true);
                }
                if slot.moves == 0 {
                    left += 1;
                } else {
                    self.has_moved = true;
                    self.may_be_cut = true;
                    on_turn(&slot);
                }
            }
            let took = started.elapsed();
            if took < SHORT_BATCH {
                size = (size * 2).min(RING);
            } else if took > LONG_BATCH {
                size = (size / 2).max(2);
            }
            before = next;
            staging = 1 - staging;
        }
    }

    /// Queues a batch, and the reading of its slots.
    fn submit(&self, work: Work, number: u32, turns: u32, staging: usize) -> Result<Batch> {
        let kernels = &self.connection.kernels;
        let bindings = &self.buffers.bindings;
        self.connection.reach(work.fault_point());
        self.buffers.turns.number(&self.connection.queue, number);
        let mut encoder = self.encoder();
        encoder.clear_buffer(&self.buffers.ring, 0, None);
        {
            let mut pass = self.connection.pass(&mut encoder, work.name());
            let clusters = Some(self.buffers.cluster_groups);
            // after a merge the list is what the host asks for moves
            if !self.has_merged {
                self.dispatch(&mut pass, &kernels.weed, &bindings.weed, 0, None);
                self.dispatch(&mut pass, &kernels.line_up, &bindings.line_up, 0, Some([1, 1, 1]));
            }
            for slot in 0..turns {
                let mut dispatch =
                    |compiled, bindings, groups| self.dispatch(&mut pass, compiled, bindings, slot, groups);
                match work {
                    Work::Grow => {
                        dispatch(&kernels.grow, &bindings.grow[slot as usize % 2], None);
                        dispatch(&kernels.settle, &bindings.settle, Some([1, 1, 1]));
                    }
                    Work::Boundary => {
                        dispatch(&kernels.propose, &bindings.propose, None);
                        dispatch(&kernels.apply, &bindings.apply, None);
                        dispatch(&kernels.fit, &bindings.fit, clusters);
                    }
                    Work::Refine => {
                        dispatch(&kernels.bid, &bindings.bid, None);
                        dispatch(&kernels.choose, &bindings.choose, None);
                        dispatch(&kernels.join, &bindings.join, None);
                        dispatch(&kernels.judge, &bindings.judge, clusters);
                        dispatch(&kernels.deal, &bindings.deal, None);
                    }
                }
            }
        }
        self.queue_reading(encoder, turns, staging)
    }

    /// Encodes proxies and energy of the labels as they are, after summing them up and listing the faces on boundaries if that
    /// was not done. Dispatches go over the listed faces afterwards.
    pub(super) fn encode_fit(&mut self) -> wgpu::CommandEncoder {
        let kernels = &self.connection.kernels;
        let buffers = &self.buffers;
        let bindings = &buffers.bindings;
        let mut encoder = self.encoder();
        encoder.clear_buffer(&buffers.ring, 0, None);
        if !self.gathered {
            encoder.clear_buffer(&buffers.clusters, 0, None);
        }
        {
            let mut pass = self.connection.pass(&mut encoder, if self.gathered { "fit" } else { "gather" });
            if !self.gathered {
                self.dispatch(&mut pass, &kernels.gather, &bindings.gather, BETWEEN, Some(buffers.gather_groups));
                self.dispatch(&mut pass, &kernels.enlist, &bindings.enlist, BETWEEN, Some(buffers.face_groups));
                self.dispatch(&mut pass, &kernels.line_up, &bindings.line_up, BETWEEN, Some([1, 1, 1]));
            }
            self.dispatch(&mut pass, &kernels.fit, &bindings.fit, BETWEEN, Some(buffers.cluster_groups));
        }
        self.gathered = true;
        encoder
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.connection.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// Encodes one kernel, with so many workgroups or with as many as the device decides.
    pub(super) fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        compiled: &Compiled,
        bindings: &wgpu::BindGroup,
        slot: u32,
        groups: Option<[u32; 3]>,
    ) {
        self.connection.count(compiled.kernel);
        pass.set_pipeline(&compiled.pipeline);
        pass.set_bind_group(0, bindings, &[self.buffers.turns.offset(slot)]);
        match groups {
            Some([x, y, z]) => pass.dispatch_workgroups(x, y, z),
            None => pass.dispatch_workgroups_indirect(&self.buffers.next_dispatch, 0),
        }
    }

    /// What hierarchies need. An error on a surface that was opened without.
    pub(super) fn merging(&self) -> Result<&Merging> {
        self.merging.as_ref().ok_or_else(|| Error::new(Kind::Internal, "the surface was not opened for merging"))
    }
}

/// What the end of a run means.
fn ending(is_over: bool) -> Ending {
    if is_over { Ending::Converged } else { Ending::IterationLimit }
}

impl Steps for GpuSteps<'_> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        if std::mem::take(&mut self.has_merged) {
            self.living = (0..self.clusters).collect();
            self.buffers.list_clusters(&self.connection.queue, &self.living);
        }
        self.resumed_at = None;
        self.host = None;
        self.replace_labels(labels)
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        let encoder = self.encode_fit();
        self.grow_listed(encoder, cancel)
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        if let Some(energy) = self.energy {
            return Ok(energy);
        }
        let encoder = self.encode_fit();
        let explained = self.read_between(encoder)?.explained();
        Ok(*self.energy.insert(LatticeEnergy { explained }))
    }

    fn optimise_boundary(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        let encoder = self.encode_fit();
        self.connection.queue.submit([encoder.finish()]);
        let mut last = self.energy;
        let outcome = self.run(Work::Boundary, max_iterations, cancel, |slot| {
            let energy = LatticeEnergy { explained: slot.explained() };
            last = Some(energy);
            on_iteration(Step { energy, moves: u64::from(slot.moves) });
        });
        self.energy = last;
        outcome.map(ending)
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_iteration: &mut dyn FnMut(Step)) -> Result<Ending> {
        // the turns only say what it rises by
        let mut explained = self.energy()?.explained;
        // a phase that goes on remembers which clusters changed when
        if self.resumed_at.is_none() {
            let encoder = self.encode_fit();
            self.connection.queue.submit([encoder.finish()]);
        }
        let outcome = self.run(Work::Refine, max_iterations, cancel, |slot| {
            explained += slot.explained();
            on_iteration(Step { energy: LatticeEnergy { explained }, moves: u64::from(slot.moves) });
        });
        self.energy = Some(LatticeEnergy { explained });
        outcome.map(ending)
    }

    /// On the host, by the cpu device: few runs need it, for few moves, and its walks through clusters are no work for a gpu.
    fn refine_connected(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        let before = self.labels()?;
        let origins = if self.has_merged { self.origins(&before)? } else { Vec::new() };
        let goes_on = self.resumed_at.take().is_some();
        let mut host = match self.host.take().filter(|_| goes_on) {
            Some(host) => host,
            None => {
                let mut host = cpu::open(self.graph, self.component_of_cluster);
                host.set_labels(&before)?;
                host
            }
        };
        let ending = host.refine_connected(max_iterations, cancel, on_iteration)?;
        let labels = host.labels()?;
        self.replace_labels(&labels)?;
        upload(&self.connection.queue, &self.buffers.origins, 0, &origins);
        self.host = (ending == Ending::IterationLimit).then_some(host);
        Ok(ending)
    }

    fn resume(&mut self) {
        self.resumed_at = Some(self.next_turn);
        if let Some(host) = &mut self.host {
            host.resume();
        }
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        if !self.may_be_cut {
            return Ok(0);
        }
        let freed = self.free_pieces()?;
        if freed != 0 {
            self.grow_listed(self.encoder(), cancel)?;
        }
        self.may_be_cut = false;
        Ok(freed)
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        self.connection.reach(FaultPoint::Labels);
        Ok(self.download(self.encoder(), &self.buffers.labels, self.buffers.faces as usize)?.1)
    }
}
