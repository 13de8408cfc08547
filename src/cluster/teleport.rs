//! Teleports: moves that leave a local minimum (Cohen-Steiner et al. 2004, section 3.4).
//!
//! A teleport merges two clusters that lose little by it and splits one that gains much, so that the number stays. Many
//! are made at the same time, far from each other; what follows from them is optimised, and if the energy did not fall,
//! all are taken back.

use std::cmp::Reverse;

use crate::device::DualEdge;
use crate::device::dual_edge::{Rank, mutual};
use crate::energy::{Functional, Sums};
use crate::parallel;
use crate::surface::{DualGraph, Rows};

/// Splits that are tried for a pair, at most: many pairs would otherwise try many that are taken.
const TRIED_SPLITS: usize = 64;

/// Clusters that a thread takes at least.
const CHUNK: usize = 64;

/// The teleports that a clustering allows.
#[derive(Debug)]
pub struct Teleports<'a, E: Functional> {
    graph: &'a DualGraph<E>,
    component_of_cluster: &'a [u32],
    faces_of_cluster: Rows,
    /// The mutual pairs of clusters, the cheapest first.
    pairs: Vec<(u32, u32)>,
    /// The splits of each component, those that gain most first.
    splits: Vec<Vec<Split<E>>>,
}

/// A way to split a cluster in two.
#[derive(Debug)]
struct Split<E: Functional> {
    /// By how much the energy falls, packed as merge costs are.
    gain: u32,
    cluster: u32,
    /// The faces that are nearer to the second leave it.
    centres: [E::Point; 2],
}

impl<'a, E: Functional> Teleports<'a, E> {
    /// The teleports of some labels. Every face is labelled; `edges` are the best dual edges.
    pub fn of(graph: &'a DualGraph<E>, labels: &[u32], component_of_cluster: &'a [u32], edges: &[DualEdge]) -> Self {
        let faces_of_cluster = Rows::grouped(labels, component_of_cluster.len());
        let split = |cluster: u32| {
            let component = component_of_cluster[cluster as usize] as usize;
            let (faces, shift) = (faces_of_cluster.of(cluster), graph.components[component].energy_shift);
            Split::of(graph, faces, cluster, shift).map(|split| (component, split))
        };
        let all = parallel::list(component_of_cluster.len(), CHUNK, &|range, all| {
            all.extend((range.start as u32..range.end as u32).filter_map(split));
        });
        let mut splits: Vec<Vec<Split<E>>> = graph.components.iter().map(|_| Vec::new()).collect();
        all.into_iter().for_each(|(component, split)| splits[component].push(split));
        for splits in &mut splits {
            splits.sort_unstable_by_key(|split| (Reverse(split.gain), split.cluster));
        }
        let mut pairs = mutual(edges, &mut Vec::new());
        pairs.sort_unstable();
        let pairs = pairs.iter().map(Rank::ends).collect();
        Self { graph, component_of_cluster, faces_of_cluster, pairs, splits }
    }

    /// `labels`, from which these teleports were computed, after at most `most` of them: the cheapest merges with the
    /// splits that gain most. None when there is no such pair. A merge always costs more than a split gains; the energy
    /// falls in the optimisation that follows.
    ///
    /// The clusters of a teleport lie in one component, and none of them touches those of another teleport.
    pub fn made(&self, labels: &[u32], most: usize) -> Option<Vec<u32>> {
        let mut labels = labels.to_vec();
        let mut is_taken = vec![false; self.component_of_cluster.len()];
        let mut first_free = vec![0; self.splits.len()];
        let mut made = 0;
        for &(into, from) in &self.pairs {
            if made == most {
                break;
            }
            if is_taken[into as usize] || is_taken[from as usize] {
                continue;
            }
            let component = self.component_of_cluster[into as usize] as usize;
            let (splits, first) = (&self.splits[component], &mut first_free[component]);
            *first += splits[*first..].iter().take_while(|split| is_taken[split.cluster as usize]).count();
            let is_apart =
                |split: &&Split<E>| !is_taken[split.cluster as usize] && ![into, from].contains(&split.cluster);
            let Some(split) = splits[*first..].iter().take(TRIED_SPLITS).find(is_apart) else {
                continue;
            };
            for cluster in [into, from, split.cluster] {
                is_taken[cluster as usize] = true;
                for &face in self.faces_of_cluster.of(cluster) {
                    for &near in self.graph.neighbours_of(face) {
                        is_taken[labels[near as usize] as usize] = true;
                    }
                }
            }
            for &face in self.faces_of_cluster.of(from) {
                labels[face as usize] = into;
            }
            for &face in self.faces_of_cluster.of(split.cluster) {
                if leaves(self.graph, split.centres, face) {
                    labels[face as usize] = from;
                }
            }
            made += 1;
        }
        (made > 0).then_some(labels)
    }
}

