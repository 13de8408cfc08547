//! The shape nearest to places, such as the corners of a cluster: least squares of true distances, by Gauss and
//! Newton's method.
//!
//! f64 with + − × ÷ √ in a fixed order, as the fits that decide labels.

use glam::DVec3;

use super::eigen::eigen;
use super::shape::{BesideCone, Shape, across, beside_cone};

/// Steps at most, of some sums over all places each: [`HALVES`] and one, and that of the step. Without noise, 3 to 6
/// steps are enough.
const STEPS: usize = 30;

/// How often a step is halved at most until it lowers the sum.
const HALVES: u32 = 5;

/// Numbers of a step at most.
const NUMBERS: usize = 6;

/// The shape of this type that is nearest to weighted places, in their units; `start` is not far from it.
pub(super) fn fit(places: &[(DVec3, f64)], start: &Shape) -> Shape {
    let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
    for &(at, of_corner) in places {
        sum += of_corner * at;
        weight += of_corner;
    }
    let mean = sum / weight;
    if let Shape::Plane { .. } = start {
        return Shape::plane_at(mean, places.iter().copied());
    }
    let squares = |shape: &Shape| squares_of(places, |at| shape.distance(at));
    let step = |shape: &Shape| step_from(places, shape, mean);
    lowest(centred(*start, mean), squares, step, |shape, by| centred(moved(shape, by, mean), mean)).0
}

/// Steps as long as they lower the sum of squares, halved where they do not. Returns that sum in the end, too.
pub(super) fn lowest<T, const N: usize>(
    start: T,
    squares_of: impl Fn(&T) -> f64,
    step_from: impl Fn(&T) -> [f64; N],
    moved: impl Fn(&T, [f64; N]) -> T,
) -> (T, f64) {
    let mut squares = squares_of(&start);
    let mut best = start;
    for _ in 0..STEPS {
        let step = step_from(&best);
        let halved = |halves: u32| moved(&best, step.map(|x| x / f64::from(1u32 << halves)));
        let next = (0..=HALVES).map(halved).map(|next| (squares_of(&next), next));
        // NaN is below nothing, and ends it
        let Some((after, next)) = next.into_iter().find(|&(after, _)| after < squares) else { break };
        let is_done = after > squares * (1.0 - 1e-9);
        (best, squares) = (next, after);
        if is_done {
            break;
        }
    }
    (best, squares)
}

/// The same shape; the point of a cylinder's axis is the nearest to the mean.
fn centred(shape: Shape, mean: DVec3) -> Shape {
    match shape {
        Shape::Cylinder { point, axis, radius } => {
            Shape::Cylinder { point: point + (mean - point).dot(axis) * axis, axis, radius }
        }
        other => other,
    }
}

/// The weighted sum of squares of distances.
pub(super) fn squares_of(places: &[(DVec3, f64)], distance: impl Fn(DVec3) -> f64) -> f64 {
    let square = |&(at, weight): &(DVec3, f64)| {
        let distance = distance(at);
        weight * distance * distance
    };
    places.iter().map(square).sum()
}

