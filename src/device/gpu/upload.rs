//! What the host writes to the device.
//!
//! `write_buffer` does it: staging memory that is used again was slower on an H200 and in software
//! (`benches/results/2026-11-27-nvidia-h200`).

use bytemuck::{Pod, cast_slice};

use super::connection::Connection;
use crate::energy::Words;
use crate::surface::DualGraph;

/// Words that are written at once, so that wgpu's copies of them stay small.
const CHUNK: usize = 1 << 20;

/// Writes items to a buffer.
pub(super) fn upload<T: Pod>(connection: &Connection, buffer: &wgpu::Buffer, items: &[T]) {
    upload_from(connection, buffer, 0, cast_slice(items));
}

/// Writes words to a buffer, from word `first` on.
fn upload_from(connection: &Connection, buffer: &wgpu::Buffer, first: usize, words: &[u32]) {
    for (at, chunk) in (first..).step_by(CHUNK).zip(words.chunks(CHUNK)) {
        connection.queue.write_buffer(buffer, (at * size_of::<u32>()) as u64, cast_slice(chunk));
        // wgpu keeps its copy until a submission takes it along
        connection.submit(None);
    }
}

/// Writes faces and their neighbours.
pub(super) fn upload_graph<E: Words>(
    connection: &Connection,
    graph: &DualGraph<E>,
    faces: &wgpu::Buffer,
    neighbours: &wgpu::Buffer,
) {
    let words = E::AXES + 1;
    let mut chunk = Vec::with_capacity(CHUNK);
    for first in (0..graph.faces()).step_by(CHUNK / words) {
        let end = graph.faces().min(first + CHUNK / words);
        chunk.clear();
        (first..end).for_each(|face| chunk.extend(E::of_face(graph.face(face))));
        upload_from(connection, faces, first * words, &chunk);
    }
    upload_rows(connection, neighbours, &graph.neighbours.offsets, 1, &graph.neighbours.items);
}

/// Writes rows of items: the index of the first word of each row, and one more index for the end, given as items; then
/// the items, which are some words each.
pub(super) fn upload_rows(connection: &Connection, target: &wgpu::Buffer, offsets: &[u32], words: u32, items: &[u32]) {
    let rows = offsets.len();
    for (at, offsets) in (0..).step_by(CHUNK).zip(offsets.chunks(CHUNK)) {
        let chunk: Vec<u32> = offsets.iter().map(|offset| offset * words + rows as u32).collect();
        upload_from(connection, target, at, &chunk);
    }
    upload_from(connection, target, rows, items);
}
