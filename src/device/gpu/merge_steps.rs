//! The steps of hierarchical clustering on one surface.
//!
//! Searches go over the faces on boundaries and the clusters that are left, and the host reads what it needs to know: a round
//! of the parallel kind costs as many bytes as clusters are left and faces have moved, a search for the cheapest dual edge 64.

use std::sync::Arc;

use super::FaultPoint;
use super::buffers::{BETWEEN, upload};
use super::connection::Compiled;
use super::layout::{Best, Dispatch, Found, Picked, Slot};
use super::merging::Merging;
use super::steps::GpuSteps;
use crate::cluster::dual_edge::Ties;
use crate::cluster::sums::ClusterSums;
use crate::device::{DualEdge, FREE, LatticeEnergy, MergeSteps};
use crate::error::{Error, Kind, Result};

/// Faces times clusters up to which a software gpu merges one pair at a time: each time all listed faces are searched, in
/// dispatches that have their price. On llvmpipe, a knot of 2,002 faces to the top takes 12 s of processor time without
/// optimisation, one of 1,008 faces 27 s with it (two busy cores).
const SOFTWARE_LIMIT: u64 = 1 << 24;

/// Moves that are read along with their number; more are read once that is known.
const FEW_MOVES: usize = 4096;

impl GpuSteps<'_> {
    /// Encodes kernels of the hierarchy, one after the other, between batches.
    fn encode(&self, encoder: &mut wgpu::CommandEncoder, work: &[(&Compiled, &wgpu::BindGroup, Option<Dispatch>)]) {
        let mut pass = self.connection.pass(encoder, "merge");
        for &(compiled, bindings, groups) in work {
            self.dispatch(&mut pass, compiled, bindings, BETWEEN, groups);
        }
    }

    /// Encodes proxies and energy, and takes faces off the list that are no longer on a boundary.
    fn encode_weeding(&mut self) -> wgpu::CommandEncoder {
        let mut encoder = self.encode_fit();
        let (kernels, bindings) = (&self.connection.kernels, &self.buffers.bindings);
        self.encode(
            &mut encoder,
            &[(&kernels.weed, &bindings.weed, None), (&kernels.line_up, &bindings.line_up, Some([1, 1, 1]))],
        );
        encoder
    }

    /// Submits what is encoded and reads the list that it leaves, `likely` entries at once and the others if there are more.
    fn download_list(&self, encoder: wgpu::CommandEncoder, likely: usize) -> Result<(Slot, Vec<Found>)> {
        let (slot, mut list) = self.download::<Found>(encoder, &self.merging()?.found, likely)?;
        let listed = slot.moves as usize;
        if listed > likely {
            list = self.download::<Found>(self.encoder(), &self.merging()?.found, listed)?.1;
        }
        list.truncate(listed);
        Ok((slot, list))
    }

    /// Keeps the energy that `proxies_fit` left in a slot.
    fn keep_energy(&mut self, slot: &Slot) {
        self.energy = Some(LatticeEnergy { explained: slot.explained() });
    }

    /// Refuses clusters that do not exist.
    fn check_clusters(&self, mut clusters: impl Iterator<Item = u32>) -> Result<()> {
        match clusters.find(|&cluster| cluster >= self.clusters) {
            None => Ok(()),
            Some(cluster) => {
                Err(Error::new(Kind::Internal, format_args!("clusters must be below {}, not {cluster}", self.clusters)))
            }
        }
    }
}

