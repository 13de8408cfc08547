//! Tori that curved clusters are slices of, such as fillets that turn.
//!
//! No cluster has a torus as its shape. Where one is much nearer to the corners than the shape is, the report has it,
//! too: the lowest sum of squares from several starts on, by steps as in [`geometric`].
//!
//! One start comes of normals: a torus is a surface of revolution, whose normals meet its axis, and the circle nearest
//! to the corners in half planes of the axis is its tube. The other starts bend a cylinder or a cone to four sides,
//! which noise in the normals of short slices does not touch.

use glam::DVec3;
use serde::Serialize;
use utoipa::ToSchema;

use super::Deviation;
use crate::shapes::eigen::{eigen, smallest};
use crate::shapes::geometric::{self, lowest, solved, squares_of};
use crate::shapes::shape::{Shape, across};

/// Fewer faces have no torus.
pub(super) const FEWEST_FACES: usize = 16;

/// A torus is much nearer if its sum of squares is so many times lower.
const CLEARLY: f64 = 4.0;

/// No radius is larger, over the root of the mean square distance from the mean: arcs of less than some 12° say little.
const LARGEST: f64 = 16.0;

/// A circle of the tube's middle that is smaller, over the radius of the tube, is a point.
const SMALLEST: f64 = 0.05;

/// A shape whose own root mean square distance is below it, over the same root, is near enough.
const NEAR: f64 = 1e-3;

/// Corners, evenly among all, to which tori are fitted from all starts; from the best one on, to all.
const FEW: usize = 512;

/// A torus of which a cluster is a slice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Torus {
    /// Its centre.
    pub centre: [f64; 3],
    /// Across the circle in the middle of the tube, a unit vector.
    pub axis: [f64; 3],
    /// The radius of that circle.
    pub major_radius: f64,
    /// The radius of the tube.
    pub minor_radius: f64,
    /// Whether normals of faces point away from the middle of the tube; false of a fillet in an inner corner.
    pub convex: bool,
    /// Distances of the corners of faces from the torus.
    pub residual: Deviation,
}

/// A torus in units of the lattice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ring {
    pub centre: DVec3,
    pub axis: DVec3,
    pub major: f64,
    pub minor: f64,
}

/// A place beside a torus.
struct Beside {
    /// From the axis, a unit vector.
    out: DVec3,
    /// From the centre along the axis.
    along: f64,
    /// From the nearest point of the circle to the place: away from the axis.
    from_circle: f64,
    /// From there to the place.
    distance: f64,
}

impl Ring {
    /// The torus that is much nearer to weighted places than a curved shape is, if there is one; `normals` are unit
    /// normals of faces, with their places and weights.
    pub fn of(places: &[(DVec3, f64)], normals: &[(DVec3, DVec3, f64)], shape: &Shape) -> Option<Self> {
        let weight: f64 = places.iter().map(|place| place.1).sum();
        let mean = places.iter().map(|&(at, weight)| weight * at).sum::<DVec3>() / weight;
        let square = squares_of(places, |at| (at - mean).length()) / weight;
        let squares_of_shape = squares_of(places, |at| shape.distance(at));
        // NaN is refused, too
        if shape.axis().is_none() && !matches!(shape, Shape::Sphere { .. })
            || squares_of_shape.partial_cmp(&(weight * NEAR * NEAR * square)).is_none_or(|order| order.is_le())
        {
            return None;
        }
        let length = square.sqrt();
        let few: Vec<(DVec3, f64)> = places.iter().copied().step_by(places.len().div_ceil(FEW)).collect();
        let starts = around_axis(&few, normals, mean, length).into_iter().chain(bent(&few, shape, mean));
        let fits = starts.map(|start| start.nearest(&few)).filter(|(_, squares)| squares.is_finite());
        let (ring, squares) = fits.min_by(|a, b| a.1.total_cmp(&b.1))?;
        // the few may say somewhat else than all
        if squares_of(&few, |at| shape.distance(at)) < CLEARLY / 2.0 * squares {
            return None;
        }
        let (ring, squares) = ring.nearest(places);
        let is_torus =
            ring.minor > 0.0 && ring.major >= SMALLEST * ring.minor && ring.major.max(ring.minor) <= LARGEST * length;
        let is_near = |shape: &Shape| squares_of(places, |at| shape.distance(at)) < CLEARLY * squares;
        let any = || ring.beside_it(mean).iter().any(|start| is_near(&geometric::fit(places, start)));
        (is_torus && !is_near(shape) && !any()).then_some(ring)
    }

