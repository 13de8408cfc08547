//! A sphere of rings whose vertices are equally far apart, so that its triangles are nearly equal.

use std::cmp::Ordering;

use super::Piece;
use super::patch::sin_cos;
use crate::mesh::Faces;

/// Unit sphere with `faces` faces, rounded up to an even number.
///
/// A band between rings of p and q vertices has p + q triangles, so the whole has twice as many as the rings have
/// vertices: every even number comes out exactly.
pub fn sphere(faces: u64) -> Piece {
    let rings = ring_sizes(faces.div_ceil(2));
    let mut positions = vec![[0.0, 0.0, 1.0]];
    let mut corners = Vec::with_capacity(3 * faces as usize + 3);
    let mut above: Option<Ring> = None;
    for (number, &size) in rings.iter().enumerate() {
        let ring = Ring { first: positions.len() as u32, size, shift: number as u64 % 2 };
        let (radius, height) = sin_cos(latitude(number, rings.len()));
        positions.extend((0..size).map(|i| {
            let (y, x) = sin_cos((2 * i + ring.shift) as f64 / (2 * size) as f64);
            [radius * x, radius * y, height]
        }));
        match above {
            None => corners.extend((0..size).flat_map(|i| [0, ring.vertex(i), ring.vertex(i + 1)])),
            Some(above) => stitch(above, ring, &mut corners),
        }
        above = Some(ring);
    }
    if let Some(last) = above {
        let pole = positions.len() as u32;
        positions.push([0.0, 0.0, -1.0]);
        corners.extend((0..last.size).flat_map(|i| [pole, last.vertex(i + 1), last.vertex(i)]));
    }
    Piece { positions, faces: Faces::from_triangles(corners) }
}

/// One ring of vertices.
#[derive(Clone, Copy)]
struct Ring {
    first: u32,
    size: u64,
    /// Vertex i is at (2·i + shift)/(2·size) of a turn.
    shift: u64,
}

impl Ring {
    fn vertex(self, i: u64) -> u32 {
        self.first + (i % self.size) as u32
    }
}

/// Angle from the north pole to ring `number` of `rings`, in turns.
fn latitude(number: usize, rings: usize) -> f64 {
    (number + 1) as f64 / (2 * (rings + 1)) as f64
}

/// Number of vertices of each ring, at least three, in sum `vertices`.
fn ring_sizes(vertices: u64) -> Vec<u64> {
    // The triangles are equilateral when the rings are √3/2 of an edge apart and 4π is shared by 2·vertices of them.
    let edge = (std::f64::consts::TAU / vertices as f64 * 4.0 / 3.0_f64.sqrt()).sqrt();
    let distance = edge * 3.0_f64.sqrt() / 2.0;
    let rings = ((std::f64::consts::PI / distance).round() as u64).saturating_sub(1);
    let rings = rings.clamp(1, vertices / 3) as usize;
    let girths: Vec<f64> = (0..rings).map(|number| sin_cos(latitude(number, rings)).0).collect();
    let girth: f64 = girths.iter().sum();
    // In proportion to the girths; where that would leave a ring with fewer than three, three for each come first.
    let floor = if girths[0] / girth * (vertices as f64) < 4.0 { 3 } else { 0 };
    let spare = (vertices - floor * rings as u64) as f64;
    let mut sizes = Vec::with_capacity(rings);
    let (mut passed, mut given) = (0.0, 0);
    for own in girths {
        passed += own;
        let until = (spare * (passed / girth)).round() as u64;
        sizes.push(floor + until - given);
        given = until;
    }
    sizes
}

/// The band of triangles between two rings, `above` nearer to the north pole.
fn stitch(above: Ring, below: Ring, corners: &mut Vec<u32>) {
    let (mut i, mut j) = (0, 0);
    while i < above.size || j < below.size {
        // The ring whose next vertex comes first goes on; compared as fractions of a turn, exactly.
        let next_above = (2 * (i + 1) + above.shift) * below.size;
        let next_below = (2 * (j + 1) + below.shift) * above.size;
        let below_goes_on = match next_below.cmp(&next_above) {
            _ if i == above.size => true,
            _ if j == below.size => false,
            Ordering::Less | Ordering::Equal => true,
            Ordering::Greater => false,
        };
        if below_goes_on {
            corners.extend([above.vertex(i), below.vertex(j), below.vertex(j + 1)]);
            j += 1;
        } else {
            corners.extend([above.vertex(i), below.vertex(j), above.vertex(i + 1)]);
            i += 1;
        }
    }
}
