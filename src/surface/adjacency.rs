//! Which faces share an edge.
//!
//! Half-edges are put into one bucket for each lower end vertex; within a bucket, those with the same upper end belong
//! to one edge. Two faces of an edge are linked, more than two are linked as a chain by face number (never all pairs,
//! which would be quadratic).
//!
//! A bucket has six half-edges on average, and is a list through the memory that later holds the links. A table with an
//! entry for each upper end pairs its half-edges without unpredictable branches. Only large buckets, and those with an
//! edge of more than two faces, are sorted.

mod buckets;
mod rows;

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use self::buckets::{Buckets, Found};
use super::counts::Counts;
use super::features::Features;
use crate::mesh::Faces;
use crate::parallel;

/// Which faces are linked, by upload face.
#[derive(Debug)]
pub struct Links<'a> {
    edges: Edges<'a>,
    /// For each corner, about the edge that ends there: the face it links to, [`NONE`], or [`CHAINED`].
    linked: Vec<AtomicU32>,
    /// The inner half-edges of chains, sorted: the corner, and the faces before and after.
    chained: Vec<(u32, [u32; 2])>,
    /// Further links, both directions of each, sorted by face.
    pub bridges: Vec<(u32, u32)>,
    /// Faces of edges that have more than two, maybe several times.
    crowded: Vec<u32>,
    /// Pairs of faces that share an edge and are not linked, since it is a feature.
    pub features: Vec<[u32; 2]>,
    /// Edges and degenerate faces; the other counts are 0.
    pub counts: Counts,
}

/// No face: at a boundary, or where another half-edge of the face stands for the edge.
const NONE: u32 = u32::MAX;
/// Two faces, which [`Links::chained`] names.
const CHAINED: u32 = u32::MAX - 1;

/// Largest number of corners of all faces: the two numbers above are none's.
pub const MOST_CORNERS: usize = u32::MAX as usize - 1;

/// Largest number of positions that differ.
pub const MOST_POSITIONS: usize = 1 << 30;

/// Ranges of vertices whose half-edges are linked at the same time: each looks at all half-edges.
const MOST_RANGES: usize = 16;

/// The half-edges of a mesh.
#[derive(Debug)]
struct Edges<'a> {
    faces: &'a Faces,
    /// The position of each corner.
    positions: Vec<u32>,
    /// The face of each corner, where faces are not all triangles.
    face_of_corner: Vec<u32>,
    /// Whether a face has two corners at one position. Only such a face can run along an edge twice.
    has_degenerate: bool,
    /// What separates faces, if anything does.
    features: Option<&'a Features<'a>>,
}

impl<'a> Links<'a> {
    /// Finds the pairs of faces that share an edge, and counts edges and degenerate faces.
    ///
    /// An edge between corners at one position is none. For the counts, a face that runs along an edge several times
    /// counts once when it does so an odd number of times, and not at all otherwise: there and back, it has itself on
    /// both sides, as at the slit of a polygon with a hole or in a spike. Links do not depend on the number of times.
    ///
    /// `positions` has a number below `vertices` for each corner. Faces that features separate are not linked.
    pub fn new(faces: &'a Faces, positions: Vec<u32>, vertices: u32, features: Option<&'a Features<'a>>) -> Self {
        let mut edges = Edges::new(faces, positions, features);
        let degenerate_faces = edges.degenerate_faces();
        edges.has_degenerate = degenerate_faces > 0;
        let linked: Vec<AtomicU32> =
            (0..edges.positions.len()).into_par_iter().with_min_len(1 << 14).map(|_| NONE.into()).collect();
        let vertices = vertices as usize;
        let ranges = rayon::current_num_threads().min(MOST_RANGES).min(vertices.div_ceil(1 << 12)).max(1);
        let bound = |range: usize| (vertices * range / ranges) as u32;
        let link = |range| Buckets::new(&edges, &linked, bound(range)..bound(range + 1)).link(vertices);
        let found: Vec<Found> = parallel::map(ranges, 1, link);
        let mut counts = Counts { degenerate_faces, ..Counts::default() };
        let (mut chained, mut crowded, mut features) = (Vec::new(), Vec::new(), Vec::new());
        for found in found {
            features.extend(found.features);
            chained.extend(found.chained);
            crowded.extend(found.crowded);
            counts.boundary_edges += found.boundary_edges;
            counts.non_manifold_edges += found.non_manifold_edges;
        }
        chained.sort_unstable();
        Self { edges, linked, chained, bridges: Vec::new(), crowded, features, counts }
    }

    /// Links further pairs of faces; they come last in the rows.
    pub fn bridge(&mut self, pairs: Vec<(u32, u32)>) {
        self.bridges = pairs.into_iter().flat_map(|(a, b)| [(a, b), (b, a)]).collect();
        self.bridges.sort_by_key(|&(face, _)| face);
    }

