//! How results come back from the device: copies into memory that the host can map, and the wait for them.
//!
//! What the next call is likely to need comes along with what a call reads, since a wait costs more than some thousand
//! bytes.

use std::cell::Cell;
use std::mem::offset_of;
use std::sync::mpsc::channel;

use bytemuck::{Pod, pod_collect_to_vec};

use super::FaultPoint;
use super::buffers::{BATCH, Buffer};
use super::connection::{Connection, PATIENCE};
use super::kernels;
use super::layout::{BoundaryList, IterationStats, Move};
use super::memory::BETWEEN;
use super::pages::PagePart;
use super::state::{GpuSteps, History, Search};
use crate::energy::Words;
use crate::error::Result;

/// Moves that are read along with their number: as many bytes as cross the bus in a wait.
const FEW_MOVES: usize = 1 << 13;

/// Bytes that the host reads at a time, at most: those of the labels of 64 million faces.
const MOST_READ: usize = 1 << 28;

/// What a submission ends with, and the host reads with its statistics.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Along {
    /// Iterations whose statistics are read.
    pub iterations: u32,
    /// If clusters have merged, the faces that moved since, [`FEW_MOVES`] at most.
    pub moves: bool,
    /// The labels.
    pub labels: bool,
    /// A search for dual edges, for which the submission has begun.
    pub search: Option<Search>,
}

/// Statistics.
pub(super) struct Read {
    /// Of the iterations.
    pub batch: Vec<IterationStats>,
    /// Of what was done between batches.
    pub between: IterationStats,
    /// Of what was done before.
    pub before: IterationStats,
}

/// A part of a buffer: the first byte, and their number.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    buffer: Buffer,
    first: usize,
    bytes: usize,
}

impl Part {
    /// So many items from one on.
    pub(super) fn of<T>(buffer: Buffer, first: usize, items: usize) -> Self {
        Self { buffer, first: first * size_of::<T>(), bytes: items * size_of::<T>() }
    }
}

/// Parts of buffers as the host sees them, one after the other.
pub(super) struct Parts<'a> {
    view: &'a [u8],
    parts: std::slice::Iter<'a, Part>,
}

impl Parts<'_> {
    /// The items of the next part.
    pub(super) fn next<T: Pod>(&mut self) -> Vec<T> {
        let bytes = self.parts.next().map_or(0, |part| part.bytes);
        let (part, rest) = self.view.split_at(bytes);
        self.view = rest;
        pod_collect_to_vec(part)
    }
}

