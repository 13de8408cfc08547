//! Moments about the mean, divided by the weight.
//!
//! The rounded mean is taken off in integers, exactly: up to 16 terms below 2¹¹⁹·⁶ fit 128 bits. Only the fraction of
//! the mean that is left, at most ½, is taken off in f64.

use glam::DVec3;

use super::moments::{Higher, Moments};
use super::monomials::{PAIRS, QUADRUPLES, TRIPLES, place, without};

/// Moments up to degree 2 about the mean.
#[derive(Debug, Clone, Copy)]
pub struct Central {
    /// Σ w.
    pub weight: f64,
    /// The mean, in units of moments.
    pub mean: DVec3,
    /// The covariance.
    pub second: [f64; 6],
    /// The rounded mean.
    rounded: [i64; 3],
    /// The mean less the rounded one.
    fraction: [f64; 3],
}

/// Moments of degree 3 and 4 about the mean, and those of normals about 0.
#[derive(Debug, Clone, Copy)]
pub struct CentralHigher {
    /// Of degree 3.
    pub third: [f64; 10],
    /// Of degree 4.
    pub fourth: [f64; 15],
    /// The mean normal, over the root of the mean square of normals.
    pub normal: [f64; 3],
    /// Of the normals; their trace is 1, or 0 where no face has a normal.
    pub normals: [f64; 6],
}

impl Central {
    /// Those of a cluster.
    pub fn of(moments: &Moments) -> Self {
        let weight = moments.weight as f64;
        let rounded = moments.first.map(|sum| (sum as f64 / weight + 0.5).floor() as i64);
        let fraction =
            std::array::from_fn(|axis| (moments.first[axis] - rounded[axis] * moments.weight) as f64 / weight);
        let about = second_about(moments, rounded);
        let second = std::array::from_fn(|at| {
            let [a, b] = PAIRS[at];
            about[at] as f64 / weight - fraction[a] * fraction[b]
        });
        let mean = DVec3::from_array(std::array::from_fn(|axis| rounded[axis] as f64 + fraction[axis]));
        Self { weight, mean, second, rounded, fraction }
    }

    /// The variance: the mean squared distance to the mean.
    pub fn variance(&self) -> f64 {
        self.second[0] + self.second[3] + self.second[5]
    }

    /// The covariance as a matrix.
    pub fn matrix(&self) -> [[f64; 3]; 3] {
        matrix(&self.second)
    }
}

/// A symmetric matrix of its upper half.
pub fn matrix(half: &[f64; 6]) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| half[place([row, column])]))
}

/// Σ w·y·y about a place.
fn second_about(moments: &Moments, c: [i64; 3]) -> [i128; 6] {
    std::array::from_fn(|at| {
        let [a, b] = PAIRS[at];
        let [first_a, first_b, weight] = [moments.first[a], moments.first[b], moments.weight].map(i128::from);
        let [c_a, c_b] = [c[a], c[b]].map(i128::from);
        moments.second[at] - c_a * first_b - c_b * first_a + c_a * c_b * weight
    })
}

impl CentralHigher {
    /// Those of the same cluster as `central` and `moments`.
    pub fn of(central: &Central, moments: &Moments, higher: &Higher) -> Self {
        let (weight, d, c) = (central.weight, central.fraction, central.rounded);
        let second = second_about(moments, c).map(|sum| sum as f64 / weight);
        let third = third_about(moments, higher, c).map(|sum| sum as f64 / weight);
        let fourth = fourth_about(moments, higher, c).map(|sum| sum as f64 / weight);
        let trace = (higher.normals[0] + higher.normals[3] + higher.normals[5]) as f64;
        // normals are rounded, so that the mean of their squares is not 1; samples weigh three times their face
        let scale = (weight / 3.0 * trace).sqrt();
        Self {
            third: std::array::from_fn(|at| {
                let axes @ [a, b, e] = TRIPLES[at];
                let less = (0..3).map(|left| d[axes[left]] * second[place(without::<3, 2>(axes, left))]);
                less.fold(third[at], |sum, term| sum - term) + 2.0 * d[a] * d[b] * d[e]
            }),
            fourth: std::array::from_fn(|at| {
                let axes @ [a, b, e, f] = QUADRUPLES[at];
                let mut sum = fourth[at];
                for left in 0..4 {
                    sum -= d[axes[left]] * third[place(without::<4, 3>(axes, left))];
                }
                for ([p, q], [r, s]) in halves(axes) {
                    sum += d[p] * d[q] * second[place([r, s])] + d[r] * d[s] * second[place([p, q])];
                }
                sum - 3.0 * d[a] * d[b] * d[e] * d[f]
            }),
            normal: higher.normal.map(|sum| if trace > 0.0 { sum as f64 / scale } else { 0.0 }),
            normals: higher.normals.map(|sum| if trace > 0.0 { sum as f64 / trace } else { 0.0 }),
        }
    }
}

/// The three ways to halve four axes.
fn halves([a, b, c, d]: [usize; 4]) -> [([usize; 2], [usize; 2]); 3] {
    [([a, b], [c, d]), ([a, c], [b, d]), ([a, d], [b, c])]
}

/// Σ w·y·y·y about a place.
fn third_about(moments: &Moments, higher: &Higher, c: [i64; 3]) -> [i128; 10] {
    let c = c.map(i128::from);
    let (first, weight) = (moments.first.map(i128::from), i128::from(moments.weight));
    std::array::from_fn(|at| {
        let axes @ [a, b, e] = TRIPLES[at];
        let mut sum = higher.third[at];
        for left in 0..3 {
            let rest @ [p, q] = without(axes, left);
            sum -= c[axes[left]] * moments.second[place(rest)];
            sum += c[p] * c[q] * first[axes[left]];
        }
        sum - c[a] * c[b] * c[e] * weight
    })
}

/// Σ w·y·y·y·y about a place.
fn fourth_about(moments: &Moments, higher: &Higher, c: [i64; 3]) -> [i128; 15] {
    let c = c.map(i128::from);
    let (first, weight) = (moments.first.map(i128::from), i128::from(moments.weight));
    std::array::from_fn(|at| {
        let axes @ [a, b, e, f] = QUADRUPLES[at];
        let mut sum = higher.fourth[at];
        for left in 0..4 {
            let rest @ [p, q, r] = without(axes, left);
            sum -= c[axes[left]] * higher.third[place(rest)];
            sum -= c[p] * c[q] * c[r] * first[axes[left]];
        }
        for ([p, q], [r, s]) in halves(axes) {
            sum += c[p] * c[q] * moments.second[place([r, s])];
            sum += c[r] * c[s] * moments.second[place([p, q])];
        }
        sum + c[a] * c[b] * c[e] * c[f] * weight
    })
}