    /// For each corner of a face a face that it is linked to, within a chain the one before; where there is none, no
    /// face's number. Of two linked faces, the later has the other. Without [`bridges`](Self::bridges).
    #[inline]
    pub fn beside(&self, face: usize) -> impl Iterator<Item = u32> + '_ {
        let corners = self.edges.faces.corner_range(face);
        corners.clone().zip(&self.linked[corners]).map(|(corner, linked)| match linked.load(Ordering::Relaxed) {
            CHAINED => self.chain_at(corner as u32)[0],
            other => other,
        })
    }

    /// The faces before and after that of an inner half-edge of a chain.
    #[cold]
    fn chain_at(&self, corner: u32) -> [u32; 2] {
        let at = self.chained.partition_point(|&(other, _)| other < corner);
        self.chained[at].1
    }

    /// Counts extra copies of faces with the same set of corner positions; degenerate faces are left out.
    ///
    /// Copies share all their edges. So a face can be one only if it shares several edges with one neighbour
    /// (`repeating`), or an edge with more than two faces, or one that is a feature; only such faces are compared.
    pub fn duplicates(&self, repeating: &[u32]) -> u64 {
        let mut suspects = [repeating, &self.crowded, self.features.as_flattened()].concat();
        suspects.sort_unstable();
        suspects.dedup();
        let corners = suspects.iter().map(|&face| self.edges.corners(face as usize));
        let mut sets: Vec<Vec<u32>> = corners.filter(|corners| !has_repeated(corners)).map(<[u32]>::to_vec).collect();
        sets.iter_mut().for_each(|set| set.sort_unstable());
        sets.sort_unstable();
        sets.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64
    }
}

impl<'a> Edges<'a> {
    fn new(faces: &'a Faces, positions: Vec<u32>, features: Option<&'a Features<'a>>) -> Self {
        let mut face_of_corner = Vec::new();
        if !faces.are_triangles() {
            face_of_corner.reserve_exact(positions.len());
            for face in 0..faces.len() {
                face_of_corner.resize(faces.corner_range(face).end, face as u32);
            }
        }
        Self { faces, positions, face_of_corner, has_degenerate: false, features }
    }

    /// The positions of a face's corners.
    fn corners(&self, face: usize) -> &[u32] {
        &self.positions[self.faces.corner_range(face)]
    }

    /// The face of a corner.
    #[inline]
    fn face(&self, corner: u32) -> u32 {
        if self.face_of_corner.is_empty() { corner / 3 } else { self.face_of_corner[corner as usize] }
    }

    /// Whether two half-edges, given by their corners and their lower end, are of a feature.
    fn is_feature(&self, corners: [u32; 2], low: u32) -> bool {
        let [one, other] = corners.map(|corner| self.positions[corner as usize] == low);
        let faces = corners.map(|corner| self.face(corner));
        self.features.is_some_and(|features| features.separate(faces, one == other))
    }

    /// The end of the half-edge at `corner` that is not `low`.
    #[inline]
    fn other_end<const TRIANGLES: bool>(&self, corner: u32, low: u32) -> u32 {
        let before = if TRIANGLES || self.face_of_corner.is_empty() {
            if corner.is_multiple_of(3) { corner + 2 } else { corner - 1 }
        } else {
            let corners = self.faces.corner_range(self.face_of_corner[corner as usize] as usize);
            if corner as usize == corners.start { corners.end as u32 - 1 } else { corner - 1 }
        };
        self.positions[corner as usize] ^ self.positions[before as usize] ^ low
    }

    /// Calls `edge(low, high, corner)` for each half-edge that has two different ends.
    #[inline]
    fn each(&self, mut edge: impl FnMut(u32, u32, u32)) {
        if self.face_of_corner.is_empty() {
            for (corners, first) in self.positions.as_chunks::<3>().0.iter().zip((0..).step_by(3)) {
                let &[a, b, c] = corners;
                for (from, to, corner) in [(c, a, first), (a, b, first + 1), (b, c, first + 2)] {
                    if from != to {
                        edge(from.min(to), from.max(to), corner);
                    }
                }
            }
        } else {
            for face in 0..self.faces.len() {
                self.each_of(face, &mut edge);
            }
        }
    }

    /// The same for one face.
    #[inline]
    fn each_of(&self, face: usize, mut edge: impl FnMut(u32, u32, u32)) {
        let range = self.faces.corner_range(face);
        let corners = &self.positions[range.clone()];
        let Some(&last) = corners.last() else { return };
        let mut from = last;
        for (&to, corner) in corners.iter().zip(range.start as u32..) {
            if from != to {
                edge(from.min(to), from.max(to), corner);
            }
            from = to;
        }
    }

    /// Number of faces with two corners at one position.
    fn degenerate_faces(&self) -> u64 {
        if self.face_of_corner.is_empty() {
            return self.positions.as_chunks::<3>().0.iter().filter(|&corners| has_repeated(corners)).count() as u64;
        }
        (0..self.faces.len()).filter(|&face| has_repeated(self.corners(face))).count() as u64
    }
}

/// Whether a number occurs twice.
#[inline(always)]
fn has_repeated(numbers: &[u32]) -> bool {
    match *numbers {
        [] | [_] => false,
        [a, b] => a == b,
        [a, b, c] => (a == b) | (b == c) | (c == a),
        _ => has_many_repeated(numbers),
    }
}

/// The same of more than three numbers, apart so that the rest is compiled into its callers.
fn has_many_repeated(numbers: &[u32]) -> bool {
    match numbers.len() {
        ..=8 => (1..numbers.len()).any(|at| numbers[..at].contains(&numbers[at])),
        _ => {
            let mut sorted = numbers.to_vec();
            sorted.sort_unstable();
            sorted.windows(2).any(|pair| pair[0] == pair[1])
        }
    }
}
