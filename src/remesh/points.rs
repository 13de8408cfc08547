//! The vertices of a dual beside its cells' own: one at each boundary junction, and the points of arcs.

use glam::DVec3;

use crate::complex::half_edges::NONE;
use crate::complex::{Complex, CutSurface};

/// A place on an edge of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// A half-edge. It has the cell, at an arc the left one, on its left.
    pub half: u32,
    /// How far along it: 0 at its origin, 1 at its target.
    pub along: f64,
}

impl Spot {
    /// Its position in the frame of the surface.
    pub fn position(&self, surface: &CutSurface) -> DVec3 {
        let [from, to] = [surface.halves.origin(self.half), surface.halves.target(self.half)];
        surface.points[from as usize].lerp(surface.points[to as usize], self.along)
    }
}

/// Numbers of vertices: cells, then what is on the boundary, then points of arcs between cells.
#[derive(Debug)]
pub struct Layout {
    /// The vertices after the cells.
    pub spots: Vec<Spot>,
    /// How many of them are on the boundary.
    pub on_boundary: usize,
    /// The vertex of each junction on the boundary, or [`NONE`].
    pub of_junction: Vec<u32>,
    /// The first point of each arc; the others follow.
    pub first_point: Vec<u32>,
}

impl Layout {
    /// With `counts` points an arc.
    pub fn new(surface: &CutSurface, complex: &Complex<'_>, cells: usize, counts: &[u8]) -> Self {
        let mut spots = Vec::new();
        let mut of_junction = Vec::with_capacity(complex.junctions.len());
        for junction in &complex.junctions {
            let umbrella = complex.halves.umbrellas[junction.umbrella as usize];
            of_junction.push(if umbrella.is_open { (cells + spots.len()) as u32 } else { NONE });
            if umbrella.is_open {
                spots.push(Spot { half: umbrella.first, along: 0.0 });
            }
        }
        let mut first_point = vec![NONE; counts.len()];
        let mut on_boundary = 0;
        for of_boundary in [true, false] {
            for ((arc, &count), first) in complex.arcs.iter().zip(counts).zip(&mut first_point) {
                if arc.right.is_none() == of_boundary && count > 0 {
                    *first = (cells + spots.len()) as u32;
                    spots.extend(spread(surface, complex.chain(arc), arc.ends.is_none(), count));
                }
            }
            if of_boundary {
                on_boundary = spots.len();
            }
        }
        Self { spots, on_boundary, of_junction, first_point }
    }
}

/// Points at even distances along a chain, its ends excluded; on a closed one, the first is its start. A single one is
/// at a vertex of the chain if there is one inside.
fn spread(surface: &CutSurface, chain: &[u32], is_closed: bool, count: u8) -> Vec<Spot> {
    let mut ends = Vec::with_capacity(chain.len());
    let mut total = 0.0;
    for &half in chain {
        total += surface.length(half);
        ends.push(total);
    }
    if count == 1 && chain.len() > 1 {
        let distance = |at: usize| (ends[at - 1] - total / 2.0).abs();
        let nearer = |best: usize, at: usize| if distance(at) < distance(best) { at } else { best };
        let at = (1..chain.len()).fold(1, nearer);
        return vec![Spot { half: chain[at], along: 0.0 }];
    }
    let (first, parts) = if is_closed { (0, count) } else { (1, count + 1) };
    let spot = |number: u8| place(chain, &ends, f64::from(number + first) / f64::from(parts) * total);
    (0..count).map(spot).collect()
}

/// The place at a distance from the start of a chain; `ends` are the distances of the ends of its half-edges.
pub fn place(chain: &[u32], ends: &[f64], distance: f64) -> Spot {
    let at = ends.partition_point(|&end| end <= distance).min(chain.len() - 1);
    let begin = if at == 0 { 0.0 } else { ends[at - 1] };
    let length = ends[at] - begin;
    let along = if length > 0.0 { ((distance - begin) / length).clamp(0.0, 1.0) } else { 0.0 };
    Spot { half: chain[at], along }
}
