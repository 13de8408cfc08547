//! What the host writes to the device.

use std::ops::Range;
use std::sync::mpsc::channel;

use bytemuck::{Pod, cast, cast_slice};

use super::connection::{Connection, InFlight, PATIENCE, Staging};
use super::lock;
use super::pages::Pages;
use crate::energy::Words;
use crate::error::{Error, Result};
use crate::surface::DualGraph;

/// Items that are written at once, so that wgpu's copies of them stay small.
const CHUNK: usize = 1 << 20;

/// Writes items to a buffer.
pub(super) fn upload<T: Pod>(connection: &Connection, buffer: &Pages, items: &[T]) {
    for (at, chunk) in (0..).step_by(CHUNK).zip(items.chunks(CHUNK)) {
        let mut bytes: &[u8] = cast_slice(chunk);
        for (page, first, count) in buffer.parts((at * size_of::<T>()) as u64, bytes.len() as u64) {
            let (part, rest) = bytes.split_at(count as usize);
            connection.queue.write_buffer(page, first, part);
            bytes = rest;
        }
        // wgpu keeps its copy until a submission takes it along
        connection.submit(None);
    }
}

/// Writes faces and their neighbours, through [`Staging`]. Creating a piece may fail for want of memory, which is an
/// error of this call; if a copy of `write_buffer` finds none, the device is lost.
pub(super) fn upload_graph<E: Words>(
    connection: &Connection,
    graph: &DualGraph<E>,
    faces: &Pages,
    neighbours: &Pages,
) -> Result<()> {
    let mut words = Vec::new();
    write(connection, faces, (0, graph.faces()), E::AXES + 1, |range, mut to| {
        words.clear();
        range.for_each(|face| words.extend(E::of_face(graph.face(face))));
        to.copy_from_slice(cast_slice(&words));
    })?;
    upload_rows(connection, neighbours, &graph.neighbours.offsets, 1, &graph.neighbours.items)
}

/// Writes rows of items through [`Staging`]: the index of the first word of each row, and one more index for the end,
/// given as items; then the items, which are some words each.
pub(super) fn upload_rows(
    connection: &Connection,
    target: &Pages,
    offsets: &[u32],
    words: u32,
    items: &[u32],
) -> Result<()> {
    let rows = offsets.len();
    let offset = |row: usize| cast(offsets[row] * words + rows as u32);
    write(connection, target, (0, rows), 1, |range, to| to.write_iter(range.map(offset)))?;
    upload_staged(connection, target, rows, items)
}

/// Writes numbers to a buffer, from number `first` on, through [`Staging`].
pub(super) fn upload_staged(connection: &Connection, target: &Pages, first: usize, numbers: &[u32]) -> Result<()> {
    write(connection, target, (first, numbers.len()), 1, |range, mut to| {
        to.copy_from_slice(cast_slice(&numbers[range]));
    })
}

/// Bytes of a piece of staging memory.
const PIECE: usize = 4 << 20;

/// Pieces that a connection keeps: the host fills one while the device copies from others.
const PIECES: usize = 4;

impl Staging {
    /// A mapped piece.
    fn take(&mut self, connection: &Connection) -> Result<wgpu::Buffer> {
        if let Some(buffer) = self.idle.pop() {
            return Ok(buffer);
        }
        if self.in_flight.len() < PIECES {
            let usage = wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC;
            return connection.buffer("staging", PIECE as u64, usage);
        }
        let Some(InFlight { buffer, submission, mapped }) = self.in_flight.pop_front() else {
            return Err(Error::internal("there is no staging memory"));
        };
        connection.wait(submission)?;
        // another thread may have polled first, and be about to call back
        match mapped.recv_timeout(PATIENCE) {
            Ok(Ok(())) => Ok(buffer),
            Ok(Err(_)) | Err(_) => Err(connection.break_down("its memory could not be mapped again")),
        }
    }

    /// Copies the first bytes of a piece, which is mapped again once that is done.
    fn copy(&mut self, connection: &Connection, buffer: wgpu::Buffer, (target, at): (&Pages, u64), bytes: u64) {
        buffer.unmap();
        let (mut encoder, mut from) = (connection.encoder(), 0);
        for (page, first, count) in target.parts(at, bytes) {
            encoder.copy_buffer_to_buffer(&buffer, from, page, first, count);
            from += count;
        }
        let submission = connection.submit(Some(encoder));
        let (sender, mapped) = channel();
        // the receiver is gone with the connection
        buffer.map_async(wgpu::MapMode::Write, .., move |outcome| drop(sender.send(outcome)));
        self.in_flight.push_back(InFlight { buffer, submission, mapped });
        // those whose mapping an earlier wait has brought
        while self.in_flight.front().is_some_and(|piece| matches!(piece.mapped.try_recv(), Ok(Ok(())))) {
            self.idle.extend(self.in_flight.pop_front().map(|piece| piece.buffer));
        }
    }
}

/// Writes items of some words to a buffer, from item `first` on: `fill` writes chunks of them to mapped memory.
fn write(
    connection: &Connection,
    target: &Pages,
    (first, items): (usize, usize),
    words: usize,
    mut fill: impl FnMut(Range<usize>, wgpu::WriteOnly<'_, [[u8; 4]]>),
) -> Result<()> {
    let size = words * size_of::<u32>();
    let mut staging = lock(&connection.staging);
    for at in (0..items).step_by(PIECE / size) {
        let range = at..items.min(at + PIECE / size);
        let bytes = (range.len() * size) as u64;
        let piece = staging.take(connection)?;
        {
            let unwritable = |_| connection.break_down("its memory could not be written");
            let mut view = piece.get_mapped_range_mut(..bytes).map_err(unwritable)?;
            fill(range, view.slice(..).into_chunks::<4>().0);
        }
        staging.copy(connection, piece, (target, ((first + at) * size) as u64), bytes);
    }
    Ok(())
}
