//! The tolerance: how far a corner of a face may be from the shape of its cluster.
//!
//! Corners alone do not show how far a chord is from an arc: all corners of the bottom of a cylinder lie on its side.
//! So middles of edges must be near, too, but as far as [`CHORDS`] tolerances. All edges of a bottom that is one
//! polygon lie on the side: so its middle must be near, as far as [`MIDDLES`] tolerances and half of its corners'
//! distance from it.
//!
//! Distances are f64 with + − × √, of places that are not rounded to the lattice: every machine computes the same bits.

use glam::DVec3;

use super::geometric;
use super::kind::Kind;
use super::moments::SHIFT;
use super::shape::Shape;
use crate::surface::corners::Corners;

/// Tolerances that the middle of an edge may be from a curved shape.
const CHORDS: f64 = 2.0;

/// The same of the middle of a polygon: that of a regular hexagon is four times as far as those of its edges.
const MIDDLES: f64 = 4.0 * CHORDS;

/// A shape whose farthest corners are this many tolerances apart is not worth to be fitted to them.
const FARTHEST: f64 = 4.0;

/// A tolerance for the faces of a mesh.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance<'a> {
    /// The corners of the faces, internal order.
    pub corners: &'a Corners,
    /// No corner is further from its shape, in lattice units.
    pub distance: f64,
}

impl Tolerance<'_> {
    /// Whether the corners of some faces, the middles of their edges, and those of polygons, are within the tolerance
    /// of a shape, given in units of moments.
    pub fn admits(&self, shape: &Shape, mut faces: impl Iterator<Item = u32>) -> bool {
        let shape = shape.scaled(f64::from(1u32 << SHIFT));
        let is_near = |at: DVec3, tolerance: f64| shape.distance(at).abs() <= tolerance;
        let has_chords = shape.kind() != Kind::Plane;
        let middle_is_near = |[a, b]: [u32; 2]| {
            is_near((self.corners.position(a) + self.corners.position(b)) / 2.0, CHORDS * self.distance)
        };
        let has_near_middle = |face: u32| {
            if self.corners.of(face).len() <= 3 {
                return true;
            }
            let middle = self.middle(face);
            let reach = self.corners.positions_of(face).map(|at| at.distance(middle)).fold(0.0, f64::max);
            is_near(middle, (MIDDLES * self.distance).min(reach / 2.0))
        };
        faces.all(|face| {
            self.corners.positions_of(face).all(|at| is_near(at, self.distance))
                && (!has_chords || has_near_middle(face) && self.corners.edges_of(face).all(middle_is_near))
        })
    }

    /// A shape of this type that some faces are within the tolerance of, if one is found: midway between
    /// the farthest corners on both sides of the one that is given, or of the one nearest to the corners.
    pub fn reached_from(&self, start: &Shape, faces: impl Iterator<Item = u32> + Clone) -> Option<Shape> {
        let start = start.scaled(f64::from(1u32 << SHIFT));
        let corners = || faces.clone().flat_map(|face| self.corners.positions_of(face));
        let spread = |shape: &Shape| {
            let mut spread = (f64::INFINITY, f64::NEG_INFINITY);
            for distance in corners().map(|at| shape.distance(at)) {
                spread = (distance.min(spread.0), distance.max(spread.1));
                if spread.1 - spread.0 > FARTHEST * self.distance {
                    return None;
                }
            }
            Some(spread)
        };
        let nearest = || geometric::fit(&corners().map(|at| (at, 1.0)).collect::<Vec<_>>(), &start);
        let midway = |shape: &Shape| {
            let (least, most) = spread(shape)?;
            let midway = shape.moved_out((least + most) / 2.0).scaled(1.0 / f64::from(1u32 << SHIFT));
            self.admits(&midway, faces.clone()).then_some(midway)
        };
        spread(&start)?;
        midway(&start).or_else(|| midway(&nearest()))
    }

    /// The mean place of the edges of a face, wherever its corners crowd.
    fn middle(&self, face: u32) -> DVec3 {
        let edges = self.corners.edges_of(face).map(|edge| edge.map(|end| self.corners.position(end)));
        let (sum, length) = edges.fold((DVec3::ZERO, 0.0), |(sum, length), [a, b]| {
            let edge = a.distance(b);
            (sum + (a + b) / 2.0 * edge, length + edge)
        });
        if length > 0.0 { sum / length } else { self.corners.position(self.corners.of(face)[0]) }
    }

    /// The largest mean square of distances, in squared units of moments.
    pub fn mean_square(&self) -> f64 {
        let distance = self.distance / f64::from(1u32 << SHIFT);
        distance * distance
    }

    /// The plane of a face, in units of moments: across its vector area, or without area along its corners.
    pub fn plane_of(&self, face: u32) -> Shape {
        let corners = self.corners.positions_of(face);
        let count = self.corners.of(face).len() as f64;
        let point = corners.clone().sum::<DVec3>() / count;
        let first = corners.clone().next().unwrap_or_default();
        let pairs = corners.clone().zip(corners.clone().skip(1));
        let area: DVec3 = pairs.map(|(a, b)| (a - first).cross(b - first)).sum();
        let length = area.length();
        let plane = match length > 0.0 {
            true => Shape::Plane { point, normal: area / length },
            false => Shape::plane_at(point, corners.map(|at| (at, 1.0))),
        };
        plane.scaled(1.0 / f64::from(1u32 << SHIFT))
    }
}
