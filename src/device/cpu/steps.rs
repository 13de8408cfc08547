//! [`Steps`] and [`MergeSteps`] of the cpu device, and how its state changes.

use super::Move;
use super::best_edge::{self, contraction::Contraction};
use super::clusters::Clusters;
use super::grow::grow;
use super::labels::Labels;
use super::listed::Listed;
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{Cancel, DualEdge, Ending, FREE, MergeSteps, Step, Steps};
use crate::energy::ClusterSums;
use crate::energy::LatticeEnergy;
use crate::error::Result;
use crate::surface::DualGraph;

/// One clustering.
pub struct CpuSteps<'a> {
    pub graph: &'a DualGraph,
    component_of_cluster: &'a [u32],
    pub labels: Labels,
    state: State,
}

/// What is known about the labels. A step brings it as far as it needs; labels set from outside begin anew.
#[derive(Debug, Default)]
enum State {
    /// Nothing.
    #[default]
    Labelled,
    /// The sums of the clusters.
    Summed(Clusters),
    /// Each cluster is what merges made of single faces: the sums, and the graph of the clusters.
    Contracted(Clusters, Box<Contraction>),
    /// The sums, and the boundary faces of each cluster. Only here faces move.
    Listed(Box<Listed>),
}

impl<'a> CpuSteps<'a> {
    /// All faces free.
    pub fn new(graph: &'a DualGraph, component_of_cluster: &'a [u32]) -> Self {
        Self { graph, component_of_cluster, labels: Labels::new(graph.faces()), state: State::Labelled }
    }

    /// The sums in step with the labels, out of the state, and whether clusters merged under a contraction.
    fn take_clusters(&mut self, state: State) -> (Clusters, bool) {
        match state {
            State::Labelled => (Clusters::of(self.graph, self.component_of_cluster, self.labels.all()), false),
            State::Summed(clusters) => (clusters, false),
            State::Contracted(clusters, _) => (clusters, true),
            State::Listed(listed) => (listed.clusters, true),
        }
    }

    /// Brings the state to sums at least, and reads them.
    fn with_clusters<T>(&mut self, read: impl FnOnce(&Clusters) -> T) -> T {
        match &self.state {
            State::Labelled => {
                let (clusters, _) = self.take_clusters(State::Labelled);
                let result = read(&clusters);
                self.state = State::Summed(clusters);
                result
            }
            State::Summed(clusters) | State::Contracted(clusters, _) => read(clusters),
            State::Listed(listed) => read(&listed.clusters),
        }
    }

    /// Brings the state to listed boundaries, and works on them.
    pub fn with_listed<T>(&mut self, work: impl FnOnce(&DualGraph, &mut Labels, &mut Listed) -> T) -> T {
        let mut listed = match std::mem::take(&mut self.state) {
            State::Listed(listed) => listed,
            other => {
                let (clusters, has_merged) = self.take_clusters(other);
                Box::new(Listed::new(self.graph, &mut self.labels, clusters, has_merged))
            }
        };
        let result = work(self.graph, &mut self.labels, &mut listed);
        self.state = State::Listed(listed);
        result
    }

    /// The neighbour that each cluster would best merge with: by the contraction where each cluster is what merges made
    /// of single faces, else along boundaries.
    fn choices(&mut self, ties: Ties) -> Vec<(u32, u32)> {
        let (clusters, mut contraction) = match std::mem::take(&mut self.state) {
            State::Contracted(clusters, contraction) if contraction.ties() == ties => (clusters, contraction),
            state @ (State::Labelled | State::Summed(_)) if self.labels.are_faces() => {
                let (clusters, _) = self.take_clusters(state);
                (clusters, Box::new(Contraction::new(self.graph, ties)))
            }
            state => {
                self.state = state;
                return self.with_listed(|graph, labels, listed| listed.choices(graph, labels, ties));
            }
        };
        let choices = contraction.choices(&clusters);
        self.state = State::Contracted(clusters, contraction);
        choices
    }

