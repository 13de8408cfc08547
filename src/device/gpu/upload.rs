//! What the host writes to the device.

use std::ops::Range;

use bytemuck::{Pod, cast, cast_slice};

use super::connection::Connection;
use crate::energy::Item;
use crate::error::Result;
use crate::surface::DualGraph;

/// Items that are written at once, so that wgpu's copies of them stay small.
const CHUNK: usize = 1 << 20;

/// Writes items to a buffer, from item `first` on.
pub(super) fn upload<T: Pod>(queue: &wgpu::Queue, buffer: &wgpu::Buffer, first: usize, items: &[T]) {
    let mut at = first * size_of::<T>();
    for chunk in items.chunks(CHUNK) {
        let bytes: &[u8] = cast_slice(chunk);
        queue.write_buffer(buffer, at as u64, bytes);
        // wgpu keeps its copy until a submission takes it along
        queue.submit([]);
        at += bytes.len();
    }
}

/// Writes faces and their neighbours, through buffers that the host maps. Creating one of those may fail for want of
/// memory, which is an error of this call; if a copy of `write_buffer` finds none, the device is lost.
pub(super) fn upload_graph(
    connection: &Connection,
    graph: &DualGraph,
    faces: &wgpu::Buffer,
    neighbours: &wgpu::Buffer,
) -> Result<()> {
    let rows = graph.faces() + 1;
    write(connection, faces, (0, rows - 1), |range, to: To<'_, { size_of::<Item>() }>| {
        to.write_iter(range.map(|face| cast(graph.face(face))));
    })?;
    let offset = |face: usize| graph.neighbour_offsets[face] + rows as u32;
    write(connection, neighbours, (0, rows), |range, to: To<'_, 4>| to.write_iter(range.map(offset).map(cast)))?;
    write(connection, neighbours, (rows, graph.neighbours.len()), |range, mut to: To<'_, 4>| {
        to.copy_from_slice(cast_slice(&graph.neighbours[range]));
    })
}

/// Mapped memory for items of `N` bytes.
type To<'a, const N: usize> = wgpu::WriteOnly<'a, [[u8; N]]>;

/// Writes items to a buffer, from item `first` on, in chunks that `fill` provides.
fn write<const N: usize>(
    connection: &Connection,
    target: &wgpu::Buffer,
    (first, items): (usize, usize),
    mut fill: impl FnMut(Range<usize>, To<'_, N>),
) -> Result<()> {
    for at in (0..items).step_by(CHUNK) {
        let range = at..items.min(at + CHUNK);
        let bytes = (range.len() * N) as u64;
        let chunk = connection.buffer("upload", bytes, wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC)?;
        {
            let unwritable = |_| connection.break_down("its memory could not be written");
            let mut view = chunk.get_mapped_range_mut(..).map_err(unwritable)?;
            fill(range, view.slice(..).into_chunks::<N>().0);
        }
        chunk.unmap();
        let mut encoder = connection.encoder();
        encoder.copy_buffer_to_buffer(&chunk, 0, target, ((first + at) * N) as u64, bytes);
        connection.queue.submit([encoder.finish()]);
    }
    Ok(())
}