impl MergeSteps for GpuSteps<'_> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        self.connection.reach(FaultPoint::DualEdges);
        let connection = Arc::clone(&self.connection);
        let kernels = connection.merge_kernels()?;
        self.buffers.turns.announce(&self.connection.queue, 0, ties);
        let mut encoder = self.encode_weeding();
        let Merging { bindings, .. } = self.merging()?;
        self.encode(
            &mut encoder,
            &[
                (&kernels.price, &bindings.price, None),
                (&kernels.break_ties, &bindings.break_ties, None),
                (&kernels.prefer, &bindings.prefer, None),
                (&kernels.list_choices, &bindings.list_choices, Some(self.buffers.cluster_groups)),
            ],
        );
        let (slot, mut list) = self.download_list(encoder, self.living.len())?;
        self.keep_energy(&slot);
        list.sort_unstable_by_key(|found| found.subject);
        let edge = |found: &Found| DualEdge { cluster: found.subject, other: found.first, cost: found.second };
        Ok(list.iter().map(edge).collect())
    }

    /// Refuses on a software gpu when faces times clusters are more than 2²⁴.
    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        if self.merging()?.is_software && u64::from(self.buffers.faces) * self.living.len() as u64 > SOFTWARE_LIMIT {
            return Err(Error::new(
                Kind::DeviceUnsuitable,
                format_args!(
                    "the software gpu {} would take too long to merge {} clusters of {} faces one by one, use the cpu \
                     device; faces times clusters may be {SOFTWARE_LIMIT}",
                    self.connection.name(),
                    self.living.len(),
                    self.buffers.faces
                ),
            ));
        }
        self.connection.reach(FaultPoint::DualEdges);
        let connection = Arc::clone(&self.connection);
        let kernels = connection.merge_kernels()?;
        self.buffers.turns.announce(&self.connection.queue, 0, ties);
        let mut encoder = self.encode_weeding();
        let Merging { bests, bindings, .. } = self.merging()?;
        self.encode(
            &mut encoder,
            &[(&kernels.search, &bindings.search, None), (&kernels.reduce, &bindings.reduce, Some([1, 1, 1]))],
        );
        let (slot, best) = self.download::<Best>(encoder, bests, 1)?;
        self.keep_energy(&slot);
        Ok(best.first().filter(|best| best.low != FREE).map(|best| (best.low, best.high)))
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        // one that became part of itself, or of one that has ended, would be looked for without end
        let is_living = |cluster: u32| self.living.binary_search(&cluster).is_ok();
        if let Some((from, into)) =
            pairs.iter().find(|&&(from, into)| from == into || !is_living(from) || !is_living(into))
        {
            return Err(Error::new(Kind::Internal, format_args!("cluster {from} cannot become part of {into}")));
        }
        if pairs.len() > self.clusters as usize / 2 {
            return Err(Error::new(
                Kind::Internal,
                format_args!("{} clusters cannot merge in {} pairs", self.clusters, pairs.len()),
            ));
        }
        self.connection.reach(FaultPoint::Merge);
        let connection = Arc::clone(&self.connection);
        let kernels = connection.merge_kernels()?;
        let queue = &connection.queue;
        let entries: Vec<u32> = pairs.iter().flat_map(|&(from, into)| [from, into]).collect();
        upload(queue, &self.merging()?.entries, 0, &entries);
        self.buffers.turns.announce(queue, pairs.len() as u32, Ties::Hash);
        let mut encoder = if self.gathered { self.encoder() } else { self.encode_fit() };
        let Merging { bindings, merged_into, .. } = self.merging()?;
        if !self.has_merged {
            encoder.clear_buffer(merged_into, 0, None);
        }
        self.encode(
            &mut encoder,
            &[
                (&self.connection.kernels.settle, &self.buffers.bindings.settle, Some([1, 1, 1])),
                (&kernels.unite, &bindings.unite, Some(self.merging()?.groups(pairs.len()))),
                (&kernels.relabel, &bindings.relabel, Some(self.buffers.face_groups)),
            ],
        );
        queue.submit([encoder.finish()]);
        self.has_merged = true;
        self.has_moved = false;
        let mut gone: Vec<u32> = pairs.iter().map(|&(from, _)| from).collect();
        gone.sort_unstable();
        self.living.retain(|cluster| gone.binary_search(cluster).is_err());
        self.buffers.list_clusters(&self.connection.queue, &self.living);
        // the sums are right, the proxies not: whoever needs them fits
        self.energy = None;
        self.connection.check()
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<ClusterSums>> {
        self.check_clusters(clusters.iter().copied())?;
        let connection = Arc::clone(&self.connection);
        let kernels = connection.merge_kernels()?;
        let mut sums = Vec::with_capacity(clusters.len());
        for chunk in clusters.chunks(self.merging()?.most_picked) {
            upload(&self.connection.queue, &self.merging()?.entries, 0, chunk);
            self.buffers.turns.announce(&self.connection.queue, chunk.len() as u32, Ties::Hash);
            let mut encoder = if self.gathered { self.encoder() } else { self.encode_fit() };
            let Merging { picked, bindings, .. } = self.merging()?;
            self.encode(
                &mut encoder,
                &[(&kernels.pick_sums, &bindings.pick_sums, Some(self.merging()?.groups(chunk.len())))],
            );
            let (_, found) = self.download::<Picked>(encoder, picked, chunk.len())?;
            sums.extend(found.iter().map(Picked::sums));
        }
        Ok(sums)
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        if !self.has_merged || !self.has_moved {
            return Ok(Vec::new());
        }
        let connection = Arc::clone(&self.connection);
        let kernels = connection.merge_kernels()?;
        let mut encoder = if self.gathered { self.encoder() } else { self.encode_fit() };
        encoder.clear_buffer(&self.buffers.ring, 0, None);
        let Merging { bindings, .. } = self.merging()?;
        self.encode(
            &mut encoder,
            &[
                (&self.connection.kernels.settle, &self.buffers.bindings.settle, Some([1, 1, 1])),
                (&kernels.list_moves, &bindings.list_moves, None),
            ],
        );
        let (_, mut list) = self.download_list(encoder, FEW_MOVES.min(self.buffers.faces as usize))?;
        list.sort_unstable_by_key(|found| found.subject);
        Ok(list.iter().map(|found| (found.subject, found.first, found.second)).collect())
    }
}
