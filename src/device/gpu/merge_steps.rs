//! The steps of hierarchical clustering on one surface.
//!
//! Searches go over boundary faces and the clusters that are left. A round of the parallel kind transfers bytes in
//! proportion to the clusters that are left and the faces that moved; a search for the cheapest dual edge transfers 64.

use super::FaultPoint;
use super::buffers::Buffer;
use super::kernels;
use super::layout::{CandidateEdge, CopiedSums, DualEdge as ListedEdge, Move};
use super::steps::{GpuSteps, History};
use super::upload::upload;
use crate::device::dual_edge::Ties;
use crate::device::{DualEdge, FREE, MergeSteps};
use crate::energy::ClusterSums;
use crate::error::{Error, Kind, Result};

/// Faces times clusters up to which a software gpu merges one pair at a time. Each merge searches all listed faces, in
/// dispatches that have a fixed cost.
const SOFTWARE_LIMIT: u64 = 1 << 24;

/// Moves that are read along with their number; more are read once that is known.
const FEW_MOVES: usize = 4096;

impl GpuSteps<'_> {
    /// Encodes proxies and energy, and removes faces from the list that are no longer on a boundary.
    fn encode_compaction(&mut self, ties: Ties) -> wgpu::CommandEncoder {
        self.memory.announce(&self.connection.queue, 0, ties);
        let mut encoder = self.encode_fit();
        self.encode(&mut encoder, "merge", &[kernels::BOUNDARY_COMPACT, kernels::BOUNDARY_PUBLISH]);
        encoder
    }
}

impl MergeSteps for GpuSteps<'_> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        self.connection.reach(FaultPoint::DualEdges);
        let mut encoder = self.encode_compaction(ties);
        let search = [
            kernels::MIN_DUAL_EDGE_COST,
            kernels::MIN_DUAL_EDGE_TIE,
            kernels::MIN_DUAL_EDGE_OTHER,
            kernels::DUAL_EDGES_PUBLISH,
        ];
        self.encode(&mut encoder, "merge", &search);
        let (stats, edges) = self.download::<ListedEdge>(encoder, Buffer::DualEdges, self.living.len())?;
        self.set_energy(Some(stats.energy()));
        let edges = self.living.iter().zip(edges).filter(|(_, edge)| edge.other != FREE);
        Ok(edges.map(|(&cluster, edge)| DualEdge { cluster, other: edge.other, cost: edge.cost }).collect())
    }

    /// Refuses on a software gpu when faces times clusters are more than 2²⁴.
    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        let work = u64::from(self.memory.faces()) * self.living.len() as u64;
        if self.connection.is_software && work > SOFTWARE_LIMIT {
            return Err(Error::new(
                Kind::DeviceUnsuitable,
                format_args!(
                    "the software gpu {} would take too long to merge {} clusters of {} faces one by one, use the cpu \
                     device; faces times clusters may be {SOFTWARE_LIMIT}",
                    self.connection.name,
                    self.living.len(),
                    self.memory.faces()
                ),
            ));
        }
        self.connection.reach(FaultPoint::DualEdges);
        let mut encoder = self.encode_compaction(ties);
        self.encode(&mut encoder, "merge", &[kernels::CHEAPEST_DUAL_EDGE, kernels::CHEAPEST_DUAL_EDGE_REDUCE]);
        let (stats, best) = self.download::<CandidateEdge>(encoder, Buffer::CandidateEdges, 1)?;
        self.set_energy(Some(stats.energy()));
        Ok(best.first().filter(|best| best.low != FREE).map(|best| (best.low, best.high)))
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
        let mut encoder = self.encoder_with_sums();
        encoder.clear_buffer(self.memory.get(Buffer::Stats), 0, None);
        self.encode(&mut encoder, "merge", &[kernels::BOUNDARY_COVER, kernels::MOVES_LIST]);
        let few = FEW_MOVES.min(self.memory.faces() as usize);
        let (stats, mut list) = self.download::<Move>(encoder, Buffer::Moves, few)?;
        let listed = stats.listed as usize;
        if listed > few {
            list = self.download::<Move>(self.encoder(), Buffer::Moves, listed)?.1;
        }
        list.truncate(listed);
        list.sort_unstable_by_key(|moved| moved.face);
        Ok(list.iter().map(|moved| (moved.face, moved.before, moved.after)).collect())
    }
}
