//! Several components of very different sizes, their faces not in proportion to their areas.

use glam::DVec3;

use super::{Piece, boxes, knot, sphere, torus};

/// What one component is.
struct Component {
    name: &'static str,
    shape: fn(u64) -> Piece,
    scale: f64,
    place: [f64; 3],
    /// Share of all faces, in thousandths.
    share: u64,
    /// The fewest faces that the shape has.
    fewest: u64,
}

const COMPONENTS: [Component; 12] = [
    component("globe", sphere::sphere, 2.0, [0.0, 0.0, 0.0], 300, 6),
    component("ring", torus::torus, 1.0, [4.0, 0.0, 0.0], 200, 18),
    component("knot", knot::knot, 0.25, [-4.0, 0.0, 0.0], 150, 72),
    component("block", boxes::cube, 1.0, [0.0, 4.0, 0.0], 120, 12),
    component("ball", sphere::sphere, 0.5, [0.0, -4.0, 0.0], 80, 6),
    component("dice", boxes::cube, 0.1, [3.0, 3.0, 0.0], 50, 12),
    component("link", torus::torus, 0.1, [-3.0, 3.0, 0.0], 40, 18),
    component("marble", sphere::sphere, 0.05, [3.0, -3.0, 0.0], 30, 6),
    component("coarse", sphere::sphere, 1.0, [-3.0, -3.0, 0.0], 10, 6),
    component("bead", sphere::sphere, 0.02, [0.0, 0.0, 4.0], 10, 6),
    component("grain", boxes::cube, 0.005, [0.0, 0.0, -4.0], 6, 12),
    component("speck", sphere::sphere, 0.002, [2.0, 2.0, 2.0], 4, 6),
];

const fn component(
    name: &'static str,
    shape: fn(u64) -> Piece,
    scale: f64,
    place: [f64; 3],
    share: u64,
    fewest: u64,
) -> Component {
    Component { name, shape, scale, place, share, fewest }
}

/// Twelve closed shapes with their names, close to `faces` triangles in all.
pub fn parts(faces: u64) -> Vec<(String, Piece)> {
    let fewest: u64 = COMPONENTS.iter().map(|c| c.fewest).sum();
    let spare = faces.saturating_sub(fewest);
    COMPONENTS
        .iter()
        .map(|c| {
            let mut piece = (c.shape)(c.fewest + spare * c.share / 1000);
            for position in &mut piece.positions {
                *position = (DVec3::from(c.place) + c.scale * DVec3::from(*position)).to_array();
            }
            (c.name.to_owned(), piece)
        })
        .collect()
}
