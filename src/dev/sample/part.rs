//! A machined part whose patches are known: a test of clusterings by shapes.
//!
//! A plate 4 × 3 × 1 with corners of radius ½, a bowl in its top (radius 1.1, rim 0.9), a boss below (radius 0.6,
//! height 0.7), turned so that nothing lies along an axis: 7 planes, 5 cylinders, 1 sphere. All corners lie on the
//! shapes.
//!
//! The part is made of rings of equally many points about its middle; between two rings is a row of a patch.

use glam::{DMat3, DVec2, DVec3};

use super::Piece;
use super::patch::sin_cos;
use crate::mesh::Faces;

/// Half the sides of the plate.
const HALF: DVec3 = DVec3::new(2.0, 1.5, 0.5);

/// Radius of its corners.
const CORNER: f64 = 0.5;

/// Radius of the bowl, and of its rim.
const BOWL: [f64; 2] = [1.1, 0.9];

/// Radius and height of the boss.
const BOSS: [f64; 2] = [0.6, 0.7];

/// Faces of the part at scale 1.
const USUAL: f64 = 12_528.0;

/// Numbers of the patches beside those of the sides, which are 0 to 7.
const TOP: u32 = 8;
const BOWL_PATCH: u32 = 9;
const BOTTOM: u32 = 10;
const BOSS_PATCH: u32 = 11;
const END: u32 = 12;

/// The part with close to `faces` faces, and the patch of each. Corners are moved by normal noise, `noise` percent of
/// the diagonal a coordinate.
pub fn part(faces: u64, noise: f64) -> (Piece, Vec<u32>) {
    let about = (faces as f64 / USUAL).sqrt();
    // points come in eights, rows make up for it
    let rows = (60..160).map(|percent| Sizes::at(about, about * f64::from(percent) / 100.0));
    let sizes = rows.fold(Sizes::at(about, about), |best, other| {
        if other.faces().abs_diff(faces) < best.faces().abs_diff(faces) { other } else { best }
    });
    let mut made = Rings::new(sizes).closed();
    let turn = DMat3::from_cols_array(&[0.8, 0.6, 0.0, -0.36, 0.48, 0.8, 0.48, -0.64, 0.6]);
    let (low, high) = (-HALF - BOSS[1] * DVec3::Z, HALF);
    let deviation = (high - low).length() * noise / 100.0;
    for (vertex, position) in (0..).zip(&mut made.0.positions) {
        let noise = [0, 1, 2].map(|axis| deviation * normal(3 * vertex + axis));
        *position = (turn * DVec3::from(*position) + DVec3::from(noise)).to_array();
    }
    made
}

/// A number that depends on its argument only, as if drawn from a normal distribution: a sum of twelve hashes.
fn normal(number: u64) -> f64 {
    let hash = |part: u64| {
        let mut x = (12 * number + part).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ x >> 31) >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(hash).sum::<f64>() - 6.0
}

/// Numbers of points and rows.
struct Sizes {
    /// Segments of a quarter of a circle, of a long side and of a short side.
    outline: [u64; 3],
    /// Rows of the sides, the top, the bowl, the bottom, the boss and its end.
    rows: [u64; 6],
}

impl Sizes {
    /// Those at a scale of the outline and one of the rows.
    fn at(scale: f64, of_rows: f64) -> Self {
        let around = (96.0 * scale).round() as u64 / 8 * 8;
        let [x, y] = [HALF.x - CORNER, HALF.y - CORNER];
        let of_side = |length: f64| (around as f64 * 0.3 * length / (x + y)) as u64 / 2 * 2 + 2;
        let rows = [8.0, 10.0, 14.0, 12.0, 8.0, 7.0].map(|rows: f64| ((rows * of_rows).round() as u64).max(2));
        Self { outline: [(around / 8).max(2), of_side(x), of_side(y)], rows }
    }

    fn points(&self) -> u64 {
        let [arc, long, short] = self.outline;
        4 * arc + 2 * long + 2 * short
    }

    fn faces(&self) -> u64 {
        // the innermost rows of bowl and end are single triangles
        2 * self.points() * (self.rows.iter().sum::<u64>() - 1)
    }
}

/// Rings of points, from the tip of the bowl outwards, down, and to the middle of the boss's end.
struct Rings {
    sizes: Sizes,
    /// The outline of the plate, counter-clockwise from above, and the patch of the side that begins at each point.
    outline: Vec<(DVec2, u32)>,
    positions: Vec<[f64; 3]>,
    /// The patch of the row before each ring; none of the sides, which have several.
    patches: Vec<Option<u32>>,
}

impl Rings {
    fn new(sizes: Sizes) -> Self {
        let outline = outline(&sizes);
        let mut rings = Self { sizes, outline, positions: Vec::new(), patches: Vec::new() };
        let part = |at: u64, of: u64| at as f64 / of as f64;
        let [sides, top, bowl, bottom, boss, end] = rings.sizes.rows;
        let [radius, rim] = BOWL;
        let middle = HALF.z + (radius * radius - rim * rim).sqrt();
        let angle = libm::asin(rim / radius);
        rings.positions.push([0.0, 0.0, middle - radius]);
        for at in 1..=bowl {
            let angle = angle * part(at, bowl);
            rings.ring(1.0, radius * libm::sin(angle), middle - radius * libm::cos(angle), Some(BOWL_PATCH));
        }
        (1..=top).for_each(|at| rings.ring(1.0 - part(at, top), rim, HALF.z, Some(TOP)));
        (1..=sides).for_each(|at| rings.ring(0.0, 0.0, HALF.z - 2.0 * HALF.z * part(at, sides), None));
        let [radius, height] = BOSS;
        (1..=bottom).for_each(|at| rings.ring(part(at, bottom), radius, -HALF.z, Some(BOTTOM)));
        (1..=boss).for_each(|at| rings.ring(1.0, radius, -HALF.z - height * part(at, boss), Some(BOSS_PATCH)));
        (1..end).for_each(|at| rings.ring(1.0, radius * (1.0 - part(at, end)), -HALF.z - height, Some(END)));
        rings.positions.push([0.0, 0.0, -HALF.z - height]);
        rings.patches.push(Some(END));
        rings
    }

