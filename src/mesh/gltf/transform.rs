//! Where nodes and instances put things: affine maps in f64.
//!
//! Only + − × ÷ in a fixed order, so that positions are the same bytes on every machine.

use std::fmt::Display;

use glam::{DAffine3, DMat3, DMat4, DVec3, DVec4};

use super::document::Node;
use crate::error::{Error, Result};

/// A linear map followed by a translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine(DAffine3);

impl Affine {
    /// Changes nothing.
    pub const IDENTITY: Self = Self(DAffine3::IDENTITY);

    /// The transform of a node relative to its parent.
    pub fn of_node(node: &Node, whence: impl Display) -> Result<Self> {
        let Some(matrix) = &node.matrix else {
            return Self::compose(
                node.translation.as_deref().copied().unwrap_or([0.0; 3]),
                node.rotation.as_deref().copied().unwrap_or([0.0, 0.0, 0.0, 1.0]),
                node.scale.as_deref().copied().unwrap_or([1.0; 3]),
                whence,
            );
        };
        let matrix = DMat4::from_cols_array(matrix);
        let last = matrix.row(3);
        if last != DVec4::W {
            return Err(Error::mesh(format_args!(
                "the matrix of {whence} is not affine, its last row must be 0 0 0 1: {} {} {} {}",
                last.x, last.y, last.z, last.w
            )));
        }
        Ok(Self(DAffine3::from_mat4(matrix)))
    }

    /// Scales, then rotates by a quaternion x, y, z, w of any length but 0, then translates.
    pub fn compose(
        translation: [f64; 3],
        [x, y, z, w]: [f64; 4],
        scale: [f64; 3],
        whence: impl Display,
    ) -> Result<Self> {
        let square = x * x + y * y + z * z + w * w;
        if !(square.is_normal()) {
            return Err(Error::mesh(format_args!("the rotation of {whence} is no unit quaternion: {x} {y} {z} {w}")));
        }
        let s = 2.0 / square;
        let matrix3 = DMat3::from_cols(
            scale[0] * DVec3::new(1.0 - s * (y * y + z * z), s * (x * y + z * w), s * (x * z - y * w)),
            scale[1] * DVec3::new(s * (x * y - z * w), 1.0 - s * (x * x + z * z), s * (y * z + x * w)),
            scale[2] * DVec3::new(s * (x * z + y * w), s * (y * z - x * w), 1.0 - s * (x * x + y * y)),
        );
        Ok(Self(DAffine3 { matrix3, translation: translation.into() }))
    }

    /// This map after `inner`.
    pub fn after(&self, inner: &Self) -> Self {
        Self(self.0 * inner.0)
    }

    /// Where a point goes.
    #[inline]
    pub fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        self.0.transform_point3(point.into()).to_array()
    }

    /// Its numbers, to tell maps apart.
    pub fn bits(&self) -> [u64; 12] {
        // adding zero turns −0 into 0
        self.0.to_cols_array().map(|number| (number + 0.0).to_bits())
    }

    /// Whether it turns left into right, and so the winding of faces around.
    pub fn mirrors(&self) -> bool {
        let [x, y, z] = [self.0.matrix3.x_axis, self.0.matrix3.y_axis, self.0.matrix3.z_axis];
        x.dot(y.cross(z)) < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        for length in [1.0, 3.0] {
            let turn =
                Affine::compose([10.0, 0.0, 0.0], [0.0, 0.0, half * length, half * length], [2.0, 3.0, -4.0], "node 0")
                    .expect("a rotation");
            let close = |point, expected: [f64; 3]| {
                let image = turn.apply(point);
                assert!((0..3).all(|axis| (image[axis] - expected[axis]).abs() < 1e-12), "{image:?} {expected:?}");
            };
            close([1.0, 0.0, 0.0], [10.0, 2.0, 0.0]);
            close([0.0, 1.0, 0.0], [7.0, 0.0, 0.0]);
            close([0.0, 0.0, 1.0], [10.0, 0.0, -4.0]);
            assert!(turn.mirrors());
        }
    }

    #[test]
    fn the_inner_map_comes_first() {
        let scale = Affine::compose([0.0; 3], [0.0, 0.0, 0.0, 1.0], [2.0; 3], "").expect("a scale");
        let shift = Affine::compose([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0], [1.0; 3], "").expect("a shift");
        assert_eq!(scale.after(&shift).apply([1.0; 3]), [4.0, 6.0, 8.0]);
        assert_eq!(shift.after(&scale).apply([1.0; 3]), [3.0, 4.0, 5.0]);
        assert!(!scale.mirrors());
    }

    #[test]
    fn rotations_without_direction_are_refused() {
        for rotation in [[0.0; 4], [1e-200; 4], [1e200; 4]] {
            assert!(Affine::compose([0.0; 3], rotation, [1.0; 3], "node 7").is_err());
        }
    }
}
