//! The steps of hierarchical clustering on one surface.
//!
//! Searches go over boundary faces and the clusters that are left. A round of the parallel kind transfers bytes in
//! proportion to the clusters that are left and the faces that moved; a search for the cheapest dual edge some 150.
//! What the next call will need comes along with what a call reads, since a wait costs more than some thousand bytes.

use std::mem::offset_of;

use bytemuck::{Pod, pod_collect_to_vec};

use super::FaultPoint;
use super::buffers::Buffer;
use super::kernels::{self, Kernel};
use super::layout::{CandidateEdge, CopiedSums, DualEdge as ListedEdge, IterationStats};
use super::memory::BETWEEN;
use super::readback::BatchStats;
use super::state::{Found, GpuSteps, History, Search};
use super::upload::upload;
use crate::device::dual_edge::Ties;
use crate::device::{DualEdge, FREE, MergeSteps};
use crate::energy::{ClusterSums, LatticeEnergy};
use crate::error::{Error, Kind, Result};

impl GpuSteps<'_> {
    /// Encodes the removal of faces from the list that are no longer on a boundary, and a search.
    fn encode_search(&self, encoder: &mut wgpu::CommandEncoder, kernels: &[&Kernel]) {
        self.encode(encoder, "merge", &[kernels::BOUNDARY_COMPACT, kernels::BOUNDARY_PUBLISH]);
        self.encode(encoder, "merge", kernels);
    }

    /// Reads the statistics of the first iterations of a batch and of what is done between batches, the first items of
    /// a buffer, and the sums of the clusters in the first entries of `host_list`.
    fn read_with_sums<T: Pod>(
        &self,
        mut encoder: wgpu::CommandEncoder,
        iterations: u32,
        (buffer, items): (Buffer, usize),
        entries: usize,
    ) -> Result<(BatchStats, Vec<T>, Vec<ClusterSums>)> {
        if entries > 0 {
            self.encode(&mut encoder, "merge", &[kernels::SUMS_COPY]);
        }
        let bytes = |items: usize, size: usize| (items * size) as u64;
        let stats = bytes(1, size_of::<IterationStats>());
        let parts = [
            (self.memory.get(Buffer::Stats), 0, stats * u64::from(iterations)),
            (self.memory.get(Buffer::Stats), stats * u64::from(BETWEEN), stats),
            (self.memory.get(buffer), 0, bytes(items, size_of::<T>())),
            (self.memory.get(Buffer::CopiedSums), 0, bytes(entries, size_of::<CopiedSums>())),
        ];
        self.read(self.request(encoder, &parts)?, |view| {
            let (batch, rest) = view.split_at(parts[0].2 as usize);
            let (stats, rest) = rest.split_at(parts[1].2 as usize);
            let (items, sums) = rest.split_at(parts[2].2 as usize);
            let sums: Vec<CopiedSums> = pod_collect_to_vec(sums);
            let sums = sums.iter().map(CopiedSums::sums).collect();
            let stats = (pod_collect_to_vec(batch), bytemuck::pod_read_unaligned(stats));
            (stats, pod_collect_to_vec(items), sums)
        })
    }
}

/// The ends of a candidate are copied together.
const _: () = assert!(offset_of!(CandidateEdge, high) == offset_of!(CandidateEdge, low) + 4);

