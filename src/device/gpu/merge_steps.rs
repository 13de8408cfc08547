//! The steps of hierarchical clustering on one surface.
//!
//! Searches go over boundary faces and the clusters that are left. A round of the parallel kind transfers bytes in
//! proportion to the clusters that are left and the faces that moved; a search for the cheapest dual edge some 150.

use super::FaultPoint;
use super::buffers::Buffer;
use super::kernels::{self, Kernel};
use super::layout::{CandidateEdge, DualEdge as ListedEdge, Move, sum_words};
use super::memory::{BETWEEN, Numbers};
use super::readback::{Along, Part, Parts};
use super::state::{Change, Found, GpuSteps, History, Search};
use super::upload::upload;
use crate::device::dual_edge::{Rank, Ties, mutual};
use crate::device::{DualEdge, FREE, MergeSteps};
use crate::energy::Words;
use crate::error::{Error, Result};

impl Search {
    /// What it dispatches.
    pub(super) fn kernels(self) -> &'static [&'static Kernel] {
        match self {
            Self::Best(_) => &[
                kernels::MIN_DUAL_EDGE_COST,
                kernels::MIN_DUAL_EDGE_TIE,
                kernels::MIN_DUAL_EDGE_OTHER,
                kernels::DUAL_EDGES_PUBLISH,
            ],
            Self::Cheapest(_) => &[kernels::CHEAPEST_DUAL_EDGE, kernels::CHEAPEST_DUAL_EDGE_REDUCE],
        }
    }
}

impl<E: Words> GpuSteps<'_, E> {
    /// The numbers of a submission that ends with this search.
    pub(super) fn numbers_of(&self, search: Option<Search>) -> Numbers {
        let (entries, ties) = match search {
            None => return Numbers::NONE,
            Some(Search::Best(ties)) => (self.summed() as u32, ties),
            Some(Search::Cheapest(ties)) => (self.memory.groups(&self.connection, kernels::CHEAPEST_DUAL_EDGE), ties),
        };
        Numbers { entries, ties, ..Numbers::NONE }
    }

    /// Clusters whose sums come with their best dual edges: all that are left, unless those are many bytes.
    fn summed(&self) -> usize {
        let living = self.living.len();
        if living <= self.connection.tuning.sums_along as usize { living } else { 0 }
    }

    /// Where a search leaves what it has found, and the sums of clusters.
    pub(super) fn parts(&self, search: Search) -> [Part; 2] {
        let (found, sums) = match search {
            Search::Best(_) => (Part::of::<ListedEdge>(Buffer::DualEdges, 0, self.living.len()), self.summed()),
            Search::Cheapest(_) => (Part::of::<CandidateEdge>(Buffer::CandidateEdges, 0, 1), 2),
        };
        [found, Self::copied(sums)]
    }

    /// The first of the sums that are copied for the host.
    fn copied(sums: usize) -> Part {
        Part::of::<u32>(Buffer::CopiedSums, 0, sums * (sum_words(E::AXES) + 1))
    }

    /// Sums from their words.
    fn sums(words: &[u32]) -> impl Iterator<Item = E::Sums> {
        words.chunks_exact(sum_words(E::AXES) + 1).map(|words| E::sums(words, words[sum_words(E::AXES)]))
    }

    /// What a search has found, and the sums of clusters that came along.
    pub(super) fn found(&self, search: Search, parts: &mut Parts<'_>) -> (Found, Vec<(u32, E::Sums)>) {
        let (found, summed) = match search {
            Search::Best(_) => {
                let edges = self.living.iter().zip(parts.next::<ListedEdge>()).filter(|(_, edge)| edge.other != FREE);
                let edge = |(&cluster, ListedEdge { other, cost }): (&u32, _)| DualEdge { cluster, other, cost };
                (Found { best: edges.map(edge).collect(), cheapest: None }, self.living.clone())
            }
            Search::Cheapest(_) => {
                let best = parts.next::<CandidateEdge>().first().map(|best| (best.low, best.high));
                let cheapest = best.filter(|&(low, _)| low != FREE);
                let ends = cheapest.iter().flat_map(|&(low, high)| [low, high]).collect();
                (Found { best: Vec::new(), cheapest }, ends)
            }
        };
        let sums = parts.next::<u32>();
        (found, summed.into_iter().zip(Self::sums(&sums)).collect())
    }

    /// What a search finds; what it found along with an earlier step, if that was the same search.
    fn search(&mut self, search: Search) -> Result<Found> {
        self.last_search = Some(search);
        if !matches!(&self.known.found, Some((known, _)) if *known == search) {
            let encoder = self.begin(self.numbers_of(Some(search)), true, !self.known.is_fitted);
            self.fetch(encoder, Along { search: Some(search), ..Along::default() })?;
        }
        Ok(self.known.found.take().map(|(_, found)| found).unwrap_or_default())
    }

    /// Refuses on a software gpu when faces times clusters are more than `software_limit`.
    fn check_work(&self) -> Result<()> {
        let (faces, clusters) = (self.memory.faces(), self.living.len());
        let limit = u64::from(self.connection.tuning.software_limit);
        if self.connection.is_software && u64::from(faces) * clusters as u64 > limit {
            return Err(Error::unsuitable(format_args!(
                "the software gpu {} would take too long to merge {clusters} clusters of {faces} faces one by one, \
                 use the cpu device; faces times clusters may be {limit}",
                self.connection.name,
            )));
        }
        Ok(())
    }
}

