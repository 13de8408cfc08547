//! Shapes in f64.

use glam::DVec3;

use super::eigen::smallest;
use super::kind::Kind;

/// A shape. Unit vectors for directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A plane.
    Plane {
        /// On it.
        point: DVec3,
        /// Across it.
        normal: DVec3,
    },
    /// A sphere.
    Sphere {
        /// Its centre.
        centre: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// A cylinder.
    Cylinder {
        /// On its axis.
        point: DVec3,
        /// Along it.
        axis: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// A cone, on one side of its apex.
    Cone {
        /// Its apex.
        apex: DVec3,
        /// From there into the cone.
        axis: DVec3,
        /// How much the radius grows along the axis: the tangent of half the opening angle.
        slope: f64,
    },
}

/// A cone beside a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct BesideCone {
    /// From the axis to the place, a unit vector.
    pub out: DVec3,
    /// The distance from the axis.
    pub from_axis: f64,
    /// The place along the axis, from the apex on.
    pub along: f64,
    /// The cosine of half the opening angle.
    pub cosine: f64,
    /// The distance from the nearest generator, below 0 inside.
    pub distance: f64,
}

/// A shape beside a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tangent {
    /// The nearest point of the shape.
    pub point: DVec3,
    /// The normal there: away from the centre, or from the axis and the inside.
    pub normal: DVec3,
    /// The largest: 1 over the radius, 0 of a plane.
    pub curvature: f64,
    /// The axis of a cylinder or a cone.
    pub axis: Option<DVec3>,
}

/// A unit vector across a unit vector.
pub fn across(direction: DVec3) -> DVec3 {
    let other = if direction.x.abs() < 0.6 { DVec3::X } else { DVec3::Y };
    let across = direction.cross(other);
    across / across.length()
}

impl Shape {
    /// The plane through their mean that is nearest to weighted places.
    pub fn plane_at(mean: DVec3, places: impl Iterator<Item = (DVec3, f64)>) -> Self {
        let mut about = [[0.0; 3]; 3];
        for (at, weight) in places {
            let from = (at - mean).to_array();
            for (row, x) in about.iter_mut().zip(from) {
                row.iter_mut().zip(from).for_each(|(sum, y)| *sum += weight * x * y);
            }
        }
        Shape::Plane { point: mean, normal: DVec3::from(smallest(about).1) }
    }

    /// Its type.
    pub fn kind(&self) -> Kind {
        match self {
            Shape::Plane { .. } => Kind::Plane,
            Shape::Sphere { .. } => Kind::Sphere,
            Shape::Cylinder { .. } => Kind::Cylinder,
            Shape::Cone { .. } => Kind::Cone,
        }
    }

    /// The axis of a cylinder or a cone.
    pub fn axis(&self) -> Option<DVec3> {
        match *self {
            Shape::Cylinder { axis, .. } | Shape::Cone { axis, .. } => Some(axis),
            Shape::Plane { .. } | Shape::Sphere { .. } => None,
        }
    }

    /// The shape with lengths multiplied by `by`.
    pub fn scaled(&self, by: f64) -> Self {
        match *self {
            Shape::Plane { point, normal } => Shape::Plane { point: point * by, normal },
            Shape::Sphere { centre, radius } => Shape::Sphere { centre: centre * by, radius: radius * by },
            Shape::Cylinder { point, axis, radius } => Shape::Cylinder { point: point * by, axis, radius: radius * by },
            Shape::Cone { apex, axis, slope } => Shape::Cone { apex: apex * by, axis, slope },
        }
    }

    /// The shape whose distances are less by `by`.
    pub fn moved_out(&self, by: f64) -> Self {
        match *self {
            Shape::Plane { point, normal } => Shape::Plane { point: point + by * normal, normal },
            Shape::Sphere { centre, radius } => Shape::Sphere { centre, radius: radius + by },
            Shape::Cylinder { point, axis, radius } => Shape::Cylinder { point, axis, radius: radius + by },
            Shape::Cone { apex, axis, slope } => {
                let sine = slope / (1.0 + slope * slope).sqrt();
                Shape::Cone { apex: apex - by / sine * axis, axis, slope }
            }
        }
    }

    /// The shape beside a place.
    pub fn tangent(&self, at: DVec3) -> Tangent {
        let round = |centre: DVec3, radius: f64, out: DVec3, axis: Option<DVec3>| {
            let length = out.length();
            let is_middle = length <= 1e-6 * radius;
            let normal = if is_middle { across(axis.unwrap_or(DVec3::Z)) } else { out / length };
            Tangent { point: centre + radius * normal, normal, curvature: 1.0 / radius, axis }
        };
        match *self {
            Shape::Plane { point, normal } => {
                Tangent { point: at - (at - point).dot(normal) * normal, normal, curvature: 0.0, axis: None }
            }
            Shape::Sphere { centre, radius } => round(centre, radius, at - centre, None),
            Shape::Cylinder { point, axis, radius } => {
                let along = (at - point).dot(axis) * axis;
                round(point + along, radius, at - point - along, Some(axis))
            }
            Shape::Cone { apex, axis, slope } => {
                let BesideCone { out, from_axis, cosine, distance, .. } = beside_cone(apex, axis, slope, at);
                let normal = cosine * (out - slope * axis);
                Tangent { point: at - distance * normal, normal, curvature: cosine / from_axis, axis: Some(axis) }
            }
        }
    }

    /// The distance of a place, below 0 inside or behind.
    pub fn distance(&self, at: DVec3) -> f64 {
        match *self {
            Shape::Plane { point, normal } => (at - point).dot(normal),
            Shape::Sphere { centre, radius } => (at - centre).length() - radius,
            Shape::Cylinder { point, axis, radius } => {
                let from = at - point;
                (from - from.dot(axis) * axis).length() - radius
            }
            Shape::Cone { apex, axis, slope } => {
                let BesideCone { from_axis, along, distance, .. } = beside_cone(apex, axis, slope, at);
                // beyond the apex, the apex is nearest
                if along + slope * from_axis < 0.0 { (at - apex).length() } else { distance }
            }
        }
    }
}

/// A cone beside a place.
pub(super) fn beside_cone(apex: DVec3, axis: DVec3, slope: f64, at: DVec3) -> BesideCone {
    let from = at - apex;
    let along = from.dot(axis);
    let across_axis = from - along * axis;
    let from_axis = across_axis.length();
    let is_middle = from_axis <= 1e-9 * along.abs();
    let out = if is_middle { across(axis) } else { across_axis / from_axis };
    let cosine = 1.0 / (1.0 + slope * slope).sqrt();
    BesideCone { out, from_axis, along, cosine, distance: cosine * (from_axis - slope * along) }
}
