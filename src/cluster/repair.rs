//! Pieces of clusters, found by walking the whole mesh: the plain way, for checks.

use crate::device::FREE;
use crate::surface::DualGraph;

/// The connected pieces of equally labelled faces.
struct Pieces {
    /// The piece of each face, numbered in the order of their smallest faces.
    piece_of_face: Vec<u32>,
    /// Label and number of faces of each piece.
    pieces: Vec<(u32, u32)>,
}

impl Pieces {
    /// Walks the pieces of all labelled faces, each from its smallest face.
    fn find(graph: &DualGraph, labels: &[u32]) -> Self {
        let mut piece_of_face = vec![FREE; labels.len()];
        let mut pieces: Vec<(u32, u32)> = Vec::new();
        let mut stack = Vec::new();
        for start in 0..labels.len() {
            let label = labels[start];
            if piece_of_face[start] != FREE || label == FREE {
                continue;
            }
            let piece = pieces.len() as u32;
            piece_of_face[start] = piece;
            stack.push(start as u32);
            let mut faces = 0;
            while let Some(face) = stack.pop() {
                faces += 1;
                for &neighbour in graph.neighbours_of(face) {
                    let neighbour = neighbour as usize;
                    if piece_of_face[neighbour] == FREE && labels[neighbour] == label {
                        piece_of_face[neighbour] = piece;
                        stack.push(neighbour as u32);
                    }
                }
            }
            pieces.push((label, faces));
        }
        Self { piece_of_face, pieces }
    }
}

/// The faces outside their cluster's piece with the most faces (of equally large ones, that with the smallest face),
/// sorted.
pub fn cut_off_faces(graph: &DualGraph, clusters: usize, labels: &[u32]) -> Vec<u32> {
    let Pieces { piece_of_face, pieces } = Pieces::find(graph, labels);
    let mut largest: Vec<Option<u32>> = vec![None; clusters];
    for (piece, &(label, faces)) in pieces.iter().enumerate() {
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
pub fn disconnected_clusters(graph: &DualGraph, clusters: usize, labels: &[u32]) -> u64 {
    let mut pieces_of_cluster = vec![0u32; clusters];
    for (label, _) in Pieces::find(graph, labels).pieces {
        pieces_of_cluster[label as usize] += 1;
    }
    pieces_of_cluster.into_iter().filter(|&pieces| pieces > 1).count() as u64
}