impl GpuSteps<'_> {
    /// Searches, and returns the energy too, which takes no further wait.
    pub(super) fn search(&mut self, search: Search) -> Result<(LatticeEnergy, Option<Found>)> {
        self.connection.reach(FaultPoint::DualEdges);
        self.last_search = Some(search);
        self.search_follows = self.is_after_boundary;
        self.forget();
        let (stats, found) = match search {
            Search::Best(ties) => self.search_best(ties)?,
            Search::Cheapest(ties) => self.search_cheapest(ties)?,
        };
        self.set_energy(Some(stats.energy()));
        Ok((stats.energy(), Some(found)))
    }

    fn search_best(&mut self, ties: Ties) -> Result<(IterationStats, Found)> {
        self.memory.announce(&self.connection.queue, self.summed() as u32, ties);
        let encoder = self.encode_fit();
        let ((_, stats), found) = self.read_best(encoder, 0)?;
        Ok((stats, found))
    }

    /// Clusters whose sums come with their best dual edges: all that are left, unless those are many bytes.
    pub(super) fn summed(&self) -> usize {
        let living = self.living.len();
        if living <= self.connection.tuning.sums_along as usize { living } else { 0 }
    }

    /// Reads the statistics of the first iterations of a batch, and makes the next search ahead.
    pub(super) fn read_stats_and_best(
        &mut self,
        mut encoder: wgpu::CommandEncoder,
        iterations: u32,
    ) -> Result<Vec<IterationStats>> {
        self.connection.reach(FaultPoint::DualEdges);
        self.encode(&mut encoder, "fit", &[kernels::PROXIES_FIT]);
        let ((batch, _), found) = self.read_best(encoder, iterations)?;
        self.found_ahead = Some(found);
        Ok(batch)
    }

    /// Searches for the best dual edge of each cluster, proxies being fitted. Also reads the statistics of the first
    /// iterations of a batch, and of what is done between batches.
    fn read_best(&mut self, mut encoder: wgpu::CommandEncoder, iterations: u32) -> Result<(BatchStats, Found)> {
        let (living, summed) = (self.living.len(), self.summed());
        let search = [
            kernels::MIN_DUAL_EDGE_COST,
            kernels::MIN_DUAL_EDGE_TIE,
            kernels::MIN_DUAL_EDGE_OTHER,
            kernels::DUAL_EDGES_PUBLISH,
        ];
        self.encode_search(&mut encoder, &search);
        if summed > 0 {
            let (from, to) = (self.memory.get(Buffer::LivingClusters), self.memory.get(Buffer::HostList));
            encoder.copy_buffer_to_buffer(from, 0, to, 0, 4 * summed as u64);
        }
        let listed = (Buffer::DualEdges, living);
        let (stats, edges, sums) = self.read_with_sums::<ListedEdge>(encoder, iterations, listed, summed)?;
        self.known_sums = self.living.iter().copied().zip(sums).collect();
        let edges = self.living.iter().zip(edges).filter(|(_, edge)| edge.other != FREE);
        let edge = |(&cluster, edge): (&u32, ListedEdge)| DualEdge { cluster, other: edge.other, cost: edge.cost };
        Ok((stats, Found::Best(edges.map(edge).collect())))
    }

    /// Refuses on a software gpu when faces times clusters are more than `software_limit`.
    fn search_cheapest(&mut self, ties: Ties) -> Result<(IterationStats, Found)> {
        let work = u64::from(self.memory.faces()) * self.living.len() as u64;
        let limit = u64::from(self.connection.tuning.software_limit);
        if self.connection.is_software && work > limit {
            return Err(Error::new(
                Kind::DeviceUnsuitable,
                format_args!(
                    "the software gpu {} would take too long to merge {} clusters of {} faces one by one, use the cpu \
                     device; faces times clusters may be {limit}",
                    self.connection.name,
                    self.living.len(),
                    self.memory.faces()
                ),
            ));
        }
        self.memory.announce(&self.connection.queue, 2, ties);
        let mut encoder = self.encode_fit();
        self.encode_search(&mut encoder, &[kernels::CHEAPEST_DUAL_EDGE, kernels::CHEAPEST_DUAL_EDGE_REDUCE]);
        // the sums of both ends come along
        let (from, ends) = (self.memory.get(Buffer::CandidateEdges), offset_of!(CandidateEdge, low) as u64);
        encoder.copy_buffer_to_buffer(from, ends, self.memory.get(Buffer::HostList), 0, 8);
        let best = (Buffer::CandidateEdges, 1);
        let ((_, stats), best, sums) = self.read_with_sums::<CandidateEdge>(encoder, 0, best, 2)?;
        let best = best.first().filter(|best| best.low != FREE).map(|best| (best.low, best.high));
        self.known_sums = best.iter().flat_map(|&(low, high)| [low, high]).zip(sums).collect();
        Ok((stats, Found::Cheapest(best)))
    }

    /// What a search finds; what it found with the energy, if that was the same search.
    fn found(&mut self, search: Search) -> Result<Option<Found>> {
        match self.found_ahead.take().filter(|_| self.last_search == Some(search)) {
            Some(found) => Ok(Some(found)),
            None => Ok(self.search(search)?.1),
        }
    }
}

