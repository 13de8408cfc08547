//! Joining the vertices at which placed parts meet.
//!
//! A glTF file gives a vertex as three f32 in the frame of its node. Where two nodes with different transforms meet,
//! the same point has two sets of coordinates, each rounded in its own frame, so the transformed positions differ in
//! the last digits of f32. Welding by equal positions would leave such a border open, and no cluster could cross it.
//!
//! So a vertex is moved to the first vertex of another placement that lies within [`TOLERANCE`], which is some units in
//! the last place of an f32 as large as the scene. Vertices under one transform keep their distances: where two of them
//! would become one, none of the set is moved. The result depends on no order and no number of threads; only + − × on
//! f64 decide. A scene with one transform stays as it is.

use std::collections::HashSet;

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::Frame;
use crate::parallel;
use crate::union_find::{join, root};

/// A run of vertices that were transformed alike; it ends where the next begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// First vertex of the run.
    pub first_vertex: u32,
    /// Number of the transform.
    pub transform: u32,
}

/// Half the longest side of the scene's bounding box lies between 2 to this power, less one, and this power.
const REACH_BITS: i32 = 20;
/// Largest distance along each axis at which vertices are joined: 2⁻²¹ to 2⁻²⁰ of half the longest side.
const TOLERANCE: f64 = 0.5;
/// Side of a cell in which vertices are compared. Larger cells have more vertices, smaller ones overlap more often.
const CELL: f64 = 8.0;
/// Positions in a cell that are compared with each other. A cell with more is left as it is, so that time stays linear.
const MOST_IN_CELL: usize = 64;

/// Joins vertices of different placements that are equal but for rounding; returns how many were moved.
///
/// `placed` are the runs of `positions`, ascending. Vertices that are no corner stay where they are.
pub fn across_placements(positions: &mut [[f64; 3]], corners: &[u32], placed: &[Placed]) -> u64 {
    if placed.windows(2).all(|pair| pair[0].transform == pair[1].transform) {
        return 0;
    }
    let mut transforms = vec![NONE; positions.len()];
    for &corner in corners {
        transforms[corner as usize] = 0;
    }
    for (index, run) in placed.iter().enumerate() {
        let end = placed.get(index + 1).map_or(positions.len(), |next| next.first_vertex as usize);
        let run_of = &mut transforms[run.first_vertex as usize..end];
        run_of.iter_mut().filter(|number| **number != NONE).for_each(|number| *number = run.transform);
    }
    let used = positions.iter().zip(&transforms).filter(|(_, transform)| **transform != NONE);
    let grid = Frame::of(used.map(|(position, _)| *position), REACH_BITS);
    let entries = entries(positions, &transforms, &grid);
    let mut parents: Vec<u32> = (0..positions.len() as u32).collect();
    for cell in entries.chunk_by(|a, b| a.0 == b.0) {
        if cell.len() > 1 {
            join_cell(cell, positions, &transforms, &grid, &mut parents);
        }
    }
    move_to_first(positions, &transforms, &mut parents)
}

/// The transform of a vertex that no triangle uses.
const NONE: u32 = u32::MAX;

/// Each vertex that may have a partner, once for each cell that lies within the tolerance of it; sorted by cell, then
/// vertex.
fn entries(positions: &[[f64; 3]], transforms: &[u32], grid: &Frame) -> Vec<(u64, u32)> {
    let near = Neighbourhoods::of(positions, transforms, grid);
    let mut entries: Vec<(u64, u32)> = parallel::list(positions.len(), parallel::LEAST, &|vertices, entries| {
        for vertex in vertices.filter(|&vertex| transforms[vertex] != NONE) {
            let place = grid.position(positions[vertex]);
            if near.is_shared(place) {
                entries.extend((0..8).filter_map(|which| cell(place, which)).map(|cell| (cell, vertex as u32)));
            }
        }
    });
    entries.par_sort_unstable();
    entries
}

/// Cell number `which` of up to eight that lie within the tolerance of a place; none where it repeats another.
fn cell(place: DVec3, which: u32) -> Option<u64> {
    const OFFSET: f64 = 2.0 * (1u64 << REACH_BITS) as f64;
    let mut cell = 0;
    for (axis, coordinate) in place.to_array().into_iter().enumerate() {
        let [low, high] = [-TOLERANCE, TOLERANCE].map(|reach| ((coordinate + OFFSET + reach) / CELL) as u64);
        let is_high = which >> axis & 1 == 1;
        if is_high && low == high {
            return None;
        }
        // 2^(REACH_BITS + 2) / CELL needs 19 bits
        cell = cell << 20 | if is_high { high } else { low };
    }
    Some(cell)
}

