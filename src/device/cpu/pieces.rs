//! Pieces of clusters: those that were cut off, among the clusters that changed, and those that a move would cut off.

use super::frontier::Frontier;
use super::labels::Labels;
use crate::surface::DualGraph;

/// The faces outside the piece with the most faces (of equally large ones, that with the smallest face) of each of the
/// given clusters, sorted.
///
/// A cluster in several pieces has boundary faces in each, so walks from its boundary faces find them all. `walked` has
/// one number a face, none of them `walk` on entry.
pub fn cut_off(
    graph: &DualGraph,
    labels: &Labels,
    frontier: &Frontier,
    clusters: &[u32],
    walked: &mut [u32],
    walk: u32,
) -> Vec<u32> {
    let mut cut_off = Vec::new();
    let mut pieces: Vec<Vec<u32>> = Vec::new();
    for &cluster in clusters {
        pieces.clear();
        for start in frontier.boundary_of(cluster) {
            if walked[start as usize] != walk {
                pieces.push(piece(graph, labels, cluster, start, walked, walk));
            }
        }
        if pieces.len() > 1 {
            let smallest_face = |piece: &[u32]| piece.iter().copied().min();
            pieces.sort_by_key(|piece| (piece.len(), std::cmp::Reverse(smallest_face(piece))));
            pieces.pop();
            cut_off.extend(pieces.drain(..).flatten());
        }
    }
    cut_off.sort_unstable();
    cut_off
}

/// The faces of a cluster that are connected with `start`.
fn piece(graph: &DualGraph, labels: &Labels, cluster: u32, start: u32, walked: &mut [u32], walk: u32) -> Vec<u32> {
    walked[start as usize] = walk;
    let mut faces = vec![start];
    let mut next = 0;
    while let Some(&face) = faces.get(next) {
        next += 1;
        for &near in graph.neighbours_of(face) {
            if walked[near as usize] != walk && labels.of(near) == cluster {
                walked[near as usize] = walk;
                faces.push(near);
            }
        }
    }
    faces
}

/// Whether a cluster stays connected when it loses one of its faces, given that it is connected. `walked` and `walk` are as
/// for [`cut_off`].
pub fn stays_connected(graph: &DualGraph, labels: &Labels, face: u32, walked: &mut [u32], walk: u32) -> bool {
    let cluster = labels.of(face);
    let is_own = |near: &&u32| labels.of(**near) == cluster;
    let mut own: Vec<u32> = graph.neighbours_of(face).iter().filter(is_own).copied().collect();
    own.sort_unstable();
    own.dedup();
    let Some(start) = own.pop() else { return true };
    walked[face as usize] = walk;
    walked[start as usize] = walk;
    let mut queue = std::collections::VecDeque::from([start]);
    while !own.is_empty() {
        let Some(reached) = queue.pop_front() else { return false };
        for &near in graph.neighbours_of(reached) {
            if walked[near as usize] != walk && labels.of(near) == cluster {
                walked[near as usize] = walk;
                own.retain(|&wanted| wanted != near);
                queue.push_back(near);
            }
        }
    }
    true
}
