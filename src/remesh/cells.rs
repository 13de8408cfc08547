//! Cells: clusters, divided until each is a disk.
//!
//! A cluster that cutting left disconnected becomes a cell for each piece. Pieces come first: Euler numbers add up, and
//! a sphere beside a pair of pants has that of a disk. A connected cell with another Euler number than 1 is divided in
//! two by 2-means, grown over its triangles, until all are disks. That ends, since both halves have a triangle and
//! are connected, and a single triangle is a disk.
//!
//! The largest piece and the half of the first mean keep the number of their cluster. Others get numbers above.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::geometry::Geometry;
use crate::complex::half_edges::{HalfEdges, NONE};

/// Cells that are disks.
#[derive(Debug)]
pub struct Cells {
    /// The cell of each triangle.
    pub of_triangle: Vec<u32>,
    /// The cluster of each cell: cell i is of cluster i for all clusters.
    pub clusters: Vec<u32>,
}

impl Cells {
    /// The connected pieces of clusters; `labels` has the cluster of each triangle.
    pub fn pieces(halves: &HalfEdges, labels: Vec<u32>, clusters: usize) -> Self {
        let mut cells = Self { of_triangle: labels, clusters: (0..clusters as u32).collect() };
        cells.divide_into_pieces(halves);
        cells
    }

    fn add(&mut self, cluster: u32) -> u32 {
        self.clusters.push(cluster);
        self.clusters.len() as u32 - 1
    }

    fn divide_into_pieces(&mut self, halves: &HalfEdges) {
        let labels = &self.of_triangle;
        let mut piece_of = vec![NONE; labels.len()];
        // label and number of triangles of each piece
        let mut pieces: Vec<(u32, u32)> = Vec::new();
        let mut queue: Vec<u32> = Vec::new();
        for start in 0..labels.len() as u32 {
            if piece_of[start as usize] != NONE {
                continue;
            }
            let (piece, label) = (pieces.len() as u32, labels[start as usize]);
            queue.clear();
            queue.push(start);
            piece_of[start as usize] = piece;
            let mut at = 0;
            while at < queue.len() {
                for &twin in &halves.twins[3 * queue[at] as usize..3 * queue[at] as usize + 3] {
                    let other = twin as usize / 3;
                    if twin != NONE && piece_of[other] == NONE && labels[other] == label {
                        piece_of[other] = piece;
                        queue.push(other as u32);
                    }
                }
                at += 1;
            }
            pieces.push((label, queue.len() as u32));
        }
        let mut largest = vec![NONE; self.clusters.len()];
        for (piece, &(label, triangles)) in (0..).zip(&pieces) {
            let best = &mut largest[label as usize];
            if *best == NONE || pieces[*best as usize].1 < triangles {
                *best = piece;
            }
        }
        let mut cell_of_piece = Vec::with_capacity(pieces.len());
        for (piece, &(label, _)) in (0..).zip(&pieces) {
            cell_of_piece.push(if largest[label as usize] == piece { label } else { self.add(label) });
        }
        for (cell, piece) in self.of_triangle.iter_mut().zip(piece_of) {
            *cell = cell_of_piece[piece as usize];
        }
    }

    /// Divides connected cells into disks, and gives the half-edges that cross between them.
    pub fn divide_into_disks(&mut self, halves: &HalfEdges, geometry: &Geometry) -> Vec<u32> {
        let crossing = halves.crossing(&self.of_triangle);
        let euler = halves.euler_of_cells(&self.of_triangle, self.clusters.len(), &crossing);
        let mut has_triangle = vec![false; euler.len()];
        self.of_triangle.iter().for_each(|&cell| has_triangle[cell as usize] = true);
        let is_disk: Vec<bool> = euler.iter().zip(has_triangle).map(|(&euler, has)| euler == 1 || !has).collect();
        if is_disk.iter().all(|&is_disk| is_disk) {
            return crossing;
        }
        let mut triangles: Vec<Vec<u32>> = vec![Vec::new(); is_disk.len()];
        for (triangle, &cell) in (0..).zip(&self.of_triangle) {
            if !is_disk[cell as usize] {
                triangles[cell as usize].push(triangle);
            }
        }
        let mut halver = Halver::new(halves, geometry);
        let mut open: Vec<(u32, Vec<u32>)> =
            (0..).zip(triangles).filter(|(_, triangles)| !triangles.is_empty()).collect();
        open.reverse();
        while let Some((cell, triangles)) = open.pop() {
            let [first, second] = halver.divide(&self.of_triangle, triangles);
            let new = self.add(self.clusters[cell as usize]);
            second.iter().for_each(|&triangle| self.of_triangle[triangle as usize] = new);
            for (cell, triangles) in [(new, second), (cell, first)] {
                if !halver.is_disk(&self.of_triangle, &triangles) {
                    open.push((cell, triangles));
                }
            }
        }
        halves.crossing(&self.of_triangle)
    }
}

