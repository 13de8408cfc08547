//! How results come back from the device: copies into memory that the host can map, and the wait for them.

use std::ops::Range;
use std::sync::mpsc::{Receiver, channel};

use bytemuck::{Pod, pod_collect_to_vec};

use super::buffers::{BATCH, Buffer};
use super::connection::PATIENCE;
use super::layout::IterationStats;
use super::memory::BETWEEN;
use super::steps::GpuSteps;
use crate::error::Result;

/// Bytes of the statistics of an iteration.
const STATS: u64 = size_of::<IterationStats>() as u64;

/// Commands in flight, and a buffer that they copy results to.
pub(super) struct Reading {
    buffer: wgpu::Buffer,
    bytes: u64,
    submission: wgpu::SubmissionIndex,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

impl GpuSteps<'_> {
    /// Submits the commands, and then copies of parts of buffers: the first byte and the number of bytes of each.
    fn request(&self, mut encoder: wgpu::CommandEncoder, parts: &[(&wgpu::Buffer, u64, u64)]) -> Result<Reading> {
        let bytes = parts.iter().map(|&(_, _, bytes)| bytes).sum();
        let buffer = self.host_buffer(bytes)?;
        let mut end = 0;
        for &(from, first, bytes) in parts {
            encoder.copy_buffer_to_buffer(from, first, &buffer, end, bytes);
            end += bytes;
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
    fn read<T>(&self, reading: Reading, look: impl FnOnce(&[u8]) -> T) -> Result<T> {
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

    /// Submits the commands, and then a copy of the statistics of some iterations.
    pub(super) fn request_stats(&self, encoder: wgpu::CommandEncoder, slots: Range<u32>) -> Result<Reading> {
        let (first, slots) = (u64::from(slots.start), u64::from(slots.end - slots.start));
        self.request(encoder, &[(self.memory.get(Buffer::Stats), STATS * first, STATS * slots)])
    }

    /// Waits for statistics.
    pub(super) fn read_stats(&self, reading: Reading) -> Result<Vec<IterationStats>> {
        self.read(reading, pod_collect_to_vec)
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