    /// Makes iterations until `next_moves` has none left to make, or the limit is reached.
    fn optimise(
        &mut self,
        limit: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
        next_moves: impl Fn(&mut Listed, &DualGraph, &mut Labels) -> Option<Vec<Move>>,
    ) -> Result<Ending> {
        self.with_listed(|graph, labels, listed| {
            let mut left = limit;
            while left > 0 {
                cancel.check()?;
                let Some(moves) = next_moves(listed, graph, labels) else { return Ok(Ending::Converged) };
                if !moves.is_empty() {
                    left -= 1;
                    listed.apply(graph, labels, &moves);
                    on_iteration(Step { energy: listed.clusters.energy(), moves: moves.len() as u64 });
                }
            }
            cancel.check()?;
            Ok(Ending::IterationLimit)
        })
    }

    fn refine_as(
        &mut self,
        is_connected: bool,
        limit: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        self.with_listed(|_, _, listed| listed.begin_refinement());
        self.optimise(limit, cancel, on_iteration, |listed, graph, labels| {
            listed.refinement_moves(graph, labels, is_connected)
        })
    }
}

impl Steps for CpuSteps<'_> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        self.labels.replace(labels);
        self.state = State::Labelled;
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        let labels = self.labels.all();
        if !labels.contains(&FREE) {
            return Ok(());
        }
        let is_near_free = |face: &u32| {
            labels[*face as usize] != FREE
                && self.graph.neighbours_of(*face).iter().any(|&near| labels[near as usize] == FREE)
        };
        let front = (0..labels.len() as u32).filter(is_near_free).collect();
        self.state = State::Labelled;
        grow(self.graph, &mut self.labels, front, cancel)
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        Ok(self.with_clusters(Clusters::energy))
    }

    fn optimise_boundary(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        self.with_listed(|_, _, listed| listed.begin_boundary());
        self.optimise(max_iterations, cancel, on_iteration, Listed::boundary_moves)
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_iteration: &mut dyn FnMut(Step)) -> Result<Ending> {
        self.refine_as(false, max_iterations, cancel, on_iteration)
    }

    fn refine_connected(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        self.refine_as(true, max_iterations, cancel, on_iteration)
    }

    fn resume(&mut self) {
        self.with_listed(|_, _, listed| listed.resume());
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        self.with_listed(|graph, labels, listed| {
            let cut_off = listed.cut_off_faces(graph, labels);
            if !cut_off.is_empty() {
                listed.regrow(graph, labels, &cut_off, cancel)?;
            }
            Ok(cut_off.len() as u64)
        })
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        Ok(self.labels.all().to_vec())
    }
}

impl MergeSteps for CpuSteps<'_> {
    fn optimal_dual_edges(&mut self, ties: Ties) -> Result<Vec<DualEdge>> {
        let choices = self.choices(ties);
        Ok(self.with_clusters(|clusters| best_edge::optimal(clusters, &choices)))
    }

    fn mutual_dual_edges(&mut self, ties: Ties) -> Result<Vec<Rank<u32>>> {
        let choices = self.choices(ties);
        Ok(self.with_clusters(|clusters| best_edge::mutual(clusters, &choices)))
    }

    fn cheapest_dual_edge(&mut self, ties: Ties) -> Result<Option<(u32, u32)>> {
        let cheapest = self.with_listed(|graph, labels, listed| listed.cheapest_edge(graph, labels, ties));
        Ok(cheapest.map(|edge| edge.ends()))
    }

    fn merge(&mut self, pairs: &[(u32, u32)]) -> Result<()> {
        // in this order, clusters that follow each other lie close together
        let mut pairs = pairs.to_vec();
        pairs.sort_unstable_by_key(|&(_, into)| into);
        if let State::Contracted(clusters, contraction) = &mut self.state {
            contraction.merge(clusters, &pairs);
            self.labels.merge(clusters.len(), &pairs);
            clusters.merge(&pairs);
        } else {
            self.with_listed(|graph, labels, listed| listed.merge(graph, labels, &pairs));
        }
        Ok(())
    }

    fn sums_of(&mut self, clusters: &[u32]) -> Result<Vec<ClusterSums>> {
        Ok(self.with_clusters(|all| clusters.iter().map(|&cluster| *all.sums(cluster)).collect()))
    }

    fn moves_since_merge(&mut self) -> Result<Vec<(u32, u32, u32)>> {
        let Self { labels, state, .. } = self;
        Ok(match state {
            State::Listed(listed) => listed.moves_since_merge(labels),
            State::Labelled | State::Summed(_) | State::Contracted(..) => Vec::new(),
        })
    }
}