/// Whether a face is nearer to the second centre.
fn leaves<E: Functional>(graph: &DualGraph<E>, centres: [E::Point; 2], face: u32) -> bool {
    let [stay, leave] = centres.map(|centre| E::cost(graph.points[face as usize], centre));
    leave < stay
}

impl<E: Functional> Split<E> {
    /// From the two faces that are the farthest apart, by twice giving every face to the nearer centre. None when all
    /// faces lie at one place.
    fn of(graph: &DualGraph<E>, faces: &[u32], cluster: u32, energy_shift: u32) -> Option<Self> {
        let whole = graph.sums_over(faces.iter().copied());
        let point = |face: u32| graph.points[face as usize];
        let farthest_from = |from: E::Point| {
            let farthest = faces.iter().max_by_key(|&&face| (E::cost(point(face), from), Reverse(face)));
            farthest.map(|&face| point(face))
        };
        let first = farthest_from(whole.proxy()?)?;
        let mut next = [first, farthest_from(first)?];
        let mut centres = next;
        let mut halves = [whole, E::Sums::default()];
        for _ in 0..3 {
            centres = next;
            let half = graph.sums_over(faces.iter().copied().filter(|&face| leaves(graph, centres, face)));
            let mut rest = whole;
            rest.add(&half, -1);
            halves = [rest, half];
            next = [halves[0].proxy()?, halves[1].proxy()?];
        }
        let end = |side: usize| halves[side].end(next[side]);
        Some(Self { gain: E::packed_merge_cost(end(0), end(1), energy_shift), cluster, centres })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::seeds;
    use crate::dev::sample::Sample;
    use crate::device::cpu::CpuDevice;
    use crate::device::dual_edge::Ties;
    use crate::device::{Device, pieces, plain};
    use crate::surface::Surface;
    use crate::surface::tests::{assert_clusters_lie_in, of_sample};

    /// Labels after at most so many teleports.
    fn teleported(surface: &Surface, labels: &[u32], component_of_cluster: &[u32], most: usize) -> Vec<u32> {
        let mut device = CpuDevice::new();
        let mut steps = device.open_merging(surface, component_of_cluster).expect("it opens");
        steps.set_labels(labels).expect("labels");
        let edges = steps.optimal_dual_edges(Ties::Hash).expect("edges");
        Teleports::of(surface, labels, component_of_cluster, &edges).made(labels, most).expect("there is one")
    }

    #[test]
    fn a_teleport_fills_a_gap() {
        // a strip in three clusters of which the first has half of the faces
        let surface = of_sample(Sample::Strip, 64);
        let labels: Vec<u32> = surface.upload_face.iter().map(|&face| [0, 0, 1, 2][face as usize / 16]).collect();
        let teleported = teleported(&surface, &labels, &[0; 3], 1);
        assert_eq!(pieces::disconnected_clusters(&surface, 3, &teleported), 0);
        let mut sizes = [0; 3];
        teleported.iter().for_each(|&label| sizes[label as usize] += 1);
        sizes.sort_unstable();
        assert_eq!(sizes, [16, 16, 32], "the large one is split in its middle, the small ones become one");
        let label_of = |upload: u32| {
            let face = surface.upload_face.iter().position(|&face| face == upload);
            teleported[face.expect("every face is there")]
        };
        assert_ne!(label_of(0), label_of(31));
        assert_eq!(label_of(32), label_of(63));
    }

    #[test]
    fn components_keep_their_numbers_of_clusters() {
        let surface = of_sample(Sample::Parts, 1500);
        let shares = seeds::shares(&surface, 150).expect("that many are possible");
        let start = seeds::stratified(&surface, &shares, 1);
        let labels = plain::grow(&surface, &start.labels(surface.faces()));
        let teleported = teleported(&surface, &labels, &start.component_of_cluster, 1000);
        assert_ne!(teleported, labels);
        assert_clusters_lie_in(&surface, &teleported, &start.component_of_cluster);
    }
}
