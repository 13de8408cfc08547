//! Pieces of clusters, found in a pass over the whole mesh: the reference for those that devices find, and the check of
//! results.

use std::hint::select_unpredictable;

use crate::device::FREE;
use crate::energy::Functional;
use crate::surface::DualGraph;
use crate::union_find;

/// The forest of the connected pieces of equally labelled faces; a free face is a piece by itself.
fn forest<E: Functional>(graph: &DualGraph<E>, labels: &[u32]) -> Vec<u32> {
    union_find::forest(labels.len(), |face| {
        let label = labels[face as usize];
        let near = if label == FREE { &[] } else { graph.neighbours_of(face) };
        let is_earlier = move |near: u32| (near < face) & (labels[near as usize] == label);
        near.iter().map(move |&near| select_unpredictable(is_earlier(near), near, face))
    })
}

/// The faces outside their cluster's piece with the most faces (of equally large ones, that with the smallest face),
/// sorted.
pub fn cut_off_faces<E: Functional>(graph: &DualGraph<E>, clusters: usize, labels: &[u32]) -> Vec<u32> {
    // pieces are numbered in the order of their smallest faces
    let (piece_of_face, count) = union_find::numbered(forest(graph, labels));
    let mut pieces = vec![(FREE, 0); count];
    for (&piece, &label) in piece_of_face.iter().zip(labels) {
        pieces[piece as usize].0 = label;
        pieces[piece as usize].1 += 1;
    }
    let mut largest: Vec<Option<u32>> = vec![None; clusters];
    for (piece, &(label, faces)) in pieces.iter().enumerate().filter(|(_, (label, _))| *label != FREE) {
        let best = &mut largest[label as usize];
        if best.is_none_or(|best| pieces[best as usize].1 < faces) {
            *best = Some(piece as u32);
        }
    }
    let is_cut_off = |&face: &u32| {
        let label = labels[face as usize];
        label != FREE && largest[label as usize] != Some(piece_of_face[face as usize])
    };
    (0..labels.len() as u32).filter(is_cut_off).collect()
}

/// How many clusters are in several pieces.
pub fn disconnected_clusters<E: Functional>(graph: &DualGraph<E>, clusters: usize, labels: &[u32]) -> u64 {
    let mut pieces_of_cluster = vec![0u32; clusters];
    let parents = (0..).zip(forest(graph, labels)).zip(labels);
    for (_, &label) in parents.filter(|&((face, parent), &label)| face == parent && label != FREE) {
        pieces_of_cluster[label as usize] += 1;
    }
    pieces_of_cluster.into_iter().filter(|&pieces| pieces > 1).count() as u64
}
