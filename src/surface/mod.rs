//! The surface as the algorithms see it: integer centroids and weights, and which faces share an edge.
//!
//! [`Surface::build`] takes a mesh through five steps, each a file here: positions that are exactly equal become one
//! vertex (`weld`), faces that share an edge become neighbours (`adjacency`), connected sets of faces become
//! components (`components`; `bridge` can join them), positions and areas become integers (`lattice`), and faces get an
//! internal order that keeps neighbours close in memory (`order`). Where detail shall get smaller clusters, areas are first
//! multiplied by a `density`, which may come from the `curvature`. Everything up to the lattice is scalar f64 with + − × ÷ √
//! (and one power, by a library that is compiled in) in a fixed order, so the result is the same on every machine and for
//! any number of threads.
//!
//! Nothing here knows of clusters, algorithms or devices.

mod adjacency;
mod bridge;
mod coarse;
mod components;
mod curvature;
mod density;
mod graph;
mod lattice;
mod order;
mod weld;

pub use coarse::{Coarse, Grouping};
pub use components::Component;
pub use density::Wanted;
pub use graph::DualGraph;

use std::ops::Deref;

use rayon::prelude::*;

use crate::cluster::sums::ClusterSums;
use crate::device::LatticeEnergy;
use crate::error::{Error, Result};
use crate::mesh::PolygonMesh;
use crate::tree::Merge;
use density::Density;
use lattice::{FaceGeometry, Frame};

/// A mesh on the integer lattice, faces in an internal order chosen for locality.
#[derive(Debug)]
pub struct Surface {
    /// What algorithms and devices see of it; fields and methods of the graph can be used as the surface's own.
    pub graph: DualGraph,
    /// The face of the upload that each internal face is.
    pub upload_face: Vec<u32>,
    /// What was counted on the way.
    pub counts: Counts,
    /// Centroids and areas in f64, internal order: for energies in source units, never for labels.
    geometry: Vec<FaceGeometry>,
    frame: Frame,
    /// Σ over faces of `w·|g|² << energy_shift`: the constant part of the energy.
    moment: i128,
    /// Weights of the finest component are areas in lattice units × 2^this.
    weight_exponent: i32,
    /// What lies inside the faces and no energy of faces can see, lattice units: Σ area·(|ab|²+|bc|²+|ca|²)/36 over
    /// triangles, and area·|triangle centroid − face centroid|².
    moment_inside_faces: f64,
    /// The density that areas here are relative to; none where all area counts alike.
    density_unit: Option<f64>,
}

/// What is unusual about the connectivity.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Sets of faces connected across shared edges, without bridges.
    pub components: u64,
    /// Distinct positions among the vertices that faces use.
    pub welded_vertices: u64,
    /// Edges of exactly one face.
    pub boundary_edges: u64,
    /// Edges of more than two faces.
    pub non_manifold_edges: u64,
    /// Faces with two corners at one position.
    pub degenerate_faces: u64,
    /// Faces without area, degenerate ones included.
    pub zero_area_faces: u64,
    /// Extra copies of faces with the same set of corner positions.
    pub duplicate_faces: u64,
}

impl Surface {
    /// Puts a mesh on the lattice. Components that share no edge stay apart.
    ///
    /// Fails like [`build_with`](Self::build_with).
    pub fn build(mesh: &PolygonMesh) -> Result<Self> {
        Self::build_bridged(mesh, false)
    }

    /// Puts a mesh on the lattice; with `bridge`, joins its components into one.
    ///
    /// Fails like [`build_with`](Self::build_with).
    pub fn build_bridged(mesh: &PolygonMesh, bridge: bool) -> Result<Self> {
        Self::build_with(mesh, bridge, Wanted::default())
    }

