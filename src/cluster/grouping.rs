//! A start by merging groups of faces: for large meshes by normals, but not with quality `best`.
//!
//! # Definition
//!
//! 1. *Groups.* Every face chooses the neighbour that it would merge with at the lowest cost. Two that choose each
//!    other form a group; other faces, in their order, join the group of their choice while it has fewer than
//!    [`MOST_FACES`] faces, or stay alone. Groups are grouped as well, while there are [`FACES_A_CLUSTER`] of them a
//!    cluster and [`LEAST_FACES`] in all, and while that leaves at most two thirds.
//! 2. *Merges.* The last groups merge ([`super::merging`]).
//! 3. *Improvement*, where it is wanted. Clusters of groups settle, and [move](Relocation::improved) as a whole. Then
//!    labels go to the finer groups, where clusters [settle](settle::settled) again, and so on.
//!
//! The clustering goes on from there with the faces.
//!
//! # Why
//!
//! A merge of two faces costs as much as one of two clusters, and most merges are of few faces. Between groups there
//! are a tenth as many, and of a face's neighbours, the cheapest lies across a sharp edge only if all do. Moves of
//! whole clusters take a tenth of the time there, too. `docs/constants.md` has the figures.

use super::coarse::Start;
use super::connected::settle;
use super::merging::{self, Pairs};
use super::numbers;
use super::quality::Quality;
use super::relocation::Relocation;
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{Cancel, Device, Ending};
use crate::energy::{End, Functional};
use crate::error::Result;
use crate::parallel;
use crate::surface::{Coarse, DualGraph, Grouping};

/// Faces of a group at most.
const MOST_FACES: u32 = 4;

/// Weight of a group at most: a weight has 32 bits.
const HEAVIEST: u64 = 1 << 31;

/// Faces a cluster from which on they are grouped: about 8 groups are left.
const FACES_A_CLUSTER: usize = 20;

/// Fewer faces are not grouped: of few groups, moves of clusters find less.
const LEAST_FACES: usize = 2560;

/// Faces that a thread takes at least.
const CHUNK: usize = 1 << 12;

/// No group yet.
const NONE: u32 = u32::MAX;

impl Start {
    /// From this many clusters that were merged from groups of faces. The numbers must be possible
    /// ([`super::seeds::shares`]).
    pub fn from_groups<E: Functional>(
        graph: &DualGraph<E>,
        clusters: u64,
        pairs: Pairs,
        improve: bool,
        device: &mut dyn Device<E>,
        cancel: &Cancel,
    ) -> Result<Self> {
        let levels = levels(graph, clusters as usize);
        let coarsest = levels.last().map_or(graph, |level| &level.graph);
        let mut labels = numbers::compact(&merging::merged(coarsest, clusters as usize, pairs, device, cancel)?);
        let mut ending = Ending::Converged;
        if improve {
            let relocation = Relocation { graph: coarsest, quality: Quality::Default, pairs, cancel };
            (labels, ending) = relocation.improved(labels)?;
        }
        let mut is_bounded = ending == Ending::WorkLimit;
        for (at, level) in levels.iter().enumerate().rev() {
            labels = level.refined(&labels);
            if improve && at > 0 {
                (labels, ending) = settle::settled(&levels[at - 1].graph, labels, cancel)?;
                is_bounded |= ending == Ending::WorkLimit;
            }
        }
        Ok(Self { is_bounded, ..Self::of(graph, labels, clusters as usize) })
    }
}

/// Coarser and coarser graphs.
fn levels<E: Functional>(graph: &DualGraph<E>, clusters: usize) -> Vec<Coarse<E>> {
    let mut levels: Vec<Coarse<E>> = Vec::new();
    loop {
        let graph = levels.last().map_or(graph, |level| &level.graph);
        if graph.faces() < clusters.saturating_mul(FACES_A_CLUSTER).max(LEAST_FACES) {
            break;
        }
        let grouping = grouping(graph);
        if grouping.groups() as usize > graph.faces() / 3 * 2 {
            break;
        }
        let coarser = graph.contracted(grouping);
        levels.push(coarser);
    }
    levels
}

