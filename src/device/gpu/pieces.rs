//! Pieces of clusters on the device. Labels come along with the result where a run is likely to end with it.

use super::FaultPoint;
use super::buffers::Buffer;
use super::kernels;
use super::state::{GpuSteps, Sums};
use crate::error::Result;

impl GpuSteps<'_> {
    /// Frees and lists the faces outside of the largest piece of each cluster. Returns their number.
    pub(super) fn detach_pieces(&mut self) -> Result<u64> {
        self.connection.reach(FaultPoint::Pieces);
        self.forget();
        let known = if let Sums::Current(energy) = self.sums { energy } else { None };
        let mut encoder = if known.is_some() { self.encoder_without_stats() } else { self.encode_fit() };
        encoder.clear_buffer(self.memory.get(Buffer::LargestPieces), 0, None);
        let search = [
            kernels::PIECE_LINK,
            kernels::PIECE_UNION,
            kernels::PIECE_SIZE,
            kernels::PIECE_SELECT_LARGEST,
            kernels::PIECE_DETACH,
            kernels::BOUNDARY_COVER,
        ];
        self.encode(&mut encoder, "pieces", &search);
        let along = Some(self.graph.faces())
            .filter(|&faces| self.was_unlimited && faces <= self.connection.tuning.labels_along as usize);
        if along.is_some() {
            self.connection.reach(FaultPoint::Labels);
        }
        let ((_, stats), moves, labels) = self.read_stats_and_moves(encoder, 0, along.unwrap_or(0))?;
        let has_freed = stats.moves != 0;
        self.is_fitted &= !has_freed;
        if !has_freed {
            self.set_energy(Some(known.unwrap_or_else(|| stats.energy())));
            self.moves = moves;
            self.known_labels = along.map(|_| labels);
        }
        self.has_free = has_freed;
        self.is_repaired |= has_freed;
        Ok(stats.moves.into())
    }
}
