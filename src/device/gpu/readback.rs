//! How results come back from the device: copies into memory that the host can map, and the wait for them.

use std::sync::mpsc::{Receiver, channel};

use bytemuck::{Pod, pod_collect_to_vec};

use super::FaultPoint;
use super::buffers::{BATCH, Buffer};
use super::connection::PATIENCE;
use super::kernels;
use super::layout::{IterationStats, Move, UNLISTED};
use super::memory::BETWEEN;
use super::state::{GpuSteps, History, Sums};
use super::verify::verify;
use crate::error::Result;

/// Bytes of the statistics of an iteration.
const STATS: u64 = size_of::<IterationStats>() as u64;

/// Moves that are read along with their number; more are read once that is known.
pub(super) const FEW_MOVES: usize = 4096;

/// Statistics of iterations of a batch, and of what is done between batches.
pub(super) type BatchStats = (Vec<IterationStats>, IterationStats);

/// Commands in flight, and a buffer that they copy results to.
pub(super) struct Reading {
    buffer: wgpu::Buffer,
    bytes: u64,
    submission: wgpu::SubmissionIndex,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

impl GpuSteps<'_> {
    /// Submits the commands, and then copies of parts of buffers: the first byte and the number of bytes of each.
    pub(super) fn request(
        &self,
        mut encoder: wgpu::CommandEncoder,
        parts: &[(&wgpu::Buffer, u64, u64)],
    ) -> Result<Reading> {
        let bytes = parts.iter().map(|&(_, _, bytes)| bytes).sum();
        let buffer = self.host_buffer(bytes)?;
        let mut end = 0;
        for &(from, first, bytes) in parts {
            if bytes > 0 {
                encoder.copy_buffer_to_buffer(from, first, &buffer, end, bytes);
                end += bytes;
            }
        }
        let submission = self.connection.queue.submit([encoder.finish()]);
        self.connection.check()?;
        let (sender, mapped) = channel();
        buffer.slice(..bytes).map_async(wgpu::MapMode::Read, move |outcome| {
            // the receiver is gone if another error came first
            let _ = sender.send(outcome);
        });
        Ok(Reading { buffer, bytes, submission, mapped })
    }

    /// Waits for the commands and reads what they copied.
    pub(super) fn read<T>(&self, reading: Reading, look: impl FnOnce(&[u8]) -> T) -> Result<T> {
        let Reading { buffer, bytes, submission, mapped } = reading;
        self.connection.wait(submission)?;
        let unreadable = || self.connection.break_down("its memory could not be read");
        // another thread may have polled first, and be about to call back
        mapped.recv_timeout(PATIENCE).ok().and_then(Result::ok).ok_or_else(unreadable)?;
        let seen = {
            let view = buffer.slice(..bytes).get_mapped_range().map_err(|_| unreadable())?;
            match self.connection.corrupted(&view) {
                Some(wrong) => look(&wrong),
                None => look(&view),
            }
        };
        buffer.unmap();
        self.host_buffers.borrow_mut().push(buffer);
        Ok(seen)
    }

    /// Submits the commands, and reads the statistics of the first iterations of a batch.
    pub(super) fn read_stats(&self, encoder: wgpu::CommandEncoder, iterations: u32) -> Result<Vec<IterationStats>> {
        let stats = (self.memory.get(Buffer::Stats), 0, STATS * u64::from(iterations));
        self.read(self.request(encoder, &[stats])?, pod_collect_to_vec)
    }

