//! Which part of a cylinder or a cone a cluster covers.

use std::f64::consts::TAU;

use glam::DVec3;

use super::Cluster;
use crate::shapes::shape::across;

/// From where to where corners reach along an axis, from a point of it on.
pub(super) fn along(cluster: Cluster<'_>, point: DVec3, axis: DVec3) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    cluster.weighted_corners().fold(none, |[low, high], (at, _)| {
        let along = (at - point).dot(axis);
        [low.min(along), high.max(along)]
    })
}

/// A corner nearer to the axis, over the distance of its face, is on it: the apex of a cone.
const ON_AXIS: f64 = 1e-6;

/// The angle that faces cover around an axis, in degrees. A face covers the arc between its corners; those on the axis
/// do not count.
pub(super) fn around(cluster: Cluster<'_>, point: DVec3, axis: DVec3) -> f64 {
    let u = across(axis);
    let v = axis.cross(u);
    let turn = |at: DVec3| libm::atan2((at - point).dot(v), (at - point).dot(u));
    let from_axis = |at: DVec3| (at - point).cross(axis).length();
    let arc = |&face: &u32| {
        let middle = cluster.surface.area_normal_and_place(face).2;
        let first = turn(middle);
        let least = ON_AXIS * from_axis(middle);
        let beside = cluster.corners.positions_of(face).filter(|&at| from_axis(at) >= least);
        let from_first = beside.map(|at| {
            let by = turn(at) - first;
            by - TAU * (by / TAU + 0.5).floor()
        });
        let [low, high] = from_first.fold([0f64; 2], |[low, high], by| [low.min(by), high.max(by)]);
        let start = first + low;
        let start = start - TAU * (start / TAU).floor();
        [start, start + high - low]
    };
    let mut arcs: Vec<[f64; 2]> = cluster.members.iter().map(arc).collect();
    arcs.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    // an arc that ends beyond 360° covers angles from 0 on
    let mut end = arcs.iter().map(|arc| arc[1] - TAU).fold(0.0, f64::max);
    let mut covered = end;
    for [from, to] in arcs {
        covered += (to.min(TAU) - from.max(end)).max(0.0);
        end = end.max(to);
    }
    // rounding leaves slits between neighbours
    let share = covered / TAU;
    360.0 * if share > 1.0 - 1e-9 { 1.0 } else { share }
}
