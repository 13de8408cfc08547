//! Pieces that clusters have fallen into, and the growth of clusters over free faces.
//!
//! A flat clustering looks for pieces once a phase, among all faces. A hierarchy does so in each round, when most clusters have
//! lost a face (nine in ten have on the bunny, from 1,000 clusters to the top). Where clusters are large and few faces moved it
//! looks at listed faces only: those on boundaries, and those around faces that moved since the last merge, before which all
//! clusters were whole. A piece that is listed as a whole is known; that the others of a cluster are one follows from what was
//! there before (`shaders/doubt.wgsl`). Where it does not, the device itself goes over all faces.

use super::FaultPoint;
use super::buffers::{BETWEEN, Buffers};
use super::merging::{MaybeMerging, Merging};
use super::steps::{GpuSteps, Work};
use crate::device::{Cancel, LatticeEnergy};
use crate::error::Result;

/// Faces of the mesh for each cluster, and for each face that moved, from which on pieces are looked for among listed faces.
/// Below, those are hardly fewer than all, and looking at all takes fewer dispatches. (The bunny at 16 clusters, 5,600 faces
/// listed and 2,100 moves, on llvmpipe: 62 ms among listed faces, 40 ms among all 69,451.)
const LARGE: u64 = 64;

impl<M: MaybeMerging> GpuSteps<'_, M> {
    /// Grows the clusters over the free faces, which are listed after what is encoded.
    pub(super) fn grow_listed(&mut self, mut encoder: wgpu::CommandEncoder, cancel: &Cancel) -> Result<()> {
        let Buffers { faces, labels, wishes, .. } = &self.buffers;
        // passes go from one to the other and back, and look at listed faces only
        if self.are_behind
            && let Some(merging) = self.merging.merging()
        {
            let kernels = self.connection.merge_kernels()?;
            let mut pass = self.connection.pass(&mut encoder, "grow");
            self.dispatch(&mut pass, &kernels.mirror, &merging.bindings.mirror, BETWEEN, None);
        } else {
            encoder.copy_buffer_to_buffer(labels, 0, wishes, 0, Some(4 * u64::from(*faces)));
        }
        self.connection.queue.submit([encoder.finish()]);
        self.energy = None;
        // every pass but the last labels a face
        let even_limit = u32::MAX - 1;
        self.run(Work::Grow, even_limit, cancel, |_| {})?;
        Ok(())
    }

    /// Whether clusters have become so large that few faces are listed.
    pub(super) fn are_large(&self) -> bool {
        let faces = LARGE * self.living.len() as u64;
        faces <= u64::from(self.buffers.faces) || self.connection.always_near
    }

    /// Frees the faces outside of the largest piece of each cluster; they are listed then. Returns how many.
    pub(super) fn free_pieces(&mut self) -> Result<u64> {
        self.connection.reach(FaultPoint::Pieces);
        let are_few = LARGE * self.moves <= u64::from(self.buffers.faces) || self.connection.always_near;
        let is_near = self.has_merged && self.merged_whole && self.are_large() && are_few;
        self.buffers.search(&self.connection.queue, !is_near);
        let mut encoder = self.encode_fit();
        match self.merging.merging() {
            Some(merging) if is_near => self.encode_search_near(merging, &mut encoder)?,
            _ => self.encode_search(&mut encoder)?,
        }
        let slot = self.read_between(encoder)?;
        if slot.moves == 0 {
            self.energy = Some(LatticeEnergy { explained: slot.explained() });
        }
        Ok(u64::from(slot.moves))
    }

    /// Encodes the search among all faces.
    fn encode_search(&self, encoder: &mut wgpu::CommandEncoder) -> Result<()> {
        let kernels = &self.connection.kernels;
        let Buffers { bindings, face_groups, gather_groups, .. } = &self.buffers;
        let mut pass = self.connection.pass(encoder, "pieces");
        if self.are_behind
            && let Some(merging) = self.merging.merging()
        {
            let follow = &self.connection.merge_kernels()?.follow;
            self.dispatch(&mut pass, follow, &merging.bindings.follow, BETWEEN, Some(*face_groups));
        }
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
        Ok(())
    }

    /// Encodes the search among listed faces, and among all where there are doubts.
    fn encode_search_near(&self, merging: &Merging, encoder: &mut wgpu::CommandEncoder) -> Result<()> {
        let (kernels, bindings) = (&self.connection.kernels, &self.buffers.bindings);
        let (merge_kernels, merge_bindings) = (self.connection.merge_kernels()?, &merging.bindings);
        let one = Some([1, 1, 1]);
        let search =
            [(&kernels.link, &bindings.link), (&kernels.hook, &bindings.hook), (&kernels.weigh, &bindings.weigh)];
        let mut pass = self.connection.pass(encoder, "pieces");
        let mut dispatch = |compiled, bindings, groups| self.dispatch(&mut pass, compiled, bindings, BETWEEN, groups);
        dispatch(&merge_kernels.explore, &merge_bindings.explore, None);
        dispatch(&kernels.settle, &bindings.settle, one);
        for (compiled, bindings) in search {
            dispatch(compiled, bindings, None);
        }
        dispatch(&merge_kernels.tally, &merge_bindings.tally, None);
        dispatch(&merge_kernels.mark_gaps, &merge_bindings.mark_gaps, None);
        dispatch(&kernels.hook, &merge_bindings.hook_gaps, None);
        dispatch(&merge_kernels.doubt, &merge_bindings.doubt, None);
        dispatch(&merge_kernels.decide, &merge_bindings.decide, Some(self.buffers.cluster_groups));
        for (compiled, bindings) in [(&merge_kernels.follow, &merge_bindings.follow)].into_iter().chain(search) {
            self.dispatch_as_told(&mut pass, compiled, bindings, &merging.second_search);
        }
        for (compiled, bindings, groups) in [
            (&kernels.elect, &bindings.elect, None),
            (&kernels.cut, &bindings.cut, None),
            (&kernels.settle, &bindings.settle, one),
            // those around faces that moved need not stay on the list
            (&kernels.weed, &bindings.weed, None),
            (&kernels.line_up, &bindings.line_up, one),
        ] {
            self.dispatch(&mut pass, compiled, bindings, BETWEEN, groups);
        }
        Ok(())
    }
}