    /// The sphere and the cone that touch the torus beside a place, and cylinders along its tube and around its axis:
    /// the cluster may not have had their types, or merged as one of another.
    fn beside_it(&self, at: DVec3) -> Vec<Shape> {
        let Self { centre, axis, major, minor } = *self;
        let Beside { out, .. } = self.beside(at);
        let normal = self.normal(at);
        let [across_axis, up] = [normal.dot(out), normal.dot(axis)];
        let from_axis = major + minor * across_axis;
        let tube = Shape::Cylinder { point: centre + major * out, axis: axis.cross(out), radius: minor };
        let around = Shape::Cylinder { point: centre, axis, radius: from_axis };
        let ball = Shape::Sphere {
            centre: centre - major * up / across_axis * axis,
            radius: (major / across_axis + minor).abs(),
        };
        let slope = up.abs() / across_axis.abs();
        let wide = if up * across_axis > 0.0 { -axis } else { axis };
        let apex = centre + minor * up * axis - from_axis / slope * wide;
        let cone = Shape::Cone { apex, axis: wide, slope };
        vec![tube, around, ball, cone]
    }

    fn beside(&self, at: DVec3) -> Beside {
        let from = at - self.centre;
        let along = from.dot(self.axis);
        let flat = from - along * self.axis;
        let from_axis = flat.length();
        let from_circle = from_axis - self.major;
        let distance = (from_circle * from_circle + along * along).sqrt();
        Beside { out: flat / from_axis, along, from_circle, distance }
    }

    /// The distance of a place, below 0 inside.
    pub fn distance(&self, at: DVec3) -> f64 {
        self.beside(at).distance - self.minor
    }

    /// The normal beside a place, away from the middle of the tube.
    pub fn normal(&self, at: DVec3) -> DVec3 {
        let Beside { out, along, from_circle, distance } = self.beside(at);
        (from_circle * out + along * self.axis) / distance
    }

    /// The nearest torus from this one on, and its sum of squares.
    fn nearest(self, places: &[(DVec3, f64)]) -> (Self, f64) {
        let squares_of = |ring: &Self| squares_of(places, |at| ring.distance(at));
        lowest(self, squares_of, |ring| ring.step(places), |ring, by| ring.moved(by))
    }

    /// What lowers the sum of squares most, to first order: the centre, the axis in two directions times the radius of
    /// the circle, and both radii.
    fn step(&self, places: &[(DVec3, f64)]) -> [f64; 7] {
        let u = across(self.axis);
        let v = self.axis.cross(u);
        let slopes = |at: DVec3| {
            let Beside { out, along, from_circle, distance } = self.beside(at);
            let [to_circle, up] = [from_circle, along].map(|part| part / distance);
            let normal = to_circle * out + up * self.axis;
            let from = at - self.centre;
            let turn = |side: DVec3| (up * from.dot(side) - to_circle * along * out.dot(side)) / self.major;
            [-normal.x, -normal.y, -normal.z, turn(u), turn(v), -to_circle, -1.0]
        };
        solved(places, |at| self.distance(at), slopes)
    }

