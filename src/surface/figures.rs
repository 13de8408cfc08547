//! What a clustering is worth, in f64 from the source positions: for reports, never for labels.

use std::ops::Range;

use glam::DVec3;

use super::Surface;
use super::lattice::PIECE;
use super::of_faces::OfFaces;
use crate::mesh::Frame;
use crate::parallel;

impl<E: OfFaces> Surface<E> {
    /// The frame of the lattice.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Energy of labels (internal order, each below `clusters`) in source units: Σ area·|point − P|² with P the
    /// area-weighted mean of the cluster's points (P§6, Eq. 4), which are centroids or normals ([`OfFaces`]); area ×
    /// density where there is one.
    pub fn source_energy(&self, labels: &[u32], clusters: usize) -> f64 {
        self.in_source_units(self.lattice_energy(labels, clusters))
    }

    /// Number of feature edges that have one cluster on both sides; labels in internal order.
    pub fn feature_edges_inside(&self, labels: &[u32]) -> u64 {
        let label = |face: u32| labels.get(face as usize);
        let is_inside = |pair: &&[u32; 2]| label(pair[0]).is_some() && label(pair[0]) == label(pair[1]);
        self.features.iter().filter(is_inside).count() as u64
    }

    /// The [energy](Self::source_energy), and that over the energy of a flat tiling of the same area by as many regular
    /// hexagons, less what lies inside the faces: `5/(18√3)·A²/k − inside`. None when that difference leaves less than
    /// half of the tiling's energy, and where such a tiling is no measure: with a density, and of energies by normals.
    pub fn energy_and_hexagon_ratio(&self, labels: &[u32], clusters: usize) -> (f64, Option<f64>) {
        let energy = self.lattice_energy(labels, clusters);
        (self.in_source_units(energy), self.tiling(clusters).map(|tiling| energy / tiling))
    }

    /// A length in lattice units, given its share of the diagonal of the bounding box for that in the source; at most
    /// the diagonal.
    pub fn on_lattice(&self, share_of: impl FnOnce(f64) -> f64) -> f64 {
        let diagonal = self.frame.diagonal;
        share_of(libm::ldexp(diagonal, -self.frame.exponent)).min(1.0) * diagonal
    }

    /// An energy of lattice areas in source units.
    fn in_source_units(&self, energy: f64) -> f64 {
        libm::ldexp(energy, -2 * (self.frame.exponent + self.units.exponent)) * self.units.density
    }

    /// [`source_energy`](Self::source_energy) in lattice units, which never overflow.
    fn lattice_energy(&self, labels: &[u32], clusters: usize) -> f64 {
        let proxies = by_cluster(clusters, |range| {
            let faces = faces_in(labels, range.clone());
            let point = |(face, label)| (self.position(face), self.geometry[face].area, label);
            E::source_proxies(faces.map(point), range.len())
        });
        let term =
            |face: usize| E::source_term(self.position(face), self.geometry[face].area, proxies[labels[face] as usize]);
        parallel::pieces(labels.len(), PIECE, &|faces| faces.map(term).sum::<f64>()).into_iter().sum()
    }

    fn position(&self, face: usize) -> E::Position {
        E::position(&self.geometry[face], self.normal(face))
    }

    /// The energy of a flat tiling that faces of this size can have, lattice units.
    fn tiling(&self, clusters: usize) -> Option<f64> {
        let inside = self.moment_inside_faces.filter(|_| E::HAS_TILING && !self.has_density)?;
        let area = |faces: Range<usize>| self.geometry[faces].iter().map(|face| face.area).sum::<f64>();
        let area: f64 = parallel::pieces(self.geometry.len(), PIECE, &area).into_iter().sum();
        let tiling = 5.0 / (18.0 * 3.0f64.sqrt()) * area * area / clusters as f64;
        (tiling - inside > tiling / 2.0).then_some(tiling - inside)
    }

    /// L2,1 (Cohen-Steiner et al. 2004), Σ area·|n − N|² with N the direction of the mean normal of the cluster, where
    /// the diagonal of the bounding box has length 1; computed as Σ 2·(M − |S|), M the area of a cluster and S its
    /// vector area. None where the energy is of places.
    pub fn l21(&self, labels: &[u32], clusters: usize) -> Option<f64> {
        if self.normals.is_empty() {
            return None;
        }
        let figures = by_cluster(clusters, |range| {
            let mut sums = vec![(0.0, DVec3::ZERO); range.len()];
            for (face, label) in faces_in(labels, range) {
                let area = self.geometry[face].area;
                let (sum, vector) = &mut sums[label as usize];
                *sum += area;
                *vector += self.normals[face] * area;
            }
            sums.iter().map(|(sum, vector)| 2.0 * (sum - vector.length()).max(0.0)).collect()
        });
        let lattice: f64 = figures.into_iter().sum();
        Some(lattice / (self.frame.diagonal * self.frame.diagonal) * self.units.density)
    }
}

/// The faces of a range of clusters, and their labels counted from its first.
fn faces_in(labels: &[u32], range: Range<u32>) -> impl Iterator<Item = (usize, u32)> + Clone {
    let first = range.start;
    let faces = labels.iter().enumerate().filter(move |(_, label)| range.contains(label));
    faces.map(move |(face, label)| (face, label - first))
}

/// A figure of each cluster. `of_range` has those of a range of clusters; threads take ranges, and go over all faces.
fn by_cluster<T: Send>(clusters: usize, of_range: impl Fn(Range<u32>) -> Vec<T> + Sync) -> Vec<T> {
    /// Ranges at most: each goes over all labels.
    const MOST: usize = 16;
    let ranges = rayon::current_num_threads().min(MOST).min(clusters);
    let length = clusters.div_ceil(ranges.max(1)).max(1);
    parallel::joined(parallel::pieces(clusters, length, &|range| of_range(range.start as u32..range.end as u32)))
}
