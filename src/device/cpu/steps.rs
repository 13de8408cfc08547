//! [`Steps`] and [`MergeSteps`] of the cpu device, and what is known between them.

use std::mem::take;

use super::best_edge::{self, contraction::Contraction};
use super::clusters::Clusters;
use super::grow::grow;
use super::labels::Labels;
use super::listed::Listed;
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{Cancel, DualEdge, Ending, FREE, MergeSteps, OnStep, Step, Steps};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::Result;
use crate::surface::DualGraph;

/// One clustering.
pub struct CpuSteps<'a, E: Functional> {
    graph: &'a DualGraph<E>,
    component_of_cluster: &'a [u32],
    known: Known<'a, E>,
}

/// The labels, and what is known about them. A step makes known what it needs; labels set from outside begin anew.
#[derive(Debug)]
enum Known<'a, E: Functional> {
    /// Nothing.
    Labelled(Labels),
    /// The sums of the clusters.
    Summed(Labels, Clusters<E>),
    /// Each cluster is what merges made of single faces: the sums, and the graph of the clusters.
    Contracted(Labels, Clusters<E>, Box<Contraction<E>>),
    /// The sums, and the boundary faces of each cluster. Only here faces move.
    Listed(Box<Listed<'a, E>>),
}

impl<E: Functional> Default for Known<'_, E> {
    fn default() -> Self {
        Self::Labelled(Labels::default())
    }
}

impl<'a, E: Functional> CpuSteps<'a, E> {
    /// All faces free.
    pub fn new(graph: &'a DualGraph<E>, component_of_cluster: &'a [u32]) -> Self {
        Self { graph, component_of_cluster, known: Known::Labelled(Labels::new(graph.faces())) }
    }

    fn labels_mut(&mut self) -> &mut Labels {
        match &mut self.known {
            Known::Labelled(labels) | Known::Summed(labels, _) | Known::Contracted(labels, ..) => labels,
            Known::Listed(listed) => &mut listed.partition.labels,
        }
    }

    /// Takes labels and sums out, and whether clusters merged before.
    fn take_summed(&mut self) -> (Labels, Clusters<E>, bool) {
        match take(&mut self.known) {
            Known::Labelled(mut labels) => {
                let clusters = Clusters::of(self.graph, self.component_of_cluster, labels.all());
                (labels, clusters, false)
            }
            Known::Summed(labels, clusters) => (labels, clusters, false),
            Known::Contracted(labels, clusters, _) => (labels, clusters, true),
            Known::Listed(listed) => (listed.partition.labels, listed.partition.clusters, true),
        }
    }

    /// Makes the sums known, and reads them.
    fn with_clusters<T>(&mut self, read: impl FnOnce(&Clusters<E>) -> T) -> T {
        match &self.known {
            Known::Labelled(_) => {
                let (labels, clusters, _) = self.take_summed();
                let result = read(&clusters);
                self.known = Known::Summed(labels, clusters);
                result
            }
            Known::Summed(_, clusters) | Known::Contracted(_, clusters, _) => read(clusters),
            Known::Listed(listed) => read(&listed.partition.clusters),
        }
    }

    /// Makes the boundaries known, and works on them.
    pub fn with_listed<T>(&mut self, work: impl FnOnce(&mut Listed<'a, E>) -> T) -> T {
        if let Known::Listed(listed) = &mut self.known {
            return work(listed);
        }
        let (labels, clusters, has_merged) = self.take_summed();
        let mut listed = Box::new(Listed::new(self.graph, labels, clusters, has_merged));
        let result = work(&mut listed);
        self.known = Known::Listed(listed);
        result
    }

    /// The contraction, where each cluster is what merges made of single faces.
    fn contraction(&mut self, ties: Ties) -> Option<(&Clusters<E>, &mut Contraction<E>)> {
        if matches!(self.known, Known::Labelled(_) | Known::Summed(..)) && self.labels_mut().are_faces() {
            let (labels, clusters, _) = self.take_summed();
            self.known = Known::Contracted(labels, clusters, Box::new(Contraction::new(self.graph, ties)));
        }
        match &mut self.known {
            Known::Contracted(_, clusters, contraction) if contraction.ties == ties => Some((clusters, contraction)),
            _ => None,
        }
    }

    /// Makes iterations until there is none left, or the limit is reached. `iterate` returns the number of moves.
    fn optimise(
        &mut self,
        limit: u32,
        cancel: &Cancel,
        on_step: OnStep<'_>,
        iterate: impl Fn(&mut Listed<'a, E>) -> Option<u64>,
    ) -> Result<Ending> {
        self.with_listed(|listed| {
            let mut left = limit;
            while left > 0 {
                cancel.check()?;
                let Some(moves) = iterate(listed) else { return Ok(Ending::Converged) };
                if moves > 0 {
                    left -= 1;
                    on_step(Step { energy: listed.partition.clusters.energy(), moves });
                }
            }
            cancel.check()?;
            Ok(Ending::IterationLimit)
        })
    }
}

impl<E: Functional> Steps for CpuSteps<'_, E> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        let mut own = take(self.labels_mut());
        own.replace(labels);
        self.known = Known::Labelled(own);
        Ok(())
    }