/// Groups of faces that would merge at low costs.
fn grouping<E: Functional>(graph: &DualGraph<E>) -> Grouping {
    let choice_of_face = choices(graph);
    let weight_of = |face: u32| u64::from(graph.weights[face as usize]);
    let mut group_of_face = vec![NONE; graph.faces()];
    // faces and weight of each group
    let mut groups: Vec<(u32, u64)> = Vec::new();
    for (face, &choice) in (0..).zip(&choice_of_face) {
        let weight = weight_of(face) + weight_of(choice);
        if face < choice && choice_of_face[choice as usize] == face && weight <= HEAVIEST {
            group_of_face[face as usize] = groups.len() as u32;
            group_of_face[choice as usize] = groups.len() as u32;
            groups.push((2, weight));
        }
    }
    for (face, &choice) in (0..).zip(&choice_of_face) {
        if group_of_face[face as usize] != NONE {
            continue;
        }
        let group = group_of_face[choice as usize];
        let weight = weight_of(face);
        group_of_face[face as usize] = match groups.get_mut(group as usize) {
            Some((faces, of_group)) if *faces < MOST_FACES && *of_group + weight <= HEAVIEST => {
                *faces += 1;
                *of_group += weight;
                group
            }
            _ => {
                groups.push((1, weight));
                groups.len() as u32 - 1
            }
        };
    }
    graph.grouping(group_of_face, groups.len())
}

/// The neighbour that each face would merge with at the lowest cost; the face itself where it has none.
fn choices<E: Functional>(graph: &DualGraph<E>) -> Vec<u32> {
    let end = |face: u32| End { weight: graph.weights[face as usize] as f32, proxy: graph.points[face as usize] };
    let choice = |face: u32| {
        let own = end(face);
        // costs are not negative: their bits are in their order
        let rank = |&near: &u32| Rank::new(E::rough_merge_cost(own, end(near)).to_bits(), face, near, Ties::Hash);
        graph.neighbours_of(face).iter().copied().min_by_key(rank).unwrap_or(face)
    };
    parallel::map(graph.faces(), CHUNK, |face| choice(face as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::Sample;
    use crate::device::cpu::CpuDevice;
    use crate::device::pieces::disconnected_clusters;
    use crate::device::plain::PlainDevice;
    use crate::surface::Rows;
    use crate::surface::tests::{assert_clusters_lie_in, of_sample};

    #[test]
    fn groups_are_small_connected_and_made_of_choices() {
        for sample in [Sample::Knot, Sample::Terrain, Sample::Parts] {
            let surface = of_sample(sample, 3000);
            let graph: &DualGraph = &surface;
            let Coarse { graph: coarse, group_of_face } = graph.contracted(grouping(graph));
            assert!(3 * coarse.faces() < 2 * graph.faces(), "{sample:?}: {} of {}", coarse.faces(), graph.faces());
            assert_eq!(disconnected_clusters(graph, coarse.faces(), &group_of_face), 0);
            let mut sizes = vec![0; coarse.faces()];
            group_of_face.iter().for_each(|&group| sizes[group as usize] += 1);
            assert!(sizes.iter().all(|size| (1..=MOST_FACES).contains(size)), "{sample:?}");
            // all but the first face of a group lie in the group of their choice
            let mut apart = vec![0; coarse.faces()];
            for (&group, choice) in group_of_face.iter().zip(choices(graph)) {
                apart[group as usize] += u32::from(group_of_face[choice as usize] != group);
            }
            assert!(apart.iter().all(|&faces| faces < 2), "{sample:?}");
        }
    }

    #[test]
    fn a_fan_around_one_face_ends_in_a_bounded_number_of_levels() {
        // a hub beside all others: three of them join it in a level
        let leaves = 5000u32;
        let mut graph: DualGraph = of_sample(Sample::Knot, 6000).items.graph;
        let faces = leaves as usize + 1;
        graph.points.truncate(faces);
        graph.weights.truncate(faces);
        graph.neighbours = Rows::empty(0);
        graph.neighbours.push(1..=leaves);
        (0..leaves).for_each(|_| graph.neighbours.push([0]));
        graph.components.truncate(1);
        graph.components[0].faces = faces as u32;
        assert!(levels(&graph, 1).is_empty());
    }

    #[test]
    fn starts_have_all_clusters_in_one_piece_with_and_without_improvement_and_on_any_device() {
        let surface = of_sample(Sample::Parts, 4000);
        for (clusters, improve) in [(20, false), (20, true), (150, true), (900, true)] {
            let start = |device: &mut dyn Device| {
                Start::from_groups(&surface, clusters, Pairs::Eighth, improve, device, &Cancel::default())
            };
            let Start { labels, component_of_cluster, .. } = start(&mut CpuDevice::new()).expect("a start");
            assert_eq!(start(&mut PlainDevice::default()).expect("a start").labels, labels);
            assert_eq!(component_of_cluster.len(), clusters as usize);
            assert_clusters_lie_in(&surface, &labels, &component_of_cluster);
            assert_eq!(disconnected_clusters(&surface, clusters as usize, &labels), 0, "{clusters} {improve}");
        }
    }
}