impl MergeSteps for GpuSteps<'_> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        match self.found(Search::Best(ties))? {
            Some(Found::Best(edges)) => Ok(edges),
            Some(Found::Cheapest(_)) | None => Ok(Vec::new()),
        }
    }

    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        match self.found(Search::Cheapest(ties))? {
            Some(Found::Cheapest(ends)) => Ok(ends),
            Some(Found::Best(_)) | None => Ok(None),
        }
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        let is_living = |cluster: u32| self.living.binary_search(&cluster).is_ok();
        if let Some((from, into)) =
            pairs.iter().find(|&&(from, into)| from == into || !is_living(from) || !is_living(into))
        {
            return Err(Error::new(Kind::Internal, format_args!("cluster {from} cannot become part of {into}")));
        }
        if pairs.len() > self.clusters() as usize / 2 {
            return Err(Error::new(
                Kind::Internal,
                format_args!("{} clusters cannot merge in {} pairs", self.clusters(), pairs.len()),
            ));
        }
        self.connection.reach(FaultPoint::Merge);
        self.forget();
        self.is_repaired = false;
        let entries: Vec<u32> = pairs.iter().flat_map(|&(from, into)| [from, into]).collect();
        upload(&self.connection.queue, self.memory.get(Buffer::HostList), 0, &entries);
        self.memory.announce(&self.connection.queue, pairs.len() as u32, Ties::Hash);
        let mut encoder = self.encoder_with_sums();
        if self.history == History::Unmerged {
            encoder.clear_buffer(self.memory.get(Buffer::MergedInto), 0, None);
        }
        self.encode(&mut encoder, "merge", &[kernels::MERGE_APPLY, kernels::MERGE_RELABEL]);
        self.connection.queue.submit([encoder.finish()]);
        self.history = History::Merged;
        let mut gone: Vec<u32> = pairs.iter().map(|&(from, _)| from).collect();
        gone.sort_unstable();
        self.living.retain(|cluster| gone.binary_search(cluster).is_err());
        self.memory.list_clusters(&self.connection.queue, &self.living);
        // the sums are current, the proxies and the energy are not
        self.set_energy(None);
        self.connection.check()
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<ClusterSums>> {
        self.check_clusters(clusters.iter().copied())?;
        let known = |cluster: &u32| {
            let at = self.known_sums.binary_search_by_key(cluster, |&(cluster, _)| cluster).ok()?;
            Some(self.known_sums[at].1)
        };
        if let Some(sums) = clusters.iter().map(known).collect() {
            return Ok(sums);
        }
        let mut sums = Vec::with_capacity(clusters.len());
        for chunk in clusters.chunks(self.memory.capacity(Buffer::CopiedSums)) {
            upload(&self.connection.queue, self.memory.get(Buffer::HostList), 0, chunk);
            self.memory.announce(&self.connection.queue, chunk.len() as u32, Ties::Hash);
            let mut encoder = self.encoder_with_sums();
            self.encode(&mut encoder, "merge", &[kernels::SUMS_COPY]);
            let (_, copied) = self.download::<CopiedSums>(encoder, Buffer::CopiedSums, chunk.len())?;
            sums.extend(copied.iter().map(CopiedSums::sums));
        }
        Ok(sums)
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        if self.history != History::MovedSinceMerge {
            return Ok(Vec::new());
        }
        let mut list = match self.moves.take() {
            Some(list) => list,
            None => {
                let mut encoder = self.encoder_with_sums();
                encoder.clear_buffer(self.memory.get(Buffer::Stats), 0, None);
                self.encode(&mut encoder, "moves", &[kernels::BOUNDARY_COVER]);
                let ((_, stats), moves, _) = self.read_stats_and_moves(encoder, 0, 0)?;
                match moves {
                    Some(moves) => moves,
                    None => self.download(self.encoder(), Buffer::Moves, stats.listed as usize)?.1,
                }
            }
        };
        list.sort_unstable_by_key(|moved| moved.face);
        Ok(list.iter().map(|moved| (moved.face, moved.before, moved.after)).collect())
    }
}
