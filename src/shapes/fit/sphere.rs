//! The sphere that fits best.

use glam::DVec3;

use super::{Fit, Known, round};
use crate::shapes::eigen::smallest;
use crate::shapes::monomials::place;
use crate::shapes::shape::Shape;

pub(super) fn fit(Known { central, higher, .. }: Known<'_>) -> Option<Fit> {
    let square = central.variance();
    if square <= 0.0 {
        return None;
    }
    let scale = 2.0 * square.sqrt();
    // |y|²: its variance, and its covariance with y
    let (mut variance, mut with) = (-square * square, [0.0; 3]);
    for i in 0..3 {
        for j in 0..3 {
            variance += higher.fourth[place([i, i, j, j])];
            with[i] += higher.third[place([i, j, j])];
        }
    }
    let covariance = central.matrix();
    let mut all = [[0.0; 4]; 4];
    all[0][0] = variance / (scale * scale);
    for i in 0..3 {
        all[0][i + 1] = with[i] / scale;
        all[i + 1][0] = with[i] / scale;
        all[i + 1][1..].copy_from_slice(&covariance[i]);
    }
    let (mean_square, [zeta, rest @ ..]) = smallest(all);
    let (centre, radius) = round(zeta / scale, DVec3::from(rest), square)?;
    Some(Fit { shape: Shape::Sphere { centre: centre + central.mean, radius }, mean_square })
}
