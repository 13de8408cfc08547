//! The plane that fits best: across the smallest eigenvector of the covariance.

use glam::DVec3;

use super::Fit;
use crate::shapes::central::Central;
use crate::shapes::eigen::smallest;
use crate::shapes::shape::Shape;

pub(super) fn fit(central: &Central) -> Fit {
    let (mean_square, normal) = smallest(central.matrix());
    Fit { shape: Shape::Plane { point: central.mean, normal: DVec3::from(normal) }, mean_square }
}