    fn moved(&self, [x, y, z, turn_u, turn_v, major, minor]: [f64; 7]) -> Self {
        let u = across(self.axis);
        let turned = self.axis + (turn_u * u + turn_v * self.axis.cross(u)) / self.major;
        Self {
            centre: self.centre + DVec3::new(x, y, z),
            axis: turned / turned.length(),
            major: self.major + major,
            minor: self.minor + minor,
        }
    }
}

/// The torus around the line that normals meet best. With the line's direction a and moment m = c × a, c a point of it,
/// the normal n at p meets it where a·(p × n) + n·m = 0; the best m of a is linear in a.
fn around_axis(places: &[(DVec3, f64)], normals: &[(DVec3, DVec3, f64)], mean: DVec3, length: f64) -> Option<Ring> {
    let (mut moments, mut mixed, mut of_normals) = ([[0.0; 3]; 3], [[0.0; 3]; 3], [[0.0; 3]; 3]);
    for &(at, normal, weight) in normals {
        let moment = ((at - mean) / length).cross(normal).to_array();
        let normal = normal.to_array();
        for i in 0..3 {
            for j in 0..3 {
                moments[i][j] += weight * moment[i] * moment[j];
                mixed[i][j] += weight * normal[i] * moment[j];
                of_normals[i][j] += weight * normal[i] * normal[j];
            }
        }
    }
    let (values, vectors) = eigen(of_normals);
    // the least squares m of a, and what is left of the squares
    let best_moment = |a: DVec3| {
        let right = mixed.map(|row| DVec3::from(row).dot(a));
        (0..3).fold(DVec3::ZERO, |sum, at| {
            let vector = DVec3::from(vectors.map(|row| row[at]));
            sum - vector.dot(DVec3::from(right)) / values[at] * vector
        })
    };
    let by_axis = [DVec3::X, DVec3::Y, DVec3::Z].map(best_moment);
    let left = std::array::from_fn(|i| {
        std::array::from_fn(|j| moments[i][j] + (0..3).map(|k| mixed[k][i] * by_axis[j][k]).sum::<f64>())
    });
    let axis = DVec3::from(smallest(left).1);
    let point = mean + length * axis.cross(best_moment(axis));
    // the circle nearest to (ρ, z), ρ from the axis and z along it: ρ² + z² = 2·x·ρ + 2·y·z + r² − x² − y²
    let profile = |at: DVec3| {
        let along = (at - point).dot(axis);
        [(at - point - along * axis).length() / length, along / length]
    };
    let [x, y, rest] = solved(
        places,
        |at| -profile(at).iter().map(|x| x * x).sum::<f64>(),
        |at| {
            let [from_axis, along] = profile(at);
            [2.0 * from_axis, 2.0 * along, 1.0]
        },
    );
    let minor = (rest + x * x + y * y).sqrt();
    (x > 0.0).then_some(Ring { centre: point + y * length * axis, axis, major: x * length, minor: minor * length })
}

/// A cylinder, or the one beside the mean of a cone, bent to four sides, as much as its length.
fn bent(places: &[(DVec3, f64)], shape: &Shape, mean: DVec3) -> Vec<Ring> {
    let (foot, direction, minor) = match *shape {
        Shape::Cylinder { point, axis, radius } => (point + (mean - point).dot(axis) * axis, axis, radius),
        Shape::Cone { apex, axis, slope } => {
            let along = (mean - apex).dot(axis);
            (apex + along * axis, axis, slope * along)
        }
        Shape::Plane { .. } | Shape::Sphere { .. } => return Vec::new(),
    };
    let [low, high] = places.iter().fold([0f64; 2], |[low, high], &(at, _)| {
        let along = (at - foot).dot(direction);
        [low.min(along), high.max(along)]
    });
    let side = across(direction);
    let major = high - low;
    let to = |side: DVec3| Ring { centre: foot + major * side, axis: direction.cross(side), major, minor };
    [side, -side, direction.cross(side), -direction.cross(side)].map(to).to_vec()
}
