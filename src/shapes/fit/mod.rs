//! Shapes that fit moments best: in f64 with + − × ÷ √ in a fixed order, so that every machine computes the same bits.
//!
//! Curved shapes are fitted by Taubin's distance, the quadric over the length of its gradient, in a form that stays
//! exact as the curvature goes to 0 (Lukács et al. 1998): the smallest eigenvalue of the covariance of (ζ, y) is the
//! mean squared distance, ζ = (|y|² − mean |y|²) / (2·√mean |y|²).

mod cone;
mod cylinder;
mod plane;
mod sphere;

use glam::DVec3;

use super::central::{Central, CentralHigher};
use super::kind::Kind;
use super::shape::Shape;

/// A larger radius is that of a plane, in units of moments: 64 half boxes.
const LARGEST_RADIUS: f64 = (1u64 << 27) as f64;

/// A smaller radius is none, in units of moments.
const SMALLEST_RADIUS: f64 = 1.0;

/// A shape that fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The shape, in units of moments.
    pub shape: Shape,
    /// The mean squared distance of the samples.
    pub mean_square: f64,
}

/// What is known of a cluster that is fitted.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// Moments up to degree 2.
    pub central: &'a Central,
    /// The others.
    pub higher: &'a CentralHigher,
    /// Axes to begin with.
    pub axes: &'a [DVec3],
}

/// The plane that fits best.
pub fn plane(central: &Central) -> Fit {
    plane::fit(central)
}

/// The shape of a type that fits best, if there is one.
pub fn of_kind(kind: Kind, known: Known<'_>) -> Option<Fit> {
    match kind {
        Kind::Plane => Some(plane::fit(known.central)),
        Kind::Sphere => sphere::fit(known),
        Kind::Cylinder => cylinder::fit(known),
        Kind::Cone => cone::fit(known),
    }
}

/// The centre, from the mean, and the radius of what an eigenvector describes: ζ's part, over the scale, and the rest.
/// `square` is mean |y|².
fn round(zeta: f64, rest: DVec3, square: f64) -> Option<(DVec3, f64)> {
    if zeta.abs() * 2.0 * LARGEST_RADIUS < 1.0 {
        return None;
    }
    let centre = -rest / (2.0 * zeta);
    let radius = (centre.dot(centre) + square).sqrt();
    (SMALLEST_RADIUS..=LARGEST_RADIUS).contains(&radius).then_some((centre, radius))
}

#[cfg(test)]
mod tests;