    /// The same, with the statistics of what is done between batches and, if clusters have merged, the faces that moved
    /// since: none if there are more than [`FEW_MOVES`]. The first `labelled` faces' labels come along.
    pub(super) fn read_stats_and_moves(
        &self,
        mut encoder: wgpu::CommandEncoder,
        iterations: u32,
        labelled: usize,
    ) -> Result<(BatchStats, Option<Vec<Move>>, Vec<u32>)> {
        let few = match self.history {
            History::Unmerged => 0,
            History::Merged | History::MovedSinceMerge => {
                self.encode(&mut encoder, "moves", &[kernels::MOVES_LIST]);
                FEW_MOVES.min(self.memory.faces() as usize)
            }
        };
        let (stats, batch) = (self.memory.get(Buffer::Stats), STATS * u64::from(iterations));
        let moves = (self.memory.get(Buffer::Moves), 0, (few * size_of::<Move>()) as u64);
        let labels = (self.memory.get(Buffer::Labels), 0, 4 * labelled as u64);
        let parts = [(stats, 0, batch), (stats, STATS * u64::from(BETWEEN), STATS), moves, labels];
        self.read(self.request(encoder, &parts)?, |view| {
            let (batch, rest) = view.split_at(batch as usize);
            let (between, rest) = rest.split_at(STATS as usize);
            let (moves, labels) = rest.split_at(moves.2 as usize);
            let between: IterationStats = bytemuck::pod_read_unaligned(between);
            let listed = between.listed as usize;
            let moves = (listed <= few).then(|| pod_collect_to_vec(&moves[..listed * size_of::<Move>()]));
            ((pod_collect_to_vec(batch), between), moves, pod_collect_to_vec(labels))
        })
    }

    /// Submits the commands, and reads the statistics of what is done between batches.
    pub(super) fn read_between(&self, encoder: wgpu::CommandEncoder) -> Result<IterationStats> {
        Ok(self.download::<u32>(encoder, Buffer::Stats, 0)?.0)
    }

    /// Submits the commands, and reads those statistics and the first items of a buffer.
    pub(super) fn download<T: Pod>(
        &self,
        encoder: wgpu::CommandEncoder,
        buffer: Buffer,
        items: usize,
    ) -> Result<(IterationStats, Vec<T>)> {
        let stats = (self.memory.get(Buffer::Stats), STATS * u64::from(BETWEEN), STATS);
        let items = (self.memory.get(buffer), 0, (items * size_of::<T>()) as u64);
        self.read(self.request(encoder, &[stats, items])?, |view| {
            let (stats, items) = view.split_at(STATS as usize);
            (bytemuck::pod_read_unaligned(stats), pod_collect_to_vec(items))
        })
    }

    /// The labels. Fails with `DeviceWrong` where the energy of the labels is not the one that the device gave.
    pub(super) fn read_labels(&mut self) -> Result<Vec<u32>> {
        match (self.sums, self.known_labels.take()) {
            // they are the host's
            (Sums::Stale, Some(labels)) => return Ok(labels),
            (Sums::Current(Some(energy)), Some(labels)) => {
                verify(&self.connection.name, (self.graph, self.component_of_cluster), &labels, energy)?;
                return Ok(labels);
            }
            (Sums::Current(None), _) | (_, None) => {}
        }
        self.connection.reach(FaultPoint::Labels);
        let encoder = if self.sums == Sums::Current(None) { self.encode_fit() } else { self.encoder() };
        let (stats, labels) = self.download(encoder, Buffer::Labels, self.graph.faces())?;
        if let Sums::Current(energy) = self.sums {
            let energy = energy.unwrap_or_else(|| stats.energy());
            verify(&self.connection.name, (self.graph, self.component_of_cluster), &labels, energy)?;
            self.set_energy(Some(energy));
            self.known_labels = Some(labels.clone());
        }
        Ok(labels)
    }

    /// The labels that all faces had after the last merge; `labels` are the present ones.
    pub(super) fn labels_at_merge(&self, labels: &[u32]) -> Result<Vec<u32>> {
        let (_, at_merge) = self.download::<u32>(self.encoder(), Buffer::LabelAtMerge, labels.len())?;
        let label = |(&before, &label): (&u32, &u32)| if before == UNLISTED { label } else { before };
        Ok(at_merge.iter().zip(labels).map(label).collect())
    }

    /// A buffer of at least `bytes` that the host can read, and room for all statistics. [`read`](Self::read) keeps it
    /// for the next request; one that is too small is dropped, so there are no more than were in flight.
    fn host_buffer(&self, bytes: u64) -> Result<wgpu::Buffer> {
        let mut kept = self.host_buffers.borrow_mut();
        if let Some(at) = kept.iter().position(|buffer| buffer.size() >= bytes) {
            return Ok(kept.swap_remove(at));
        }
        kept.pop();
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        self.connection.buffer("results for the host", bytes.max(STATS * u64::from(BATCH)), usage)
    }
}