/// Submits the commands, waits for them, and reads parts of buffers, one after the other: the first byte of each, and
/// their number. `kept` is memory that the host reads through.
pub(super) fn read<T>(
    connection: &Connection,
    kept: &Cell<Option<wgpu::Buffer>>,
    mut encoder: wgpu::CommandEncoder,
    parts: &[PagePart<'_>],
    look: impl FnOnce(&[u8]) -> T,
) -> Result<T> {
    let bytes = parts.iter().map(|part| part.2).sum();
    let buffer = match kept.take().filter(|buffer| buffer.size() >= bytes) {
        Some(buffer) => buffer,
        None => {
            let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
            let least = size_of::<IterationStats>() as u64 * u64::from(BATCH);
            connection.buffer("results for the host", bytes.max(least), usage)?
        }
    };
    let mut end = 0;
    for &(from, first, bytes) in parts.iter().filter(|part| part.2 > 0) {
        encoder.copy_buffer_to_buffer(from, first, &buffer, end, bytes);
        end += bytes;
    }
    let submission = connection.submit(Some(encoder));
    connection.check()?;
    let (sender, mapped) = channel();
    buffer.slice(..bytes).map_async(wgpu::MapMode::Read, move |outcome| {
        // the receiver is gone if another error came first
        let _ = sender.send(outcome);
    });
    connection.wait(submission)?;
    let unreadable = || connection.break_down("its memory could not be read");
    // another thread may have polled first, and be about to call back
    mapped.recv_timeout(PATIENCE).ok().and_then(Result::ok).ok_or_else(unreadable)?;
    let seen = {
        let view = buffer.slice(..bytes).get_mapped_range().map_err(|_| unreadable())?;
        let wrong = connection.corrupted(&view);
        look(wrong.as_deref().unwrap_or(&view))
    };
    buffer.unmap();
    kept.set(Some(buffer));
    Ok(seen)
}

impl<E: Words> GpuSteps<'_, E> {
    /// Submits the commands, waits for them, and reads parts of buffers.
    pub(super) fn read<T>(
        &self,
        encoder: wgpu::CommandEncoder,
        parts: &[Part],
        look: impl FnOnce(Parts<'_>) -> T,
    ) -> Result<T> {
        let place = |part: &Part| self.memory.get(part.buffer).parts(part.first as u64, part.bytes as u64);
        let places: Vec<_> = parts.iter().flat_map(place).collect();
        let look = |view: &[u8]| look(Parts { view, parts: parts.iter() });
        read(&self.connection, &self.host_buffer, encoder, &places, look)
    }

    /// Bytes that the host reads at a time: no more than a binding has, so that lowered limits test it.
    fn most_read(&self) -> usize {
        (self.connection.bindings.bytes as usize).min(MOST_READ)
    }

    /// Reads the first items of a buffer, some at a time.
    pub(super) fn download<T: Pod>(&self, buffer: Buffer, items: usize) -> Result<Vec<T>> {
        let (mut read, most) = (Vec::new(), self.most_read() / size_of::<T>());
        while read.len() < items {
            let part = Part::of::<T>(buffer, read.len(), most.min(items - read.len()));
            let more = self.read(self.connection.encoder(), &[part], |mut parts| parts.next())?;
            if read.is_empty() {
                read = more;
            } else {
                read.extend(more);
            }
        }
        Ok(read)
    }

    /// Submits the commands, with what is read along. What the host then knows besides statistics is in
    /// [`known`](Self::known).
    pub(super) fn fetch(&mut self, mut encoder: wgpu::CommandEncoder, along: Along) -> Result<Read> {
        let faces = self.graph.faces();
        let mut few_moves = 0;
        if along.moves && self.known.history != History::Unmerged {
            self.encode(&mut encoder, "moves", &[kernels::MOVES_LIST], BETWEEN);
            few_moves = FEW_MOVES.min(faces);
        }
        if let Some(search) = along.search {
            self.connection.reach(FaultPoint::DualEdges);
            self.encode(&mut encoder, "merge", search.kernels(), BETWEEN);
        }
        let has_labels = along.labels && size_of::<u32>() * faces <= self.most_read();
        if along.labels {
            self.connection.reach(FaultPoint::Labels);
        }
        let length = offset_of!(BoundaryList, lengths) / size_of::<u32>() + self.memory.half();
        let mut parts = vec![
            Part::of::<u32>(Buffer::BoundaryList, length, 1),
            Part::of::<Move>(Buffer::Moves, 0, few_moves),
            Part::of::<IterationStats>(Buffer::Stats, BETWEEN as usize, 2),
            Part::of::<IterationStats>(Buffer::Stats, 0, along.iterations as usize),
            Part::of::<u32>(Buffer::Labels, 0, if has_labels { faces } else { 0 }),
        ];
        parts.extend(along.search.into_iter().flat_map(|search| self.parts(search)));
        let (listed, mut moves, between, batch, labels, found) = self.read(encoder, &parts, |mut parts| {
            let (listed, moves) = (parts.next::<u32>(), parts.next::<Move>());
            let (between, batch) = (parts.next::<IterationStats>(), parts.next());
            (listed, moves, between, batch, parts.next(), along.search.map(|search| self.found(search, &mut parts)))
        })?;
        self.memory.listed = listed[0];
        let (between, before) = (between[0], between[1]);
        if few_moves > 0 {
            moves.truncate(between.entries as usize);
            self.known.moves = Some((moves, between.entries as usize));
        }
        if along.labels {
            self.known.labels = Some(if has_labels { labels } else { self.download(Buffer::Labels, faces)? });
        }
        if let (Some(search), Some((found, sums))) = (along.search, found) {
            self.known.found = Some((search, found));
            self.known.sums = sums;
        }
        Ok(Read { batch, between, before })
    }
}
