//! How results come back from the device: copies into memory that the host can map, and the wait for them.
//!
//! That is one buffer, which grows to the largest result, and two for the statistics of batches in flight.

use std::sync::mpsc::{Receiver, channel};

use bytemuck::Pod;

use super::buffers::{BATCH, Buffer};
use super::connection::PATIENCE;
use super::layout::IterationStats;
use super::memory::BETWEEN;
use super::steps::GpuSteps;
use crate::error::Result;

/// Receives the outcome of a mapping.
type Mapped = Receiver<Result<(), wgpu::BufferAsyncError>>;

/// A batch in flight.
pub(super) struct Batch {
    iterations: u32,
    staging: usize,
    submission: wgpu::SubmissionIndex,
    mapped: Mapped,
}

impl GpuSteps<'_> {
    /// Submits the commands, and then a copy of the statistics for the host.
    pub(super) fn queue_reading(
        &self,
        mut encoder: wgpu::CommandEncoder,
        iterations: u32,
        staging: usize,
    ) -> Result<Batch> {
        let target = &self.memory.staging[staging];
        encoder.copy_buffer_to_buffer(self.memory.get(Buffer::Stats), 0, target, 0, None);
        let submission = self.connection.queue.submit([encoder.finish()]);
        self.connection.check()?;
        Ok(Batch { iterations, staging, submission, mapped: map(target.slice(..)) })
    }

    /// Waits for a batch and reads the statistics of its iterations.
    pub(super) fn collect(&self, batch: Batch) -> Result<Vec<IterationStats>> {
        let target = self.memory.staging[batch.staging].slice(..);
        let mut all: Vec<IterationStats> =
            self.read(target, batch.submission, &batch.mapped, bytemuck::pod_collect_to_vec)?;
        all.truncate(batch.iterations as usize);
        Ok(all)
    }

    /// Submits the commands, and reads the statistics of what was done between batches.
    pub(super) fn read_between(&self, encoder: wgpu::CommandEncoder) -> Result<IterationStats> {
        let batch = self.queue_reading(encoder, BATCH + 1, 0)?;
        let all = self.collect(batch)?;
        Ok(all[BETWEEN as usize])
    }

    /// Submits the commands, and reads those statistics and the first items of a buffer.
    pub(super) fn download<T: Pod>(
        &self,
        mut encoder: wgpu::CommandEncoder,
        buffer: &wgpu::Buffer,
        items: usize,
    ) -> Result<(IterationStats, Vec<T>)> {
        let stats_bytes = size_of::<IterationStats>();
        let bytes = (items * size_of::<T>()) as u64;
        let staging = self.host_buffer(stats_bytes as u64 + bytes)?;
        let target = staging.slice(..stats_bytes as u64 + bytes);
        let stats_at = u64::from(BETWEEN) * stats_bytes as u64;
        encoder.copy_buffer_to_buffer(self.memory.get(Buffer::Stats), stats_at, &staging, 0, stats_bytes as u64);
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, stats_bytes as u64, bytes);
        let submission = self.connection.queue.submit([encoder.finish()]);
        self.connection.check()?;
        let mapped = map(target);
        let read = self.read(target, submission, &mapped, |view| {
            let (stats, items) = view.split_at(stats_bytes);
            (bytemuck::pod_read_unaligned(stats), bytemuck::pod_collect_to_vec(items))
        })?;
        self.host_buffer.set(Some(staging));
        Ok(read)
    }

    /// A buffer of at least `bytes` that the host can read. Goes back to `host_buffer` after use, unmapped.
    fn host_buffer(&self, bytes: u64) -> Result<wgpu::Buffer> {
        if let Some(kept) = self.host_buffer.take().filter(|buffer| buffer.size() >= bytes) {
            return Ok(kept);
        }
        self.connection.buffer(&wgpu::BufferDescriptor {
            label: Some("results for the host"),
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Waits for a submission and a mapping after it, and reads what is mapped.
    fn read<T>(
        &self,
        target: wgpu::BufferSlice<'_>,
        submission: wgpu::SubmissionIndex,
        mapped: &Mapped,
        look: impl FnOnce(&[u8]) -> T,
    ) -> Result<T> {
        self.connection.wait(submission)?;
        let unreadable = || self.connection.break_down("its memory could not be read");
        // another thread may have polled first, and be about to call back
        match mapped.recv_timeout(PATIENCE) {
            Ok(Ok(())) => {}
            Ok(Err(_)) | Err(_) => return Err(unreadable()),
        }
        let seen = {
            let view = target.get_mapped_range().map_err(|_| unreadable())?;
            look(&view)
        };
        target.buffer().unmap();
        Ok(seen)
    }
}

/// Maps part of a buffer once all submissions so far have completed.
fn map(target: wgpu::BufferSlice<'_>) -> Mapped {
    let (sender, receiver) = channel();
    target.map_async(wgpu::MapMode::Read, move |outcome| {
        // the receiver is gone if another error came first
        let _ = sender.send(outcome);
    });
    receiver
}