/// Divides cells, with memory for all of them.
struct Halver<'a> {
    halves: &'a HalfEdges,
    geometry: &'a Geometry,
    /// The side that each triangle is on; [`UNKNOWN`] outside of the cell and before it is known.
    side: Vec<u8>,
}

const UNKNOWN: u8 = 2;

impl<'a> Halver<'a> {
    fn new(halves: &'a HalfEdges, geometry: &'a Geometry) -> Self {
        Self { halves, geometry, side: vec![UNKNOWN; halves.triangles.len()] }
    }

    /// Two connected halves of a connected cell of at least two triangles.
    fn divide(&mut self, cells: &[u32], triangles: Vec<u32>) -> [Vec<u32>; 2] {
        const ROUNDS: usize = 5;
        let far = self.farthest(cells, &triangles, triangles[0]);
        let mut seeds = [far, self.farthest(cells, &triangles, far)];
        let mut sides = [Vec::new(), Vec::new()];
        for _ in 0..ROUNDS {
            sides = self.grow(cells, &triangles, seeds);
            seeds = [0, 1].map(|side| self.nearest(&sides[side], self.geometry.mean(&sides[side])));
        }
        sides
    }

    /// The last triangle that a walk over the cell, breadth first, comes to.
    fn farthest(&mut self, cells: &[u32], triangles: &[u32], start: u32) -> u32 {
        let mut queue = vec![start];
        self.side[start as usize] = 0;
        let mut at = 0;
        while at < queue.len() {
            for other in beside(self.halves, cells, queue[at]) {
                if std::mem::replace(&mut self.side[other as usize], 0) == UNKNOWN {
                    queue.push(other);
                }
            }
            at += 1;
        }
        triangles.iter().for_each(|&triangle| self.side[triangle as usize] = UNKNOWN);
        queue[at - 1]
    }

    /// Grows two sides from two seeds, triangles near a side's seed first; of equally near ones, those first that were
    /// found first.
    fn grow(&mut self, cells: &[u32], triangles: &[u32], seeds: [u32; 2]) -> [Vec<u32>; 2] {
        let centroids = &self.geometry.centroids;
        let mut found = 0u32;
        // squares are not negative, so that their bits are in the order of their values
        let mut heap: BinaryHeap<Reverse<(u64, u32, u8, u32)>> = BinaryHeap::new();
        for side in [0, 1] {
            heap.push(Reverse((0, found, side, seeds[side as usize])));
            found += 1;
        }
        while let Some(Reverse((_, _, side, triangle))) = heap.pop() {
            if self.side[triangle as usize] != UNKNOWN {
                continue;
            }
            self.side[triangle as usize] = side;
            for other in beside(self.halves, cells, triangle) {
                if self.side[other as usize] == UNKNOWN {
                    let seed = centroids[seeds[side as usize] as usize];
                    let distance = centroids[other as usize].distance_squared(seed);
                    heap.push(Reverse((distance.to_bits(), found, side, other)));
                    found += 1;
                }
            }
        }
        let (second, first) = triangles.iter().partition(|&&triangle| self.side[triangle as usize] == 1);
        triangles.iter().for_each(|&triangle| self.side[triangle as usize] = UNKNOWN);
        [first, second]
    }

    /// The triangle whose centroid is nearest to a point; of several, the first.
    fn nearest(&self, triangles: &[u32], point: DVec3) -> u32 {
        let distance = |triangle: u32| self.geometry.centroids[triangle as usize].distance_squared(point);
        let nearer = |best: u32, triangle: u32| if distance(triangle) < distance(best) { triangle } else { best };
        triangles.iter().copied().reduce(nearer).unwrap_or(NONE)
    }

    /// Whether a connected cell of these triangles is a disk.
    fn is_disk(&self, cells: &[u32], triangles: &[u32]) -> bool {
        let halves = self.halves;
        let mut umbrellas = Vec::with_capacity(3 * triangles.len());
        let (mut border, mut outer) = (0, Vec::new());
        for half in triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3) {
            let umbrella = halves.umbrella[half as usize];
            umbrellas.push(umbrella);
            if halves.crosses(cells, half) {
                border += 1;
                outer.push(umbrella);
            }
        }
        // an open umbrella inside one cell has a boundary half-edge, which crosses
        for list in [&mut umbrellas, &mut outer] {
            list.sort_unstable();
            list.dedup();
        }
        let inner_vertices = umbrellas.len() as i64 - outer.len() as i64;
        let inner_edges = (3 * triangles.len() as i64 - border) / 2;
        triangles.len() as i64 - inner_edges + inner_vertices == 1
    }
}

/// The triangles of the same cell across the edges of one.
fn beside<'a>(halves: &'a HalfEdges, cells: &'a [u32], triangle: u32) -> impl Iterator<Item = u32> + 'a {
    let inside = (3 * triangle..3 * triangle + 3).filter(|&half| !halves.crosses(cells, half));
    inside.map(|half| halves.twins[half as usize] / 3)
}