    /// Adds a ring between the outline (`share` 0) and a circle (1).
    fn ring(&mut self, share: f64, radius: f64, z: f64, patch: Option<u32>) {
        let at = |&(point, _): &(DVec2, u32)| {
            (point * (1.0 - share) + point / point.length() * (radius * share)).extend(z).to_array()
        };
        self.positions.extend(self.outline.iter().map(at));
        self.patches.push(patch);
    }

    /// The faces between the rings and at both ends, and their patches.
    fn closed(self) -> (Piece, Vec<u32>) {
        let points = self.outline.len() as u32;
        let last = self.patches.len() as u32 - 1;
        // both ends are rings of one point
        let vertex = |ring: u32, point: u32| match ring {
            0 => 0,
            ring if ring > last => 1 + last * points,
            ring => 1 + (ring - 1) * points + point % points,
        };
        let (mut corners, mut truth) = (Vec::new(), Vec::new());
        for (row, patch) in (0..).zip(&self.patches) {
            for (point, &(_, side)) in (0..).zip(&self.outline) {
                let [a, b] = [point, point + 1].map(|point| vertex(row, point));
                let [c, d] = [point, point + 1].map(|point| vertex(row + 1, point));
                let triangles = if (row + point) % 2 == 0 { [[a, c, d], [a, d, b]] } else { [[a, c, b], [c, d, b]] };
                let have_area = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
                for triangle in triangles.into_iter().filter(have_area) {
                    corners.extend(triangle);
                    truth.push(patch.unwrap_or(side));
                }
            }
        }
        (Piece { positions: self.positions, faces: Faces::from_triangles(corners) }, truth)
    }
}

/// The rounded rectangle, from the side at x > 0 on.
fn outline(sizes: &Sizes) -> Vec<(DVec2, u32)> {
    let [arc, long, short] = sizes.outline;
    let middle = DVec2::new(HALF.x - CORNER, HALF.y - CORNER);
    let mut points = Vec::new();
    for quarter in 0..4 {
        let turn = |at: DVec2| (0..quarter).fold(at, |at, _| at.perp());
        // a quarter turn exchanges the sides
        let [across, along, segments] = match quarter % 2 {
            0 => [middle.x, middle.y, short as f64],
            _ => [middle.y, middle.x, long as f64],
        };
        for at in 0..segments as u64 {
            let along = along * (2.0 * at as f64 / segments - 1.0);
            points.push((turn(DVec2::new(across + CORNER, along)), 2 * quarter));
        }
        for at in 0..arc {
            let (sine, cosine) = sin_cos(at as f64 / arc as f64 / 4.0);
            points.push((turn(DVec2::new(across + CORNER * cosine, along + CORNER * sine)), 2 * quarter + 1));
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_lie_on_the_shapes_and_patches_have_their_areas() {
        let (piece, truth) = part(2000, 0.0);
        assert!(truth.len().abs_diff(2000) < 200 && truth.len() == piece.faces.len(), "{}", truth.len());
        let mut areas = [0.0; 13];
        for (face, &patch) in truth.iter().enumerate() {
            let [a, b, c] = [0, 1, 2].map(|at| DVec3::from(piece.positions[piece.faces.corners(face)[at] as usize]));
            areas[patch as usize] += (b - a).cross(c - a).length() / 2.0;
        }
        let arc = std::f64::consts::FRAC_PI_2 * CORNER;
        let disc = |radius: f64| std::f64::consts::PI * radius * radius;
        let plate = 12.0 - (4.0 - std::f64::consts::PI) * CORNER * CORNER;
        let depth = BOWL[0] - (BOWL[0] * BOWL[0] - BOWL[1] * BOWL[1]).sqrt();
        let boss = std::f64::consts::TAU * BOSS[0] * BOSS[1];
        let cap = std::f64::consts::TAU * BOWL[0] * depth;
        let wanted = [
            2.0,
            arc,
            3.0,
            arc,
            2.0,
            arc,
            3.0,
            arc,
            plate - disc(BOWL[1]),
            cap,
            plate - disc(BOSS[0]),
            boss,
            disc(BOSS[0]),
        ];
        for (area, wanted) in areas.into_iter().zip(wanted) {
            assert!((area / wanted - 1.0).abs() < 0.04, "{areas:?} {wanted}");
        }
    }

    #[test]
    fn noise_moves_corners_by_its_share_of_the_diagonal() {
        let ((flat, _), (noisy, _)) = (part(3000, 0.0), part(3000, 0.1));
        let moved =
            flat.positions.iter().zip(&noisy.positions).flat_map(|(a, b)| [0, 1, 2].map(|axis| b[axis] - a[axis]));
        let squares: Vec<f64> = moved.map(|by| by * by).collect();
        let deviation = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        let diagonal = DVec3::new(4.0, 3.0, 1.7).length();
        assert!((deviation / (diagonal * 0.001) - 1.0).abs() < 0.05, "{deviation}");
    }
}
