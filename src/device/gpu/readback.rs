//! How results come back from the device: copies into memory that the host can map, and the wait for them.
//!
//! That is one buffer, which grows to the largest result, and two for the ring.

use std::sync::mpsc::{Receiver, channel};

use bytemuck::Pod;

use super::buffers::{BETWEEN, RING};
use super::connection::PATIENCE;
use super::layout::Slot;
use super::steps::GpuSteps;
use crate::error::Result;

/// Is told when a buffer has been mapped.
type Mapped = Receiver<Result<(), wgpu::BufferAsyncError>>;

/// A batch on its way.
pub(super) struct Batch {
    turns: u32,
    staging: usize,
    submission: wgpu::SubmissionIndex,
    mapped: Mapped,
}

impl GpuSteps<'_> {
    /// Submits what is encoded, and then a copy of the ring that the host can read.
    pub(super) fn queue_reading(&self, mut encoder: wgpu::CommandEncoder, turns: u32, staging: usize) -> Result<Batch> {
        let target = &self.buffers.staging[staging];
        encoder.copy_buffer_to_buffer(&self.buffers.ring, 0, target, 0, None);
        let submission = self.connection.queue.submit([encoder.finish()]);
        self.connection.check()?;
        Ok(Batch { turns, staging, submission, mapped: map(target.slice(..)) })
    }

    /// Waits for a batch and reads its slots; the last one is the state between batches.
    pub(super) fn collect(&self, batch: Batch) -> Result<Vec<Slot>> {
        let target = self.buffers.staging[batch.staging].slice(..);
        let mut slots: Vec<Slot> = self.read(target, batch.submission, &batch.mapped, bytemuck::pod_collect_to_vec)?;
        slots.truncate(batch.turns as usize);
        Ok(slots)
    }

    /// Submits what is encoded, and reads the state between batches.
    pub(super) fn read_between(&self, encoder: wgpu::CommandEncoder) -> Result<Slot> {
        let batch = self.queue_reading(encoder, RING + 1, 0)?;
        let slots = self.collect(batch)?;
        Ok(slots[BETWEEN as usize])
    }

    /// Submits what is encoded, and reads the state between batches and the first items of a buffer as they are then.
    pub(super) fn download<T: Pod>(
        &self,
        mut encoder: wgpu::CommandEncoder,
        buffer: &wgpu::Buffer,
        items: usize,
    ) -> Result<(Slot, Vec<T>)> {
        let slot_bytes = size_of::<Slot>();
        let bytes = (items * size_of::<T>()) as u64;
        let staging = self.host_buffer(slot_bytes as u64 + bytes)?;
        let target = staging.slice(..slot_bytes as u64 + bytes);
        let slot_at = u64::from(BETWEEN) * slot_bytes as u64;
        encoder.copy_buffer_to_buffer(&self.buffers.ring, slot_at, &staging, 0, slot_bytes as u64);
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, slot_bytes as u64, bytes);
        let submission = self.connection.queue.submit([encoder.finish()]);
        self.connection.check()?;
        let mapped = map(target);
        let read = self.read(target, submission, &mapped, |view| {
            let (slot, items) = view.split_at(slot_bytes);
            (bytemuck::pod_read_unaligned(slot), bytemuck::pod_collect_to_vec(items))
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

    /// Waits for a submission and a mapping after it, and looks into what is mapped.
    fn read<T>(
        &self,
        target: wgpu::BufferSlice<'_>,
        submission: wgpu::SubmissionIndex,
        mapped: &Mapped,
        look: impl FnOnce(&[u8]) -> T,
    ) -> Result<T> {
        self.connection.wait(submission)?;
        let unreadable = || self.connection.break_down("its memory could not be read");
        // who polls first calls back: maybe another thread, which is about to
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

/// Asks for part of a buffer to be mapped as soon as what was submitted so far is done.
fn map(target: wgpu::BufferSlice<'_>) -> Mapped {
    let (sender, receiver) = channel();
    target.map_async(wgpu::MapMode::Read, move |outcome| {
        // nobody listens any more when another error came first
        let _ = sender.send(outcome);
    });
    receiver
}
