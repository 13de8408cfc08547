//! What never changes of a surface: centroids and weights of its faces, and which faces are beside which. That is what is
//! brought to the device when the surface is opened; all else is made there.
//!
//! It goes through buffers that the host maps, filled in place. Making one of those may fail for want of memory like making
//! any buffer ([`Connection::buffer`]); wgpu's own copies, that `write_buffer` makes, take the device with them then.

use std::ops::Range;

use bytemuck::{cast, cast_slice};

use super::buffers::create;
use super::connection::Connection;
use super::layout::Face;
use crate::error::Result;
use crate::surface::DualGraph;

/// Items that are brought at once.
const PIECE: usize = 1 << 20;

/// Centroids and weights, and neighbours, on the device.
#[derive(Debug)]
pub(super) struct Fixed {
    /// A [`Face`] each.
    pub(super) faces: wgpu::Buffer,
    /// Where those of each face begin, and one past the last, and then they.
    pub(super) neighbours: wgpu::Buffer,
}

impl Fixed {
    /// Brings it to the device.
    pub(super) fn bring(connection: &Connection, graph: &DualGraph) -> Result<Self> {
        let (faces, neighbours) = (graph.centroids.len(), graph.neighbours.len());
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let begin = faces + 1;
        let fixed = Self {
            faces: create(connection, "faces", (faces * size_of::<Face>()) as u64, storage)?,
            neighbours: create(connection, "neighbours", 4 * (begin + neighbours) as u64, storage)?,
        };
        let face = |face: usize| -> Face {
            let [x, y, z] = graph.centroids[face];
            [x, y, z, graph.weights[face].cast_signed()]
        };
        bring(connection, &fixed.faces, (0, faces), |range, to: To<'_, 16>| to.write_iter(range.map(face).map(cast)))?;
        let offset = |face: usize| graph.neighbour_offsets[face] + begin as u32;
        bring(connection, &fixed.neighbours, (0, begin), |range, to: To<'_, 4>| {
            to.write_iter(range.map(offset).map(cast));
        })?;
        bring(connection, &fixed.neighbours, (begin, neighbours), |range, mut to: To<'_, 4>| {
            to.copy_from_slice(cast_slice(&graph.neighbours[range]));
        })?;
        Ok(fixed)
    }
}

/// Memory of the device, for items of so many bytes.
type To<'a, const N: usize> = wgpu::WriteOnly<'a, [[u8; N]]>;

/// Writes items to a buffer, from the `first` on, in pieces: `fill` is told which of them go where.
fn bring<const N: usize>(
    connection: &Connection,
    target: &wgpu::Buffer,
    (first, items): (usize, usize),
    mut fill: impl FnMut(Range<usize>, To<'_, N>),
) -> Result<()> {
    for at in (0..items).step_by(PIECE) {
        let range = at..items.min(at + PIECE);
        let bytes = (range.len() * N) as u64;
        let piece = connection.buffer(&wgpu::BufferDescriptor {
            label: Some("for the device"),
            size: bytes,
            usage: wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: true,
        })?;
        {
            let unwritable = |_| connection.break_down("its memory could not be written");
            let mut view = piece.get_mapped_range_mut(..).map_err(unwritable)?;
            fill(range, view.slice(..).into_chunks::<N>().0);
        }
        piece.unmap();
        let mut encoder = connection.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&piece, 0, target, ((first + at) * N) as u64, bytes);
        connection.queue.submit([encoder.finish()]);
    }
    Ok(())
}
