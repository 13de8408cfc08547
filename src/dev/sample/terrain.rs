//! A hilly square with a border.

use super::Piece;
use super::patch::{cells, open_faces};

/// Square of side 1 with hills and close to `faces` triangles.
pub fn terrain(faces: u64) -> Piece {
    let [u, v] = cells(faces, 1.0, [1, 1]);
    let mut positions = Vec::with_capacity(((u + 1) * (v + 1)) as usize);
    for i in 0..=u {
        for j in 0..=v {
            let (x, y) = (i as f64 / u as f64, j as f64 / v as f64);
            positions.push([x, y, height(x, y)]);
        }
    }
    Piece { positions, faces: open_faces([u, v], |i, j| (i + j) % 2 == 1) }
}

/// Value noise in six octaves, each twice as fine and less than half as high as the one before.
fn height(x: f64, y: f64) -> f64 {
    let (mut sum, mut scale, mut weight) = (0.0, 4.0, 0.25);
    for octave in 0..6 {
        sum += weight * noise(octave, scale * x, scale * y);
        scale *= 2.0;
        weight *= 0.45;
    }
    sum
}

/// Random numbers at the corners of unit cells, smoothly between them; 0 ..= 1 for x, y ≥ 0.
fn noise(octave: u32, x: f64, y: f64) -> f64 {
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (tx, ty) = (smooth(x - cell_x), smooth(y - cell_y));
    let (cell_x, cell_y) = (cell_x as u32, cell_y as u32);
    let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
    let row = |y: u32| mix(random(octave, cell_x, y), random(octave, cell_x + 1, y), tx);
    mix(row(cell_y), row(cell_y + 1), ty)
}

/// A number in 0 .. 1 that depends on its arguments only: multiply-and-shift hash.
fn random(octave: u32, x: u32, y: u32) -> f64 {
    let mut hash = 0x9e37_79b9_u32;
    for word in [octave, x, y] {
        hash = (hash ^ word).wrapping_mul(0x85eb_ca6b);
        hash ^= hash >> 15;
        hash = hash.wrapping_mul(0xc2b2_ae35);
        hash ^= hash >> 13;
    }
    f64::from(hash >> 8) / f64::from(1 << 24)
}
