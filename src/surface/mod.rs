//! The surface as the algorithms see it: integer centroids and weights, and which faces share an edge.
//!
//! [`Surface::build`] takes a mesh through five steps, each a file here: positions that are exactly equal become one
//! vertex (`weld`), faces that share an edge become neighbours (`adjacency`), connected sets of faces become components
//! (`components`; `bridge` can join them), positions and areas become integers (`lattice`), and faces get an internal
//! order that keeps neighbours close in memory (`order`). Faces at `features` are no neighbours. Faces without area
//! that share no edge are left out (`loose`). Areas are first multiplied by a `density`, if there is one, which may
//! come from the `curvature`. [`points`] makes a surface of the points of a triangle mesh in place of its faces.
//! Everything up to the lattice is scalar f64 with + − × ÷ √ (and one power, from the `libm` crate) in a fixed order,
//! so the result is the same on every machine and for any number of threads.
//!
//! It knows no algorithm and no device; of clusters it knows the sums, whose energy it converts to source units.
//!
//! Adjacency and components on one side and the order on the other are computed at the same time; then rows, centroids
//! and areas are gathered in that order, in chunks.

mod adjacency;
pub(crate) mod bridge;
mod coarse;
pub(crate) mod components;
pub mod corners;
mod counts;
mod curvature;
mod density;
pub(crate) mod detour;
mod features;
pub mod figures;
mod graph;
mod items;
pub(crate) mod lattice;
mod loose;
pub mod of_faces;
pub(crate) mod order;
pub mod points;
pub(crate) mod rows;
pub mod samples;
mod seen;
pub(crate) mod weld;

pub use adjacency::{MOST_CORNERS, MOST_POSITIONS};
pub use coarse::{Coarse, Grouping, number_by_first_face};
pub use components::Component;
pub use counts::Counts;
pub use density::Wanted;
pub use features::WantedFeatures;
#[cfg(test)]
pub use graph::LOOKS;
pub use graph::{DualGraph, Moves};
pub use items::{Items, Units};
pub use loose::Loose;
pub use order::NO_FACE;
pub use rows::Rows;

use std::ops::{Deref, Range};

use glam::DVec3;
use rayon::prelude::*;

use crate::energy::{Energy, Functional};
use crate::error::{Error, Result};
use crate::mesh::{Frame, MeshView, PolygonMesh};
use adjacency::Links;
use components::NO_COMPONENT;
use density::Density;
use features::Features;
use lattice::{COORDINATE_BITS, FaceGeometry, PIECE};
use of_faces::OfFaces as _;
use weld::UNUSED;

/// Largest number of faces.
pub const MOST_FACES: usize = 1 << 31;

fn check_number(what: &str, number: usize, most: usize) -> Result<()> {
    match number <= most {
        true => Ok(()),
        false => Err(Error::too_large(format_args!("the mesh has more {what} than can be numbered, {most}: {number}"))),
    }
}

/// A mesh on the integer lattice, faces in an internal order chosen for locality.
#[derive(Debug)]
pub struct Surface<E: Functional = Energy> {
    /// What algorithms see of it; fields and methods can be used as the surface's own.
    pub items: Items<E>,
    /// What was counted on the way.
    pub counts: Counts,
    /// Centroids and areas in f64, internal order: for energies in source units, never for labels.
    geometry: Vec<FaceGeometry>,
    /// Unit normals, 0 without area, internal order; none where the energy is of places.
    normals: Vec<DVec3>,
    frame: Frame,
    /// What lies inside the faces and no energy of faces can see, lattice units: Σ area·(|ab|²+|bc|²+|ca|²)/36 over
    /// triangles, and area·|triangle centroid − face centroid|². None of points.
    moment_inside_faces: Option<f64>,
    /// Whether areas are relative to a density.
    has_density: bool,
    /// Pairs of faces at feature edges, internal numbers; [`NO_FACE`] of a loose one. An edge of more than two faces
    /// has a pair for each two that follow each other.
    pub features: Vec<[u32; 2]>,
}

impl Surface {
    /// Puts a mesh on the lattice. Components that share no edge stay apart.
    ///
    /// Fails like [`build_with`](Self::build_with).
    pub fn build(mesh: &PolygonMesh) -> Result<Self> {
        Self::build_with(mesh, false, Wanted::default(), None)
    }