/// A coarse grid that tells where vertices of different transforms are near each other: most vertices of most scenes
/// are near their own part only. It decides nothing but which vertices are looked at.
struct Neighbourhoods {
    /// Log₂ of the number of cells along an axis.
    bits: u32,
    /// Of each cell the only transform of the vertices in it and around it, [`NONE`], or [`SHARED`].
    transforms: Vec<u32>,
}

/// Several transforms.
const SHARED: u32 = u32::MAX - 1;

impl Neighbourhoods {
    fn of(positions: &[[f64; 3]], transforms: &[u32], grid: &Frame) -> Self {
        let bits = (positions.len().max(64).ilog2() / 3 + 1).min(7);
        let mut near = Self { bits, transforms: vec![NONE; 1 << (3 * bits)] };
        for (&position, &transform) in positions.iter().zip(transforms).filter(|(_, transform)| **transform != NONE) {
            let place = grid.position(position);
            for which in 0..8u32 {
                let reach = |axis: u32| if which >> axis & 1 == 1 { TOLERANCE } else { -TOLERANCE };
                let at = near.cell(place + DVec3::new(reach(0), reach(1), reach(2)));
                let there = &mut near.transforms[at];
                *there = if *there == NONE || *there == transform { transform } else { SHARED };
            }
        }
        near
    }

    /// The cell of a place; places just outside of the scene are taken in.
    fn cell(&self, place: DVec3) -> usize {
        let side = 1usize << self.bits;
        place.to_array().into_iter().fold(0, |cell, coordinate| {
            let share = (coordinate / (1u64 << REACH_BITS) as f64 + 1.0) / 2.0;
            cell << self.bits | ((share * side as f64) as usize).min(side - 1)
        })
    }

    fn is_shared(&self, place: DVec3) -> bool {
        self.transforms[self.cell(place)] == SHARED
    }
}

/// Joins the vertices of a cell that are near each other: those under different transforms, and those at one position.
fn join_cell(cell: &[(u64, u32)], positions: &[[f64; 3]], transforms: &[u32], grid: &Frame, parents: &mut [u32]) {
    let key = |vertex: u32| (transforms[vertex as usize], bits(positions[vertex as usize]));
    let (first, first_transform) = (root(parents, cell[0].1), transforms[cell[0].1 as usize]);
    if cell.iter().all(|&(_, vertex)| transforms[vertex as usize] == first_transform)
        || cell.iter().all(|&(_, vertex)| root(parents, vertex) == first)
    {
        return;
    }
    if cell.len() > MOST_IN_CELL {
        let mut keys = HashSet::new();
        if cell.iter().any(|&(_, vertex)| keys.insert(key(vertex)) && keys.len() > MOST_IN_CELL) {
            return;
        }
    }
    let mut vertices: Vec<_> = cell.iter().map(|&(_, vertex)| (key(vertex), vertex)).collect();
    vertices.sort_unstable();
    let mut distinct: Vec<(u32, DVec3, u32)> = Vec::new();
    for same in vertices.chunk_by(|a, b| a.0 == b.0) {
        let ((transform, _), first) = same[0];
        same.iter().for_each(|&(_, vertex)| _ = join(parents, first, vertex));
        let place = grid.position(positions[first as usize]);
        for &(other_transform, other_place, other) in &distinct {
            if other_transform != transform && (other_place - place).abs().max_element() <= TOLERANCE {
                join(parents, other, first);
            }
        }
        distinct.push((transform, place, first));
    }
}

/// Moves the vertices of each set to its first, unless that would join different positions under one transform; returns
/// how many were moved.
fn move_to_first(positions: &mut [[f64; 3]], transforms: &[u32], parents: &mut [u32]) -> u64 {
    let mut members: Vec<(u32, u32, [u64; 3], u32)> = Vec::new();
    for vertex in 0..parents.len() as u32 {
        let first = root(parents, vertex);
        if first != vertex {
            let own = |vertex: u32| (first, transforms[vertex as usize], bits(positions[vertex as usize]), vertex);
            members.extend([own(first), own(vertex)]);
        }
    }
    members.sort_unstable();
    members.dedup();
    let mut moved = 0;
    for set in members.chunk_by(|a, b| a.0 == b.0) {
        if set.windows(2).any(|pair| pair[0].1 == pair[1].1 && pair[0].2 != pair[1].2) {
            continue;
        }
        let target = positions[set[0].0 as usize];
        for &(_, _, own, vertex) in set {
            moved += u64::from(own != bits(target));
            positions[vertex as usize] = target;
        }
    }
    moved
}

/// The bits of a position; adding zero turns −0 into 0.
fn bits(position: [f64; 3]) -> [u64; 3] {
    position.map(|coordinate| (coordinate + 0.0).to_bits())
}