    /// Puts a mesh on the lattice; with `bridge`, joins its components into one; with a density, areas count that much.
    ///
    /// Fails for meshes of more than 2³¹ faces or corners, and for weights that are not one a face or vertex, finite and above
    /// 0. Corners must be valid indices of finite positions, as [`crate::mesh::read`] promises.
    pub fn build_with(mesh: &PolygonMesh, bridge: bool, wanted: Wanted<'_>) -> Result<Self> {
        let faces = mesh.faces.len();
        if faces > 1 << 31 || mesh.faces.all_corners().len() > 1 << 31 {
            return Err(Error::too_large(format_args!(
                "the mesh has more faces or corners than {} can be numbered: {faces} faces",
                1u32 << 31
            )));
        }
        let weld = weld::weld(mesh);
        let adjacency::Links { mut pairs, crowded, mut counts } = adjacency::links(&mesh.faces, &weld);
        counts.welded_vertices = u64::from(weld.vertices);

        let frame = Frame::of(mesh);
        let geometry: Vec<(FaceGeometry, f64)> =
            (0..faces).into_par_iter().map(|face| frame.face(mesh, face)).collect();
        let moment_inside_faces = geometry.iter().map(|(_, inside)| inside).sum();
        let mut geometry: Vec<FaceGeometry> = geometry.into_iter().map(|(face, _)| face).collect();
        counts.zero_area_faces = geometry.iter().filter(|face| face.area <= 0.0).count() as u64;
        let density = Density::of(mesh, &weld, &frame, &geometry, wanted)?;
        for (face, density) in geometry.iter_mut().zip(density.iter().flat_map(|density| &density.of_face)) {
            face.area *= density;
        }

        let (mut component_of_face, mut component_count) = components::label(faces, &pairs);
        counts.components = component_count as u64;
        if bridge && component_count > 1 {
            pairs.extend(bridge::bridges(&geometry, &component_of_face, component_count));
            (component_of_face, component_count) = components::label(faces, &pairs);
        }
        let upload_face = order::internal_order(&geometry, &component_of_face, component_count);
        let geometry: Vec<FaceGeometry> = upload_face.par_iter().map(|&face| geometry[face as usize]).collect();
        let (neighbour_offsets, neighbours) = adjacency::compressed(&pairs, &upload_face);
        drop(pairs);
        counts.duplicate_faces =
            adjacency::duplicates(mesh, &weld, &crowded, &upload_face, &neighbour_offsets, &neighbours);

        let runs = components::runs(&component_of_face, &upload_face, component_count);
        let scales = lattice::scales(&geometry, &runs);
        let centroids: Vec<[i32; 3]> = geometry.par_iter().map(|face| lattice::round_centroid(face.centroid)).collect();
        let mut weights = Vec::with_capacity(faces);
        let mut components = Vec::with_capacity(runs.len());
        let mut moment = 0i128;
        for (run, &exponent) in runs.iter().zip(&scales.exponents) {
            let energy_shift = (scales.finest - exponent) as u32;
            let mut weight = 0u64;
            for face in run.clone() {
                let w = lattice::round_weight(geometry[face].area, exponent);
                let square: i64 = centroids[face].iter().map(|&g| i64::from(g) * i64::from(g)).sum();
                moment += (i128::from(w) * i128::from(square)) << energy_shift;
                weight += u64::from(w);
                weights.push(w);
            }
            components.push(Component { first_face: run.start as u32, faces: run.len() as u32, weight, energy_shift });
        }
        Ok(Self {
            graph: DualGraph { centroids, weights, neighbour_offsets, neighbours, components },
            upload_face,
            counts,
            geometry,
            frame,
            moment,
            weight_exponent: scales.finest,
            moment_inside_faces,
            density_unit: density.map(|density| density.unit),
        })
    }

    /// The internal face that each face of the upload is: the inverse of `upload_face`.
    pub fn internal_faces(&self) -> Vec<u32> {
        let mut internal = vec![0; self.faces()];
        for (face, &upload) in self.upload_face.iter().enumerate() {
            internal[upload as usize] = face as u32;
        }
        internal
    }

    /// F in source units (area × length²), exact until this one conversion; infinite when f64 cannot hold it.
    pub fn energy(&self, energy: LatticeEnergy) -> f64 {
        let lattice = (self.moment - energy.explained) as f64;
        libm::ldexp(lattice, -4 * self.frame.exponent - self.weight_exponent) * self.density_unit()
    }

    /// What an area × relative density of 1 counts in source units.
    fn density_unit(&self) -> f64 {
        self.density_unit.unwrap_or(1.0)
    }