impl<E: Words> MergeSteps<E> for GpuSteps<'_, E> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        let best = self.search(Search::Best(ties))?.best;
        let number = |place| self.numbering.number(place);
        let edge = |DualEdge { cluster, other, cost }: DualEdge| {
            Ok(DualEdge { cluster: number(cluster)?, other: number(other)?, cost })
        };
        best.into_iter().map(edge).collect()
    }

    fn mutual_dual_edges(&mut self, ties: Ties) -> Result<Vec<Rank<u32>>> {
        Ok(mutual(&self.optimal_dual_edges(ties)?, &mut self.chosen))
    }

    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        self.check_work()?;
        let cheapest = self.search(Search::Cheapest(ties))?.cheapest;
        cheapest.map(|(low, high)| Ok((self.numbering.number(low)?, self.numbering.number(high)?))).transpose()
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        let living = |cluster: u32| self.numbering.place(cluster).ok().filter(|&place| self.is_living[place as usize]);
        let mut entries = Vec::with_capacity(2 * pairs.len());
        for &(from, into) in pairs {
            match (living(from), living(into)) {
                (Some(from), Some(into)) if from != into => entries.extend([from, into]),
                _ => {
                    let message = format_args!("cluster {from} cannot become part of {into}");
                    return Err(Error::internal(message));
                }
            }
        }
        if entries.len() > self.is_living.len() {
            let (clusters, pairs) = (self.is_living.len(), pairs.len());
            let message = format_args!("{clusters} clusters cannot merge in {pairs} pairs");
            return Err(Error::internal(message));
        }
        self.connection.reach(FaultPoint::Merge);
        upload(&self.connection, self.memory.get(Buffer::HostList), &entries);
        let mut encoder = self.begin(Numbers { entries: pairs.len() as u32, ..Numbers::NONE }, false, false);
        if self.known.history == History::Unmerged {
            self.memory.get(Buffer::MergedInto).clear(&mut encoder);
        }
        self.encode(&mut encoder, "merge", &[kernels::MERGE_APPLY, kernels::MERGE_RELABEL], BETWEEN);
        self.connection.submit(Some(encoder));
        self.known.invalidate(Change::Merge);
        entries.as_chunks().0.iter().for_each(|&[from, _]| self.is_living[from as usize] = false);
        self.living.retain(|&cluster| self.is_living[cluster as usize]);
        self.memory.list_clusters(&self.connection, &self.living);
        self.connection.check()
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<E::Sums>> {
        let places = clusters.iter().map(|&cluster| self.numbering.place(cluster)).collect::<Result<Vec<u32>>>()?;
        let known = |place: &u32| {
            let at = self.known.sums.binary_search_by_key(place, |&(place, _)| place).ok()?;
            Some(self.known.sums[at].1)
        };
        if let Some(sums) = places.iter().map(known).collect() {
            return Ok(sums);
        }
        let mut sums = Vec::with_capacity(places.len());
        for chunk in places.chunks(self.memory.capacity(Buffer::CopiedSums)) {
            upload(&self.connection, self.memory.get(Buffer::HostList), chunk);
            let mut encoder = self.begin(Numbers { entries: chunk.len() as u32, ..Numbers::NONE }, false, false);
            self.encode(&mut encoder, "merge", &[kernels::SUMS_COPY], BETWEEN);
            let copied: Vec<u32> = self.read(encoder, &[Self::copied(chunk.len())], |mut parts| parts.next())?;
            sums.extend(Self::sums(&copied));
        }
        Ok(sums)
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        if self.known.history != History::MovedSinceMerge {
            return Ok(Vec::new());
        }
        if self.known.moves.is_none() {
            let encoder = self.begin(Numbers::NONE, false, false);
            self.fetch(encoder, Along { moves: true, ..Along::default() })?;
        }
        let (mut list, moved) = self.known.moves.take().unwrap_or_default();
        if list.len() < moved {
            list = self.download::<Move>(Buffer::Moves, moved)?;
        }
        list.sort_unstable_by_key(|moved| moved.face);
        let number = |place| self.numbering.number(place);
        list.iter().map(|moved| Ok((moved.face, number(moved.before)?, number(moved.after)?))).collect()
    }
}
