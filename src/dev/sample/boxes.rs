//! Boxes whose sides are grids: a cube of triangles and a rounded box of quads.

use glam::DVec3;

use super::Piece;
use crate::mesh::Faces;

/// Cube of side 2 about the origin with the nearest 12·m² equal right triangles.
pub fn cube(faces: u64) -> Piece {
    let m = ((faces as f64 / 12.0).sqrt().round() as u64).max(1);
    let grid = Grid { cells: [m, m, m] };
    let mut corners = Vec::with_capacity((36 * m * m) as usize);
    grid.for_each_quad(|[a, b, c, d]| corners.extend([a, b, c, a, c, d]));
    Piece { positions: grid.positions(), faces: Faces::from_triangles(corners) }
}

/// Box of side 2 about the origin with rounded edges and close to `faces` quads, those of the edges not quite flat.
pub fn rounded_box(faces: u64) -> Piece {
    /// How far the flat part of a side reaches.
    const FLAT: f64 = 0.55;
    let a = ((faces as f64 / 6.0).sqrt().round() as u64).max(1);
    let c = (((faces as f64 / 2.0 - (a * a) as f64) / (2 * a) as f64).round() as u64).max(1);
    let grid = Grid { cells: [a, a, c] };
    let mut positions = grid.positions();
    for position in &mut positions {
        let core = DVec3::from(position.map(|x| x.clamp(-FLAT, FLAT)));
        let out = DVec3::from(*position) - core;
        *position = (core + (1.0 - FLAT) / out.length() * out).to_array();
    }
    let mut faces = Faces::default();
    grid.for_each_quad(|corners| faces.push(&corners));
    Piece { positions, faces }
}

/// The surface of a box of unit cells.
struct Grid {
    cells: [u64; 3],
}

impl Grid {
    /// Vertices in order: the bottom z = 0, the rings between, the top.
    fn vertex(&self, [x, y, z]: [u64; 3]) -> u32 {
        let [a, b, c] = self.cells;
        let plate = (a + 1) * (b + 1);
        let ring = 2 * (a + b);
        let index = if z == 0 {
            y * (a + 1) + x
        } else if z == c {
            plate + (c - 1) * ring + y * (a + 1) + x
        } else {
            let along = if y == 0 {
                x
            } else if x == a {
                a + y
            } else if y == b {
                a + b + (a - x)
            } else {
                2 * a + b + (b - y)
            };
            plate + (z - 1) * ring + along
        };
        index as u32
    }

    /// Positions of the vertices, each axis from −1 to 1.
    fn positions(&self) -> Vec<[f64; 3]> {
        let [a, b, c] = self.cells;
        let mut positions = vec![[0.0; 3]; (2 * (a * b + b * c + c * a) + 2) as usize];
        for z in 0..=c {
            for y in 0..=b {
                let step = if z == 0 || z == c || y == 0 || y == b { 1 } else { a };
                for x in (0..=a).step_by(step as usize) {
                    let at = [x, y, z];
                    positions[self.vertex(at) as usize] =
                        std::array::from_fn(|axis| 2.0 * at[axis] as f64 / self.cells[axis] as f64 - 1.0);
                }
            }
        }
        positions
    }

    /// Every cell of the six sides, counter-clockwise seen from outside.
    fn for_each_quad(&self, mut tell: impl FnMut([u32; 4])) {
        for axis in 0..3 {
            let (right, up) = ((axis + 1) % 3, (axis + 2) % 3);
            for (level, outwards) in [(0, false), (self.cells[axis], true)] {
                for j in 0..self.cells[up] {
                    for i in 0..self.cells[right] {
                        let corner = |di: u64, dj: u64| {
                            let mut at = [0; 3];
                            at[axis] = level;
                            at[right] = i + di;
                            at[up] = j + dj;
                            self.vertex(at)
                        };
                        let [p, q] = if outwards { [(1, 0), (0, 1)] } else { [(0, 1), (1, 0)] };
                        tell([corner(0, 0), corner(p.0, p.1), corner(1, 1), corner(q.0, q.1)]);
                    }
                }
            }
        }
    }
}
