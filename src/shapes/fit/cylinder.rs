//! The cylinder that fits best: a circle in the plane across its axis, for the best of some axes, which Newton's method
//! then improves.

use glam::DVec3;

use super::{Fit, Known, round};
use crate::shapes::central::matrix;
use crate::shapes::eigen::smallest;
use crate::shapes::monomials::{PAIRS, place};
use crate::shapes::shape::{Shape, across};

/// Angle between the axes of which differences are taken.
const STEP: f64 = 1e-3;

/// The axis turns by no more at once.
const LARGEST_TURN: f64 = 0.3;

pub(super) fn fit(known: Known<'_>) -> Option<Fit> {
    let (_, across_normals) = smallest(matrix(&known.higher.normals));
    let axes = [DVec3::from(across_normals)].into_iter().chain(known.axes.iter().copied());
    let fits = axes.filter_map(|axis| around(known, axis));
    let best = fits.reduce(|best, fit| if fit.mean_square < best.mean_square { fit } else { best })?;
    Some(improved(known, best).filter(|fit| fit.mean_square < best.mean_square).unwrap_or(best))
}

/// The cylinder around an axis of this direction that fits best.
fn around(Known { central, higher, .. }: Known<'_>, axis: DVec3) -> Option<Fit> {
    let u = across(axis);
    let v = axis.cross(u);
    // |y|² across the axis is Σ t·y·y
    let t: [f64; 6] = std::array::from_fn(|at| {
        let [a, b] = PAIRS[at];
        if a == b { 1.0 - axis[a] * axis[a] } else { -2.0 * axis[a] * axis[b] }
    });
    let (mut square, mut variance, mut with) = (0.0, 0.0, [0.0; 3]);
    for (i, [a, b]) in PAIRS.into_iter().enumerate() {
        square += t[i] * central.second[i];
        for (j, [c, d]) in PAIRS.into_iter().enumerate() {
            variance += t[i] * t[j] * higher.fourth[place([a, b, c, d])];
        }
        for (e, sum) in with.iter_mut().enumerate() {
            *sum += t[i] * higher.third[place([a, b, e])];
        }
    }
    if square <= 0.0 {
        return None;
    }
    let scale = 2.0 * square.sqrt();
    let with = DVec3::from(with) / scale;
    let covariance = central.matrix();
    let between = |x: DVec3, y: DVec3| {
        let rows = covariance.map(|row| DVec3::from(row).dot(y));
        x.dot(DVec3::from(rows))
    };
    let (with_u, with_v, uv) = (with.dot(u), with.dot(v), between(u, v));
    let (mean_square, [zeta, along_u, along_v]) = smallest([
        [(variance - square * square) / (scale * scale), with_u, with_v],
        [with_u, between(u, u), uv],
        [with_v, uv, between(v, v)],
    ]);
    let (centre, radius) = round(zeta / scale, along_u * u + along_v * v, square)?;
    Some(Fit { shape: Shape::Cylinder { point: centre + central.mean, axis, radius }, mean_square })
}

/// The cylinder after one step of Newton's method on the axis, by finite differences of the mean square.
fn improved(known: Known<'_>, best: Fit) -> Option<Fit> {
    let axis = best.shape.axis()?;
    let u = across(axis);
    let w = axis.cross(u);
    let at = |x: f64, y: f64| {
        let turned = axis + x * u + y * w;
        around(known, turned / turned.length())
    };
    let value = |x: f64, y: f64| at(x, y).map(|fit| fit.mean_square);
    let (middle, both) = (best.mean_square, value(STEP, STEP)?);
    let ([x_plus, x_minus], [y_plus, y_minus]) =
        ([value(STEP, 0.0)?, value(-STEP, 0.0)?], [value(0.0, STEP)?, value(0.0, -STEP)?]);
    let (x_slope, y_slope) = ((x_plus - x_minus) / (2.0 * STEP), (y_plus - y_minus) / (2.0 * STEP));
    let bend = |plus: f64, minus: f64| (plus - 2.0 * middle + minus) / (STEP * STEP);
    let (x_bend, y_bend) = (bend(x_plus, x_minus), bend(y_plus, y_minus));
    let mixed = (both - x_plus - y_plus + middle) / (STEP * STEP);
    let determinant = x_bend * y_bend - mixed * mixed;
    // the step lowers the value only if the second derivatives are positive definite
    if x_bend.is_nan() || x_bend <= 0.0 || determinant.is_nan() || determinant <= 0.0 {
        return None;
    }
    let x = -(y_bend * x_slope - mixed * y_slope) / determinant;
    let y = -(x_bend * y_slope - mixed * x_slope) / determinant;
    let length = (x * x + y * y).sqrt();
    let factor = if length > LARGEST_TURN { LARGEST_TURN / length } else { 1.0 };
    at(x * factor, y * factor)
}
