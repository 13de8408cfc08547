//! The nearest point of a triangle.

use glam::DVec3;

/// The barycentric coordinates of the point of a triangle that is nearest to `p`. Degenerate triangles have one, too.
///
/// Voronoi regions of corners first, then of edges, then the inside (Ericson, Real-Time Collision Detection, 5.1.5).
#[inline]
pub fn closest(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let from_a = p - a;
    let (d1, d2) = (ab.dot(from_a), ac.dot(from_a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let from_b = p - b;
    let (d3, d4) = (ab.dot(from_b), ac.dot(from_b));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let from_c = p - c;
    let (d5, d6) = (ab.dot(from_c), ac.dot(from_c));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let of_c = d1 * d4 - d3 * d2;
    if of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = share(d1, -d3);
        return [1.0 - t, t, 0.0];
    }
    let of_b = d5 * d2 - d1 * d6;
    if of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = share(d2, -d6);
        return [1.0 - t, 0.0, t];
    }
    let of_a = d3 * d6 - d5 * d4;
    if of_a <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = share(d4 - d3, d5 - d6);
        return [0.0, 1.0 - t, t];
    }
    let sum = of_a + of_b + of_c;
    if sum > 0.0 { [of_a / sum, of_b / sum, of_c / sum] } else { [1.0, 0.0, 0.0] }
}

/// How much of a sum of two numbers, none below 0, the first is.
#[inline]
fn share(one: f64, other: f64) -> f64 {
    let sum = one + other;
    if sum > 0.0 { one / sum } else { 0.0 }
}

/// The point with these barycentric coordinates.
#[inline]
pub fn point(weights: [f64; 3], [a, b, c]: [DVec3; 3]) -> DVec3 {
    weights[0] * a + weights[1] * b + weights[2] * c
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::random;

    #[test]
    fn no_point_of_a_grid_on_the_triangle_is_nearer() {
        let mut states = random(1);
        let mut next = || (states() >> 40) as f64 / f64::from(1 << 24) - 0.5;
        for case in 0..2000 {
            let mut corner = || DVec3::new(next(), next(), next());
            let mut triangle = [corner(), corner(), corner()];
            match case % 10 {
                0 => triangle[2] = triangle[1],
                1 => triangle[2] = (triangle[0] + triangle[1]) / 2.0,
                2 => triangle = [triangle[0]; 3],
                _ => {}
            }
            let p = 2.0 * corner();
            let weights = closest(p, triangle);
            assert!(weights.iter().all(|weight| (-1e-12..=1.0 + 1e-12).contains(weight)), "{weights:?}");
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{weights:?}");
            let distance = p.distance(point(weights, triangle));
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let on_grid = [i, j, 20 - i - j].map(|steps| f64::from(steps) / 20.0);
                    let nearer = p.distance(point(on_grid, triangle));
                    assert!(distance <= nearer + 1e-9, "{distance} {nearer} {triangle:?} {p}");
                }
            }
        }
    }
}
