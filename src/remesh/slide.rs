//! Vertices on the boundary: each slides along the polyline of the input until distances to its neighbours are even.
//!
//! Where the polyline turns by more than 50°, the nearest vertex moves into the turn and stays. A vertex moves at most
//! half way to its neighbour then, since that would be nearer otherwise, so that the order stays.

use super::points::{Spot, place};
use crate::complex::CutSurface;
use crate::complex::half_edges::NONE;

/// Rounds of evening out.
const ROUNDS: usize = 10;
/// The cosine of 50°.
const SHARP: f64 = 0.642_787_609_686_539_4;

/// Slides vertices along the boundary; each is on a boundary half-edge.
pub fn slide(surface: &CutSurface, spots: &mut [Spot]) {
    let mut vertices_of: Vec<(u32, usize)> =
        spots.iter().enumerate().map(|(vertex, spot)| (spot.half, vertex)).collect();
    vertices_of.sort_by(|one, other| one.0.cmp(&other.0).then(spots[one.1].along.total_cmp(&spots[other.1].along)));
    for circle in surface.halves.loops() {
        slide_on(surface, &circle, &vertices_of, spots);
    }
}

fn slide_on(surface: &CutSurface, circle: &[u32], vertices_of: &[(u32, usize)], spots: &mut [Spot]) {
    let mut ends = Vec::with_capacity(circle.len());
    let (mut vertices, mut at) = (Vec::new(), Vec::new());
    let mut total = 0.0;
    for &half in circle {
        let length = surface.length(half);
        let first = vertices_of.partition_point(|&(other, _)| other < half);
        for &(_, vertex) in vertices_of[first..].iter().take_while(|&&(other, _)| other == half) {
            vertices.push(vertex);
            at.push(total + spots[vertex].along * length);
        }
        total += length;
        ends.push(total);
    }
    if vertices.is_empty() {
        return;
    }
    let turn_at = nearest_turns(surface, circle, &ends, &at);
    for (at, turn) in at.iter_mut().zip(&turn_at) {
        *at = turn.map_or(*at, |turn| turn.place);
    }
    let count = at.len();
    for _ in 0..ROUNDS {
        for vertex in (0..count).filter(|&vertex| turn_at[vertex].is_none()) {
            let before = if vertex == 0 { at[count - 1] - total } else { at[vertex - 1] };
            let after = if vertex + 1 == count { at[0] + total } else { at[vertex + 1] };
            at[vertex] = (before + after) / 2.0;
        }
    }
    for (at, vertex) in at.into_iter().zip(vertices) {
        let around = if at < 0.0 {
            at + total
        } else if at >= total {
            at - total
        } else {
            at
        };
        spots[vertex] = place(circle, &ends, around);
    }
}

/// A turn of the polyline.
#[derive(Debug, Clone, Copy)]
struct Turn {
    /// Where it is, seen from the vertex: below 0 or above the length of the circle if that is nearer.
    place: f64,
    distance: f64,
}

/// For each vertex the nearest of those turns to which no other vertex is nearer.
fn nearest_turns(surface: &CutSurface, circle: &[u32], ends: &[f64], at: &[f64]) -> Vec<Option<Turn>> {
    let mut found: Vec<Option<Turn>> = vec![None; at.len()];
    let total = ends.last().copied().unwrap_or(0.0);
    let direction = |half: u32| {
        let [from, to] = [surface.halves.origin(half), surface.halves.target(half)];
        (surface.points[to as usize] - surface.points[from as usize]).normalize_or_zero()
    };
    let mut before = circle.last().map_or(NONE, |&half| half);
    let mut begin = 0.0;
    for (&half, &end) in circle.iter().zip(ends) {
        if direction(before).dot(direction(half)) < SHARP {
            // the vertices around it, past the ends of the list as well
            let after = at.partition_point(|&at| at < begin);
            let left = if after == 0 { (at.len() - 1, -total) } else { (after - 1, 0.0) };
            let right = if after == at.len() { (0, total) } else { (after, 0.0) };
            let [left, right] = [left, right].map(|(vertex, shift)| {
                (vertex, Turn { place: begin - shift, distance: (at[vertex] + shift - begin).abs() })
            });
            let (vertex, turn) = if right.1.distance < left.1.distance { right } else { left };
            if found[vertex].is_none_or(|so_far| turn.distance < so_far.distance) {
                found[vertex] = Some(turn);
            }
        }
        (before, begin) = (half, end);
    }
    found
}