    /// Puts a mesh on the lattice; with `bridge`, joins its components into one; with a density, areas count that much;
    /// faces at a feature are no neighbours.
    ///
    /// Fails for meshes of more than [`MOST_FACES`], [`MOST_CORNERS`] or [`MOST_POSITIONS`], for weights that are not
    /// one a face or vertex, finite and above 0, and for groups that are not one a face. Corners must be valid indices
    /// of finite positions, as [`crate::mesh::read`] promises.
    pub fn build_with<'a>(
        mesh: impl Into<MeshView<'a>>,
        bridge: bool,
        wanted: Wanted<'_>,
        features: Option<WantedFeatures<'_>>,
    ) -> Result<Self> {
        let mesh = mesh.into();
        let faces = mesh.faces.len();
        let corners = mesh.faces.all_corners().len();
        for (what, number, most) in [("faces", faces, MOST_FACES), ("corners", corners, MOST_CORNERS)] {
            check_number(what, number, most)?;
        }
        // from within the pool, parallel steps need not wake it
        rayon::scope(|_| {
            let features = features.map(|wanted| Features::of(mesh, wanted)).transpose()?;
            Self::build_in_pool(mesh, bridge, wanted, features)
        })
    }

    fn build_in_pool(
        mesh: MeshView<'_>,
        bridge: bool,
        wanted: Wanted<'_>,
        features: Option<Features<'_>>,
    ) -> Result<Self> {
        let faces = mesh.faces.len();
        let (weld, positions) = weld::weld(mesh);
        check_number("positions", weld.vertices as usize, MOST_POSITIONS)?;
        let used = mesh.positions.iter().zip(&weld.position_of_vertex).filter(|(_, position)| **position != UNUSED);
        let frame = Frame::of(used.map(|(position, _)| position), COORDINATE_BITS);
        let connect = || {
            let links = Links::new(mesh.faces, positions, weld.vertices, features.as_ref());
            let components = components::label(faces, &links);
            (links, components)
        };
        let along_curve = || order::along_curve(faces, &|faces, visit| frame.each_centroid(mesh, faces, visit));
        let ((mut links, mut components), mut sorted) = rayon::join(connect, along_curve);
        let loose = loose::find(mesh, &frame, &weld, &components, &sorted);
        if !loose.is_empty() {
            components.leave_out(loose.iter().map(|loose| loose.face));
            sorted.retain(|&face| components.of_face[face as usize] != NO_COMPONENT);
        }
        let mut counts = Counts {
            components: components.count as u64,
            welded_vertices: u64::from(weld.vertices),
            loose_faces: loose.len() as u64,
            ..links.counts
        };
        let density = Density::of(mesh, &weld, &frame, wanted)?;
        drop(weld);
        let density_of = |face: usize| density.as_ref().map(|density| density.of_face[face]);
        if bridge && components.count > 1 {
            links.bridge(bridge::bridges(&frame.faces(mesh, density_of), &components));
            components = components::label(faces, &links);
            components.leave_out(loose.iter().map(|loose| loose.face));
        }

        let upload_face = order::by_component(sorted, &components);
        let runs = components.runs(&upload_face);
        drop(components);
        let internal = order::inverse(&upload_face, faces);
        let (rows, repeating) = links.compressed(&upload_face, &internal);
        let features: Vec<_> = links.features.iter().map(|pair| pair.map(|face| internal[face as usize])).collect();
        counts.duplicate_faces = links.duplicates(&repeating);
        // their memory is for the geometry
        drop((internal, links));
        let gathered = Gathered::new(mesh, &frame, &upload_face, density_of);
        counts.zero_area_faces = gathered.zero_area_faces + counts.loose_faces;
        counts.tiny_faces = gathered.tiny_faces;
        let density_unit = density.map(|density| density.unit);
        let surface = Self::of(gathered, &runs, rows, upload_face, counts, frame, density_unit);
        Ok(Self { items: Items { loose, has_features: !features.is_empty(), ..surface.items }, features, ..surface })
    }

    /// Weighs the items that were gathered.
    fn of(
        gathered: Gathered,
        runs: &[Range<usize>],
        neighbours: Rows,
        upload_face: Vec<u32>,
        counts: Counts,
        frame: Frame,
        density_unit: Option<f64>,
    ) -> Self {
        let Gathered { geometry, points, moment_inside_faces, .. } = gathered;
        let (weights, components, exponent) = lattice::weigh(|face| geometry[face].area, runs);
        let graph = DualGraph { points, weights, neighbours, components, moves: Moves::Free };
        // areas are in squared lengths
        let weight_exponent = -2 * frame.exponent - exponent;
        let units = Energy::units(&frame, weight_exponent, density_unit.unwrap_or(1.0));
        let items = Items::new(graph, upload_face, units);
        Self {
            items,
            counts,
            geometry,
            normals: Vec::new(),
            frame,
            moment_inside_faces,
            has_density: density_unit.is_some(),
            features: Vec::new(),
        }
    }
}

/// The faces on the lattice, internal order.
struct Gathered {
    geometry: Vec<FaceGeometry>,
    points: Vec<[i32; 3]>,
    moment_inside_faces: Option<f64>,
    zero_area_faces: u64,
    tiny_faces: u64,
}

impl Gathered {
    fn new(
        mesh: MeshView<'_>,
        frame: &Frame,
        upload_face: &[u32],
        density: impl Fn(usize) -> Option<f64> + Sync,
    ) -> Self {
        let mut geometry: Vec<FaceGeometry> =
            rayon::iter::repeat_n(FaceGeometry::default(), upload_face.len()).with_min_len(PIECE).collect();
        let mut points = vec![[0; 3]; upload_face.len()];
        let sums: Vec<(f64, u64, u64)> = geometry
            .par_chunks_mut(PIECE)
            .zip(points.par_chunks_mut(PIECE))
            .zip(upload_face.par_chunks(PIECE))
            .map(|((geometry, points), faces)| {
                let (mut inside, mut without_area, mut tiny) = (0.0, 0, 0);
                frame.each_face(mesh, faces, |at, mut of_face, inside_face| {
                    inside += inside_face;
                    without_area += u64::from(of_face.area <= 0.0);
                    tiny += u64::from(of_face.area > 0.0 && of_face.area < 1.0);
                    if let Some(density) = density(faces[at] as usize) {
                        of_face.area *= density;
                    }
                    points[at] = lattice::round_centroid(of_face.centroid);
                    geometry[at] = of_face;
                });
                (inside, without_area, tiny)
            })
            .collect();
        Self {
            geometry,
            points,
            moment_inside_faces: Some(sums.iter().map(|sum| sum.0).sum()),
            zero_area_faces: sums.iter().map(|sum| sum.1).sum(),
            tiny_faces: sums.iter().map(|sum| sum.2).sum(),
        }
    }
}

impl<E: Functional> Deref for Surface<E> {
    type Target = Items<E>;

    fn deref(&self) -> &Items<E> {
        &self.items
    }
}

#[cfg(test)]
pub(crate) mod tests;
