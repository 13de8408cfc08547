//! Pieces that clusters have fallen into, and the growth of clusters over free faces.

use super::FaultPoint;
use super::buffers::{BETWEEN, Buffers};
use super::steps::{GpuSteps, Work};
use crate::device::{Cancel, LatticeEnergy};
use crate::error::Result;

impl GpuSteps<'_> {
    /// Grows the clusters over the free faces, which are listed after what is encoded.
    pub(super) fn grow_listed(&mut self, mut encoder: wgpu::CommandEncoder, cancel: &Cancel) -> Result<()> {
        let Buffers { faces, labels, wishes, .. } = &self.buffers;
        // passes go from one to the other and back, and look at listed faces only
        encoder.copy_buffer_to_buffer(labels, 0, wishes, 0, Some(4 * u64::from(*faces)));
        self.connection.queue.submit([encoder.finish()]);
        self.energy = None;
        // every pass but the last labels a face
        let even_limit = u32::MAX - 1;
        self.run(Work::Grow, even_limit, cancel, |_| {})?;
        Ok(())
    }

    /// Frees the faces outside of the largest piece of each cluster; they are listed then. Returns how many.
    pub(super) fn free_pieces(&mut self) -> Result<u64> {
        self.connection.reach(FaultPoint::Pieces);
        let mut encoder = self.encode_fit();
        {
            let kernels = &self.connection.kernels;
            let Buffers { bindings, face_groups, gather_groups, .. } = &self.buffers;
            let mut pass = self.connection.pass(&mut encoder, "pieces");
            for (compiled, bindings, groups) in [
                (&kernels.link, &bindings.link, face_groups),
                (&kernels.hook, &bindings.hook, face_groups),
                (&kernels.weigh, &bindings.weigh, gather_groups),
                (&kernels.elect, &bindings.elect, face_groups),
                (&kernels.cut, &bindings.cut, face_groups),
                (&kernels.settle, &bindings.settle, &[1, 1, 1]),
            ] {
                self.dispatch(&mut pass, compiled, bindings, BETWEEN, Some(*groups));
            }
        }
        let slot = self.read_between(encoder)?;
        if slot.moves == 0 {
            self.energy = Some(LatticeEnergy { explained: slot.explained() });
        }
        Ok(u64::from(slot.moves))
    }
}