    /// w·|g|² of a face, in units of its component: its share of the constant part of the energy.
    pub fn moment_of(&self, face: u32) -> i128 {
        let square: i64 = self.centroids[face as usize].iter().map(|&g| i64::from(g) * i64::from(g)).sum();
        i128::from(self.weights[face as usize]) * i128::from(square)
    }

    /// What becomes of two clusters that merge, in source units: `cost`, `energy`, `faces`, `weight` and `proxy` of the
    /// record are set. `moment` is Σ w·|g|² of both; `face` is any face of either.
    pub fn merged(&self, a: &ClusterSums, b: &ClusterSums, moment: i128, face: u32) -> Merge {
        let component = self.components.partition_point(|component| component.first_face <= face) - 1;
        let energy_exponent =
            -4 * self.frame.exponent - self.weight_exponent + self.components[component].energy_shift as i32;
        let mean = |sums: &ClusterSums| sums.centroid.map(|s| s as f64 / sums.weight as f64);
        let (weight_a, weight_b) = (a.weight as f64, b.weight as f64);
        let (mean_a, mean_b) = (mean(a), mean(b));
        let square: f64 = (0..3).map(|axis| (mean_a[axis] - mean_b[axis]) * (mean_a[axis] - mean_b[axis])).sum();
        let cost = weight_a * weight_b / (weight_a + weight_b) * square;
        let mut sums = *a;
        sums.add(b, 1);
        let explained = sums.fit().map_or(0, |(_, explained)| explained);
        Merge {
            into: 0,
            from: 0,
            cost: libm::ldexp(cost, energy_exponent) * self.density_unit(),
            energy: libm::ldexp((moment - explained) as f64, energy_exponent) * self.density_unit(),
            faces: sums.faces,
            weight: libm::ldexp(sums.weight as f64, energy_exponent + 2 * self.frame.exponent) * self.density_unit(),
            proxy: self.frame.source_position(mean(&sums)),
        }
    }

    /// Energy of labels (internal order, each below `clusters`) in source units, in f64 from the source positions:
    /// Σ area·|centroid − P|² with P the area-weighted mean of the cluster's centroids (P§6, Eq. 4); area × density where
    /// there is one.
    pub fn source_energy(&self, labels: &[u32], clusters: usize) -> f64 {
        libm::ldexp(self.lattice_energy(labels, clusters), -4 * self.frame.exponent) * self.density_unit()
    }

    /// [`source_energy`](Self::source_energy) in lattice units, which never overflow.
    fn lattice_energy(&self, labels: &[u32], clusters: usize) -> f64 {
        let mut sums = vec![[0.0f64; 4]; clusters];
        for (face, &label) in self.geometry.iter().zip(labels) {
            let sum = &mut sums[label as usize];
            for axis in 0..3 {
                sum[axis] += face.area * face.centroid[axis];
            }
            sum[3] += face.area;
        }
        for sum in &mut sums {
            let area = if sum[3] > 0.0 { sum[3] } else { 1.0 };
            for axis in 0..3 {
                sum[axis] /= area;
            }
        }
        let mut energy = 0.0;
        for (face, &label) in self.geometry.iter().zip(labels) {
            let proxy = &sums[label as usize];
            let d: [f64; 3] = std::array::from_fn(|axis| face.centroid[axis] - proxy[axis]);
            energy += face.area * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        }
        energy
    }

    /// Energy of labels over that of a flat tiling of the same area by `clusters` regular hexagons, less what lies inside
    /// the faces: `5/(18√3)·A²/k − inside`. None when that difference leaves less than half of the tiling's energy, and with
    /// a density, for which such a tiling is no measure.
    pub fn hexagon_ratio(&self, labels: &[u32], clusters: usize) -> Option<f64> {
        if self.density_unit.is_some() {
            return None;
        }
        let area: f64 = self.geometry.iter().map(|face| face.area).sum();
        let tiling = 5.0 / (18.0 * 3.0f64.sqrt()) * area * area / clusters as f64;
        let visible = tiling - self.moment_inside_faces;
        (visible > tiling / 2.0).then(|| self.lattice_energy(labels, clusters) / visible)
    }
}

impl Deref for Surface {
    type Target = DualGraph;

    fn deref(&self) -> &DualGraph {
        &self.graph
    }
}

#[cfg(test)]
mod tests;
