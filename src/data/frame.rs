//! From f64 to integers, for points of any number of coordinates. `docs/arithmetic.md` has the bounds.
//!
//! Coordinates are centred on their range, axis by axis, and scaled by one power of two for all axes, so that columns
//! keep their ranges relative to each other.

use super::members::Members;
use super::{MOST_DIMENSIONS, PointSet};
use crate::parallel;
use crate::power::factors;

/// Values count as different if they differ by more than this share of larger ones: results of arithmetic on equal ones
/// do not.
pub const LEAST_DIFFERENCE: f64 = 1e-12;

/// Items that a thread takes at least.
const PIECE: usize = 1 << 12;

/// Lattice coordinates of points of d coordinates stay below 2 to this power.
pub fn bits(dimensions: usize) -> i32 {
    // ⌈log₂ d⌉
    let rounded_up = dimensions.next_power_of_two().trailing_zeros() as i32;
    ((58 - rounded_up) / 2 - 1).min(27)
}

/// Coordinates that points of d have room for: those beyond d are 0. The code for points is compiled once for each of
/// these numbers, which takes 15 s of a processor.
pub fn width(dimensions: usize) -> usize {
    match dimensions {
        ..=3 => 3,
        4..=8 => 8,
        _ => MOST_DIMENSIONS,
    }
}

/// Coordinate = (source coordinate − centre) × 2^exponent.
#[derive(Debug, PartialEq)]
pub struct Frame {
    /// Middle of the range of each axis.
    pub centre: Vec<f64>,
    /// Power of two between lengths in the source and here.
    pub exponent: i32,
    /// Axes whose coordinates in the source are not all the same, but for what rounding adds beside the longest axis.
    pub varying: Vec<bool>,
}

impl Frame {
    /// The frame of the members: the longest half range is below 2^[`bits`], and not by half.
    pub fn of(set: &PointSet, members: &Members) -> Self {
        let none = || vec![(f64::INFINITY, f64::NEG_INFINITY); set.dimensions];
        let ranges = parallel::ranges(members.len(), PIECE, &|range| {
            let mut ranges = none();
            for member in range {
                for (axis, (low, high)) in ranges.iter_mut().enumerate() {
                    let value = set.at(members.item(member as u32) as usize, axis);
                    (*low, *high) = (low.min(value), high.max(value));
                }
            }
            ranges
        });
        let join = |a: Vec<(f64, f64)>, b: Vec<(f64, f64)>| {
            a.into_iter().zip(b).map(|(a, b)| (a.0.min(b.0), a.1.max(b.1))).collect()
        };
        let ranges = ranges.into_iter().fold(none(), join);
        // halves first: the sum of two finite numbers may not be finite. Adding 0 leaves no −0, which comes by chance
        let centre: Vec<f64> = ranges.iter().map(|(low, high)| low / 2.0 + high / 2.0 + 0.0).collect();
        let reaches = ranges.iter().zip(&centre).map(|((low, high), centre)| (high - centre).max(centre - low));
        let reach = reaches.fold(0.0, f64::max);
        let exponent = if reach > 0.0 { bits(set.dimensions) - libm::frexp(reach).1 } else { 0 };
        Self {
            centre,
            exponent,
            varying: ranges.iter().map(|(low, high)| high - low > LEAST_DIFFERENCE * reach).collect(),
        }
    }

    /// The members on the lattice, padded with zeros.
    pub fn points<const D: usize>(&self, set: &PointSet, members: &Members) -> Vec<[i32; D]> {
        let most = f64::from((1 << bits(set.dimensions)) - 1);
        let [first, second] = factors(self.exponent);
        let mut points = vec![[0; D]; members.len()];
        parallel::runs_mut(&mut points, PIECE, &|start, points| {
            for (member, point) in (start..).zip(points) {
                let item = members.item(member as u32) as usize;
                for (axis, (x, centre)) in point.iter_mut().zip(&self.centre).enumerate() {
                    let scaled = (set.at(item, axis) - centre) * first * second;
                    *x = (scaled + 0.5).floor().clamp(-most, most) as i32;
                }
            }
        });
        points
    }
}

/// n² times the variance of each of `dimensions` axes, exactly: n·Σx² − (Σx)², below 2¹¹⁶.
pub fn spreads<const D: usize>(points: &[[i32; D]], dimensions: usize) -> Vec<u128> {
    let none = || vec![(0i64, 0u128); dimensions];
    let sums = parallel::ranges(points.len(), PIECE, &|range| {
        let mut sums = none();
        for point in &points[range] {
            for ((sum, squares), &x) in sums.iter_mut().zip(point) {
                *sum += i64::from(x);
                *squares += u128::from(x.unsigned_abs()) * u128::from(x.unsigned_abs());
            }
        }
        sums
    });
    let join =
        |a: Vec<(i64, u128)>, b: Vec<(i64, u128)>| a.into_iter().zip(b).map(|(a, b)| (a.0 + b.0, a.1 + b.1)).collect();
    let sums = sums.into_iter().fold(none(), join);
    let spread = |(sum, squares): (i64, u128)| {
        points.len() as u128 * squares - u128::from(sum.unsigned_abs()) * u128::from(sum.unsigned_abs())
    };
    sums.into_iter().map(spread).collect()
}
