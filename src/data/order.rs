//! The order of points: along a Morton curve through the three axes on which they vary most.

use std::cmp::Reverse;

use glam::DVec3;

use super::frame::bits;
use crate::surface::lattice::COORDINATE_BITS;
use crate::surface::order;

/// The points along a Morton curve through the three axes with the largest spreads, of equal ones the lower; points
/// with equal keys by number. Axes keep their order, so that points of three coordinates come as a surface's do.
pub fn along_curve<const D: usize>(points: &[[i32; D]], spreads: &[u128]) -> Vec<u32> {
    let mut axes: Vec<usize> = (0..spreads.len()).collect();
    axes.sort_by_key(|&axis| Reverse(spreads[axis]));
    axes.truncate(3);
    axes.sort_unstable();
    // the curve's lattice has as many bits as that of a surface
    let unit = f64::from(1 << (COORDINATE_BITS - bits(spreads.len())));
    let place = |point: &[i32; D]| {
        let mut place = [0.0; 3];
        place.iter_mut().zip(&axes).for_each(|(x, &axis)| *x = f64::from(point[axis]) * unit);
        DVec3::from(place)
    };
    order::along_curve(points.len(), &|numbers, visit| {
        numbers.iter().enumerate().for_each(|(at, &number)| visit(at, place(&points[number as usize])));
    })
}