/// The numbers of a step from a shape, to first order the best. The axis turns by numbers over the radius, so that all
/// are lengths; a cone is a cylinder with a slope, about the foot of the mean on the axis.
fn step_from(places: &[(DVec3, f64)], shape: &Shape, mean: DVec3) -> [f64; NUMBERS] {
    let distance = |at: DVec3| shape.distance(at);
    match *shape {
        Shape::Plane { .. } => [0.0; NUMBERS],
        Shape::Sphere { .. } => {
            let slopes = |at: DVec3| {
                let n = shape.tangent(at).normal;
                [-n.x, -n.y, -n.z, -1.0]
            };
            let [x, y, z, r] = solved(places, distance, slopes);
            [x, y, z, r, 0.0, 0.0]
        }
        Shape::Cylinder { point, axis, radius } => {
            let u = across(axis);
            let v = axis.cross(u);
            let slopes = |at: DVec3| {
                let n = shape.tangent(at).normal;
                let along = (at - point).dot(axis) / radius;
                [-n.dot(u), -n.dot(v), -1.0, -along * n.dot(u), -along * n.dot(v)]
            };
            let [x, y, r, turn_u, turn_v] = solved(places, distance, slopes);
            [x, y, r, turn_u, turn_v, 0.0]
        }
        Shape::Cone { apex, axis, slope } => {
            let (u, v) = (across(axis), axis.cross(across(axis)));
            let to_foot = (mean - apex).dot(axis);
            let radius = slope * to_foot;
            let slopes = |at: DVec3| {
                let BesideCone { out, from_axis, along, cosine, distance } = beside_cone(apex, axis, slope, at);
                let along = along - to_foot;
                let [out_u, out_v] = [u, v].map(|side| cosine * out.dot(side));
                let turn = (along + slope * from_axis) / radius;
                let by_slope = (along + cosine * slope * distance) * cosine / radius;
                [-out_u, -out_v, -cosine, -turn * out_u, -turn * out_v, -by_slope]
            };
            solved(places, distance, slopes)
        }
    }
}

/// The shape after a step.
fn moved(shape: &Shape, by: [f64; NUMBERS], mean: DVec3) -> Shape {
    match *shape {
        Shape::Plane { .. } => *shape,
        Shape::Sphere { centre, radius } => {
            let [x, y, z, r, ..] = by;
            Shape::Sphere { centre: centre + DVec3::new(x, y, z), radius: radius + r }
        }
        Shape::Cylinder { point, axis, radius } => {
            let [x, y, r, turn_u, turn_v, ..] = by;
            let (u, v) = (across(axis), axis.cross(across(axis)));
            let turned = axis + (turn_u * u + turn_v * v) / radius;
            let axis = turned / turned.length();
            Shape::Cylinder { point: point + x * u + y * v, axis, radius: radius + r }
        }
        Shape::Cone { apex, axis, slope } => {
            let [x, y, r, turn_u, turn_v, by_slope] = by;
            let (u, v) = (across(axis), axis.cross(across(axis)));
            let to_foot = (mean - apex).dot(axis);
            let radius = slope * to_foot;
            let foot = apex + to_foot * axis + x * u + y * v;
            let turned = axis + (turn_u * u + turn_v * v) / radius;
            let axis = turned / turned.length();
            let slope = slope + by_slope / radius;
            let apex = foot - (radius + r) / slope * axis;
            if slope < 0.0 {
                Shape::Cone { apex, axis: -axis, slope: -slope }
            } else {
                Shape::Cone { apex, axis, slope }
            }
        }
    }
}

/// The numbers that lower the sum of squares most, to first order; `slopes` are those of the distance.
pub(super) fn solved<const N: usize>(
    places: &[(DVec3, f64)],
    distance: impl Fn(DVec3) -> f64,
    slopes: impl Fn(DVec3) -> [f64; N],
) -> [f64; N] {
    let (mut products, mut right) = ([[0.0; N]; N], [0.0; N]);
    for &(at, weight) in places {
        let slopes = slopes(at);
        let distance = distance(at);
        for i in 0..N {
            right[i] -= weight * slopes[i] * distance;
            for j in 0..N {
                products[i][j] += weight * slopes[i] * slopes[j];
            }
        }
    }
    let (values, vectors) = eigen(products);
    let largest = values.into_iter().fold(0.0, f64::max);
    let mut by = [0.0; N];
    for at in 0..N {
        // eigenvalues near 0 are of directions that the places do not determine
        if values[at] > 1e-12 * largest {
            let along: f64 = (0..N).map(|i| vectors[i][at] * right[i]).sum();
            (0..N).for_each(|i| by[i] += vectors[i][at] * along / values[at]);
        }
    }
    by
}
