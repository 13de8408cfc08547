//! The curves between clusters, as data.

use serde::Serialize;
use utoipa::ToSchema;

use super::arcs::Complex;
use super::half_edges::NONE;
use super::surface::{CutSurface, check_labels};
use crate::error::Result;
use crate::mesh::PolygonMesh;

/// The curves between clusters and along the boundary, and the points where they meet. Every edge between two clusters
/// is in one curve. An edge of more than two faces, and one along which a surface cannot be oriented, is a boundary of
/// each of its faces.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Boundaries {
    /// Version of this format: 1.
    pub tesserae: u32,
    /// Positions in source units, of everything here.
    pub points: Vec<[f64; 3]>,
    /// The vertex of the upload that each point is; the first one at its position that a face uses.
    pub point_vertices: Vec<u32>,
    /// Points at which at least three clusters meet; on a boundary, at least two.
    pub junctions: Vec<Junction>,
    /// The curves, by `left`, then by `right`.
    pub curves: Vec<Curve>,
}

/// A point at which curves meet.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Junction {
    /// Number of the point. Several junctions may be at one.
    pub point: u32,
    /// The clusters around it, counter-clockwise seen from outside; on a boundary, from boundary to boundary. One may
    /// be there several times.
    pub clusters: Vec<u32>,
}

/// A curve between two clusters, or of the boundary of one.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Curve {
    /// The cluster on its left, seen from outside.
    pub left: u32,
    /// The cluster on its right, a higher number; null on a boundary.
    pub right: Option<u32>,
    /// Numbers of its points, from start to end. A closed curve does not repeat the first.
    pub points: Vec<u32>,
    /// Number of the junction where it starts; null of a closed curve.
    pub start: Option<u32>,
    /// Number of the junction where it ends; null of a closed curve.
    pub end: Option<u32>,
    /// Whether it is a circle without a junction.
    pub closed: bool,
    /// Its length in source units.
    pub length: f64,
}

impl Boundaries {
    /// The curves between clusters. Fails like [`check_labels`], and for meshes that are too large to number.
    pub fn new(mesh: &PolygonMesh, labels: &[u32], clusters: u64) -> Result<Self> {
        check_labels(mesh, labels, clusters)?;
        let surface = CutSurface::new(mesh)?;
        let cells = surface.labels(labels);
        let complex = Complex::new(&surface.halves, &cells, &surface.halves.crossing(&cells));
        Ok(Self::of(mesh, &surface, &complex))
    }

    fn of(mesh: &PolygonMesh, surface: &CutSurface, complex: &Complex<'_>) -> Self {
        let halves = complex.halves;
        let mut number_of_point = vec![NONE; surface.points.len()];
        let mut point_vertices = Vec::new();
        let mut number = |point: u32| {
            let number = &mut number_of_point[point as usize];
            if *number == NONE {
                *number = point_vertices.len() as u32;
                point_vertices.push(surface.vertices[point as usize]);
            }
            *number
        };
        let junctions = complex.junctions.iter().map(|junction| Junction {
            point: number(halves.origin(halves.umbrellas[junction.umbrella as usize].first)),
            clusters: complex.sectors(junction).iter().map(|&half| complex.left(half)).collect(),
        });
        let junctions = junctions.collect();
        let curves = complex.arcs.iter().map(|arc| {
            let chain = complex.chain(arc);
            let mut points: Vec<u32> = chain.iter().map(|&half| number(halves.origin(half))).collect();
            if let (Some(_), Some(&last)) = (arc.ends, chain.last()) {
                points.push(number(halves.target(last)));
            }
            let length = chain.iter().map(|&half| surface.length(half)).sum();
            Curve {
                left: arc.left,
                right: arc.right,
                points,
                start: arc.ends.map(|[start, _]| start),
                end: arc.ends.map(|[_, end]| end),
                closed: arc.ends.is_none(),
                length: libm::ldexp(length, -surface.frame.exponent),
            }
        });
        let curves = curves.collect();
        let points = point_vertices.iter().map(|&vertex: &u32| mesh.positions[vertex as usize]).collect();
        Self { tesserae: 1, points, point_vertices, junctions, curves }
    }
}