    fn relabel(&mut self, labels: &[u32]) -> Result<()> {
        self.with_listed(|listed| listed.relabel(labels));
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        let graph = self.graph;
        let labels = self.labels_mut().all();
        let free: Vec<u32> = (0..labels.len() as u32).filter(|&face| labels[face as usize] == FREE).collect();
        if free.is_empty() {
            return Ok(());
        }
        let mut labels = take(self.labels_mut());
        let grown = grow(graph, &mut labels, &free, cancel);
        self.known = Known::Labelled(labels);
        grown
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        Ok(self.with_clusters(Clusters::energy))
    }

    fn optimise_boundary(&mut self, limit: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        self.with_listed(Listed::begin_boundary);
        self.optimise(limit, cancel, on_step, |listed| listed.boundary_iteration(cancel))
    }

    fn refine(&mut self, limit: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        self.with_listed(Listed::begin_refinement);
        self.optimise(limit, cancel, on_step, Listed::refinement_iteration)
    }

    fn resume(&mut self) {
        self.with_listed(|listed| listed.is_resumed = true);
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        self.with_listed(|listed| {
            let cut_off = listed.cut_off_faces();
            if !cut_off.is_empty() {
                listed.regrow(&cut_off, cancel)?;
            }
            Ok(cut_off.len() as u64)
        })
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        Ok(self.labels_mut().all().to_vec())
    }
}

impl<E: Functional> MergeSteps<E> for CpuSteps<'_, E> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        let choices = match self.contraction(ties) {
            Some((clusters, contraction)) => contraction.choices(clusters),
            None => self.with_listed(|listed| listed.choices(ties)),
        };
        Ok(self.with_clusters(|clusters| best_edge::optimal(clusters, &choices)))
    }

    fn mutual_dual_edges(&mut self, ties: Ties) -> Result<Vec<Rank<u32>>> {
        Ok(match self.contraction(ties) {
            Some((clusters, contraction)) => contraction.mutual(clusters),
            None => self.with_listed(|listed| {
                let choices = listed.choices(ties);
                best_edge::mutual(&listed.partition.clusters, &choices)
            }),
        })
    }

    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        Ok(self.with_listed(|listed| listed.cheapest_edge(ties)).map(|edge| edge.ends()))
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        // in this order, clusters that follow each other lie close together
        let mut pairs = pairs.to_vec();
        pairs.sort_unstable_by_key(|&(_, into)| into);
        // the contraction searches between any two merges, which costs too much where they are of single pairs
        if let Known::Contracted(labels, clusters, contraction) = &mut self.known
            && contraction.is_current
        {
            contraction.merge(&pairs);
            labels.merge(clusters.len(), &pairs);
            clusters.merge(&pairs);
        } else {
            self.with_listed(|listed| listed.merge(&pairs));
        }
        Ok(())
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<E::Sums>> {
        Ok(self.with_clusters(|all| clusters.iter().map(|&cluster| *all.sums(cluster)).collect()))
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        Ok(match &mut self.known {
            Known::Listed(listed) => listed.moves_since_merge(),
            Known::Labelled(_) | Known::Summed(..) | Known::Contracted(..) => Vec::new(),
        })
    }
}
