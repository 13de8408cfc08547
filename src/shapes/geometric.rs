//! The shape nearest to places, such as the corners of a cluster: least squares of true distances, by Gauss and
//! Newton's method.
//!
//! f64 with + − × ÷ √ in a fixed order, as the fits that decide labels.

use glam::DVec3;

use super::eigen::eigen;
use super::shape::{Shape, across};

/// Steps at most. Without noise, 3 to 6 are enough.
const STEPS: usize = 30;

/// Numbers that a step changes at most: those of a cylinder.
const MOST: usize = 5;

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
    let mut best = centred(*start, mean);
    let mut squares = squares_of(places, &best);
    for _ in 0..STEPS {
        let next = centred(stepped(places, &best), mean);
        let after = squares_of(places, &next);
        // NaN ends it, too
        if after.partial_cmp(&squares).is_none_or(std::cmp::Ordering::is_ge) {
            break;
        }
        let is_done = after > squares * (1.0 - 1e-9);
        (best, squares) = (next, after);
        if is_done {
            break;
        }
    }
    best
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

fn squares_of(places: &[(DVec3, f64)], shape: &Shape) -> f64 {
    let square = |&(at, weight): &(DVec3, f64)| {
        let distance = shape.distance(at);
        weight * distance * distance
    };
    places.iter().map(square).sum()
}

/// The shape after a step.
fn stepped(places: &[(DVec3, f64)], shape: &Shape) -> Shape {
    match *shape {
        Shape::Plane { .. } => *shape,
        Shape::Sphere { centre, radius } => {
            let slopes = |at: DVec3| {
                let n = shape.tangent(at).normal;
                [-n.x, -n.y, -n.z, -1.0, 0.0]
            };
            let [x, y, z, r, _] = solved(places, shape, slopes);
            Shape::Sphere { centre: centre + DVec3::new(x, y, z), radius: radius + r }
        }
        Shape::Cylinder { point, axis, radius } => {
            let u = across(axis);
            let v = axis.cross(u);
            // the axis turns by its last two numbers over the radius, which are lengths as the others
            let slopes = |at: DVec3| {
                let n = shape.tangent(at).normal;
                let along = (at - point).dot(axis) / radius;
                [-n.dot(u), -n.dot(v), -1.0, -along * n.dot(u), -along * n.dot(v)]
            };
            let [x, y, r, turn_u, turn_v] = solved(places, shape, slopes);
            let turned = axis + (turn_u * u + turn_v * v) / radius;
            let axis = turned / turned.length();
            Shape::Cylinder { point: point + x * u + y * v, axis, radius: radius + r }
        }
    }
}

/// The numbers that lower the sum of squares most, to first order; `slopes` are those of the distance.
fn solved(places: &[(DVec3, f64)], shape: &Shape, slopes: impl Fn(DVec3) -> [f64; MOST]) -> [f64; MOST] {
    let (mut products, mut right) = ([[0.0; MOST]; MOST], [0.0; MOST]);
    for &(at, weight) in places {
        let slopes = slopes(at);
        let distance = shape.distance(at);
        for i in 0..MOST {
            right[i] -= weight * slopes[i] * distance;
            for j in 0..MOST {
                products[i][j] += weight * slopes[i] * slopes[j];
            }
        }
    }
    let (values, vectors) = eigen(products);
    let largest = values.into_iter().fold(0.0, f64::max);
    let mut by = [0.0; MOST];
    for at in 0..MOST {
        // eigenvalues near 0 are of directions that the places do not determine
        if values[at] > 1e-12 * largest {
            let along: f64 = (0..MOST).map(|i| vectors[i][at] * right[i]).sum();
            (0..MOST).for_each(|i| by[i] += vectors[i][at] * along / values[at]);
        }
    }
    by
}
