//! Groups of faces, to merge them in place of single faces.
//!
//! # Definition
//!
//! Every face chooses the neighbour that it would merge with at the lowest cost. Two that choose each other form a
//! group; other faces, in their order, join the group of their choice while it has fewer than [`MOST_FACES`] faces, or
//! stay alone. Groups are grouped as well, while there are [`FACES_A_CLUSTER`] of them a cluster and [`LEAST_FACES`] in
//! all, and while that leaves at most two thirds. The last groups merge ([`super::merging`]).
//!
//! # Why
//!
//! A merge of two faces costs as much as one of two clusters, and most merges are of few faces. Between groups there
//! are a tenth as many, and of a face's neighbours, the cheapest lies across a sharp edge only if all do.
//! `docs/constants.md` has the figures.

use super::merging::{self, Pairs};
use crate::device::dual_edge::{Rank, Ties};
use crate::device::{Cancel, Device};
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

/// Labels with this many clusters, merged from groups of faces; their numbers have gaps.
pub fn merged<E: Functional>(
    graph: &DualGraph<E>,
    clusters: usize,
    pairs: Pairs,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
) -> Result<Vec<u32>> {
    let levels = levels(graph, clusters);
    let coarsest = levels.last().map_or(graph, |level| &level.graph);
    let labels = merging::merged(coarsest, clusters, pairs, device, cancel)?;
    Ok(levels.iter().rev().fold(labels, |labels, level| level.refined(&labels)))
}

/// Coarser and coarser graphs.
pub fn levels<E: Functional>(graph: &DualGraph<E>, clusters: usize) -> Vec<Coarse<E>> {
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
    use crate::device::pieces::disconnected_clusters;
    use crate::surface::Rows;
    use crate::surface::tests::of_sample;

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
}
