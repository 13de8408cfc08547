//! Which faces share an edge.
//!
//! Half-edges are put into one bucket for each lower end vertex, the buckets sorted by the upper end and the face. The
//! faces of one edge then lie side by side: two are linked, more than two are linked as a chain by face number (never
//! all pairs, which would be quadratic).

use crate::mesh::{Faces, PolygonMesh};

use super::Counts;
use super::weld::Weld;

/// What [`links`] finds.
pub struct Links {
    /// Pairs of faces that share an edge, by upload face.
    pub pairs: Vec<(u32, u32)>,
    /// Faces of edges that have more than two, maybe several times.
    pub crowded: Vec<u32>,
    /// Edges and degenerate faces; the other counts are 0.
    pub counts: Counts,
}

/// Finds the pairs of faces that share an edge, and counts edges and degenerate faces.
///
/// An edge between corners at one position is none. For the counts, an edge that a face runs along twice, there and
/// back, is no edge of that face: it belongs to a degenerate spike.
pub fn links(faces: &Faces, weld: &Weld) -> Links {
    let mut counts = Counts::default();
    let position = |corner: u32| weld.position_of_vertex[corner as usize];
    let mut first = vec![0u32; weld.vertices as usize + 1];
    for face in 0..faces.len() {
        for_each_edge(faces.corners(face), position, |low, _| first[low as usize + 1] += 1);
    }
    for vertex in 1..first.len() {
        first[vertex] += first[vertex - 1];
    }
    let mut next = first.clone();
    let mut half_edges = vec![(0u32, 0u32); first[first.len() - 1] as usize];
    let mut distinct = Vec::new();
    for face in 0..faces.len() {
        let corners = faces.corners(face);
        for_each_edge(corners, position, |low, high| {
            half_edges[next[low as usize] as usize] = (high, face as u32);
            next[low as usize] += 1;
        });
        counts.degenerate_faces += u64::from(has_repeated_position(corners, position, &mut distinct));
    }
    drop(next);

    let mut pairs = Vec::with_capacity(half_edges.len() / 2);
    let mut crowded = Vec::new();
    for bucket in first.windows(2) {
        let bucket = &mut half_edges[bucket[0] as usize..bucket[1] as usize];
        bucket.sort_unstable();
        for edge in bucket.chunk_by(|a, b| a.0 == b.0) {
            let mut previous = None;
            let mut faces = 0;
            let mut solid_faces = 0;
            for uses in edge.chunk_by(|a, b| a.1 == b.1) {
                let face = uses[0].1;
                if let Some(previous) = previous.replace(face) {
                    pairs.push((previous, face));
                }
                faces += 1;
                solid_faces += uses.len() % 2;
            }
            if faces > 2 {
                crowded.extend(edge.iter().map(|&(_, face)| face));
            }
            counts.boundary_edges += u64::from(solid_faces == 1);
            counts.non_manifold_edges += u64::from(solid_faces > 2);
        }
    }
    Links { pairs, crowded, counts }
}

/// Calls `edge(low, high)` for each edge of a corner loop that has two different ends.
fn for_each_edge(corners: &[u32], position: impl Fn(u32) -> u32, mut edge: impl FnMut(u32, u32)) {
    let Some(&last) = corners.last() else { return };
    let mut a = position(last);
    for &corner in corners {
        let b = position(corner);
        if a != b {
            edge(a.min(b), a.max(b));
        }
        a = b;
    }
}

/// Whether two corners of a face lie at one position. `scratch` saves an allocation a face.
fn has_repeated_position(corners: &[u32], position: impl Fn(u32) -> u32, scratch: &mut Vec<u32>) -> bool {
    if let &[a, b, c] = corners {
        let [a, b, c] = [position(a), position(b), position(c)];
        return a == b || b == c || c == a;
    }
    scratch.clear();
    scratch.extend(corners.iter().map(|&corner| position(corner)));
    scratch.sort_unstable();
    scratch.windows(2).any(|pair| pair[0] == pair[1])
}

/// The links as compressed rows in internal order: the first neighbour of each face, and the neighbours.
pub fn compressed(links: &[(u32, u32)], upload_face: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let faces = upload_face.len();
    let mut internal = vec![0u32; faces];
    for (face, &upload) in upload_face.iter().enumerate() {
        internal[upload as usize] = face as u32;
    }
    let mut offsets = vec![0u32; faces + 1];
    for &(a, b) in links {
        offsets[internal[a as usize] as usize + 1] += 1;
        offsets[internal[b as usize] as usize + 1] += 1;
    }
    for face in 0..faces {
        offsets[face + 1] += offsets[face];
    }
    let mut next = offsets.clone();
    let mut neighbours = vec![0u32; 2 * links.len()];
    for &(a, b) in links {
        let (a, b) = (internal[a as usize], internal[b as usize]);
        for (face, neighbour) in [(a, b), (b, a)] {
            neighbours[next[face as usize] as usize] = neighbour;
            next[face as usize] += 1;
        }
    }
    (offsets, neighbours)
}

/// Counts extra copies of faces with the same set of corner positions; degenerate faces are left out.
///
/// Copies share all their edges. So a face can be one only if it shares several edges with one neighbour, or an edge
/// with more than one face (`crowded`, by upload face); only such faces are compared.
pub fn duplicates(
    mesh: &PolygonMesh,
    weld: &Weld,
    crowded: &[u32],
    upload_face: &[u32],
    offsets: &[u32],
    neighbours: &[u32],
) -> u64 {
    let mut suspects = crowded.to_vec();
    let mut row = Vec::new();
    for (face, &upload) in upload_face.iter().enumerate() {
        row.clear();
        row.extend_from_slice(&neighbours[offsets[face] as usize..offsets[face + 1] as usize]);
        row.sort_unstable();
        if row.windows(2).any(|pair| pair[0] == pair[1]) {
            suspects.push(upload);
        }
    }
    suspects.sort_unstable();
    suspects.dedup();
    let mut sets: Vec<Vec<u32>> = suspects
        .iter()
        .filter_map(|&face| {
            let corners = mesh.faces.corners(face as usize);
            let mut set: Vec<u32> = corners.iter().map(|&corner| weld.position_of_vertex[corner as usize]).collect();
            set.sort_unstable();
            set.dedup();
            (set.len() == corners.len()).then_some(set)
        })
        .collect();
    sets.sort_unstable();
    sets.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64
}
