//! Feature edges: edges that clusters do not cross. Faces at them are not linked, so that the regions which they
//! enclose are components.
//!
//! An edge is one when the normals of its faces differ by more than an angle, or when the faces are of different
//! groups. The normals are those of faces that run along the edge in opposite directions, as faces of a surface that is
//! oriented do: one is turned where they do not. Of an edge of more than two faces, each two that are linked are
//! compared. A face that is too thin to have a normal is at no feature by angle, so a cluster may cross a sharp edge
//! where one covers it.
//!
//! Normals are computed of each face by itself, scaled by its size, and rounded to multiples of 2⁻²⁶. The comparison is
//! of integers: |n − m|² = 2 − 2·cos of the angle, which is exact for faces in one plane however small the angle is.

use glam::DVec3;

use crate::error::{Error, Result};
use crate::mesh::MeshView;
use crate::parallel;

/// Which edges are features.
#[derive(Debug, Clone, Copy)]
pub struct WantedFeatures<'a> {
    /// Those where normals differ by more than so many degrees: 0 to 180.
    pub angle: Option<f64>,
    /// Those where faces of different groups meet: a number a face.
    pub groups: Option<&'a [u32]>,
}

/// Fraction bits of the coordinates of normals.
const BITS: i32 = 26;

/// Faces that a thread has the normals of at once, at least.
const PIECE: usize = 1 << 12;

/// Faces of less area than this part of the square of their extent are thin: their normals may be rounding errors.
const THIN: f64 = 1e-12;

/// What decides which edges are features.
#[derive(Debug)]
pub struct Features<'a> {
    /// One a face, zero for a thin one; none where no angle is wanted.
    normals: Vec<[i32; 3]>,
    /// Squared distances between normals that are above this make features.
    most: i64,
    groups: Option<&'a [u32]>,
}

impl<'a> Features<'a> {
    /// Fails where there is not one group a face.
    pub fn of(mesh: MeshView<'_>, wanted: WantedFeatures<'a>) -> Result<Self> {
        let faces = mesh.faces.len();
        if let Some(groups) = wanted.groups.filter(|groups| groups.len() != faces) {
            return Err(Error::mesh(format_args!("there must be one group a face, {faces}, not {}", groups.len())));
        }
        let (mut normals, mut most) = (Vec::new(), i64::MAX);
        // no angle is above 180 degrees
        if let Some(angle) = wanted.angle.filter(|&angle| angle < 180.0) {
            let cosine = libm::ldexp(libm::cos(angle.to_radians()), 2 * BITS).floor() as i64;
            most = 2 * ((1 << (2 * BITS)) - cosine);
            normals = parallel::map(faces, PIECE, |face| normal(mesh, face));
        }
        Ok(Self { normals, most, groups: wanted.groups })
    }

    /// Whether the angle of a face with others is known, or none is wanted.
    pub fn can_compare(&self, face: u32) -> bool {
        self.normals.get(face as usize).is_none_or(|&normal| normal != [0; 3])
    }

    /// Whether an edge of two faces is a feature. `are_alike`: the faces run along it in the same direction.
    pub fn separate(&self, faces: [u32; 2], are_alike: bool) -> bool {
        let [one, other] = faces.map(|face| face as usize);
        if self.groups.is_some_and(|groups| groups[one] != groups[other]) {
            return true;
        }
        let (Some(&one), Some(&other)) = (self.normals.get(one), self.normals.get(other)) else { return false };
        if one == [0; 3] || other == [0; 3] {
            return false;
        }
        let sign = if are_alike { -1 } else { 1 };
        let squares = [0, 1, 2].map(|axis| (i64::from(one[axis]) - sign * i64::from(other[axis])).pow(2));
        squares.iter().sum::<i64>() > self.most
    }
}

/// The unit normal of a face, rounded to multiples of 2^−[`BITS`]; zero if it is thin.
fn normal(mesh: MeshView<'_>, face: usize) -> [i32; 3] {
    let corners = mesh.faces.corners(face);
    // halves first: the difference of two finite numbers may not be finite
    let half = |corner: usize| DVec3::from(mesh.positions.at(corners[corner] as usize)) / 2.0;
    let side = |corner: usize| half(corner) - half(0);
    let reach = (1..corners.len()).fold(0.0, |reach: f64, corner| reach.max(side(corner).abs().max_element()));
    if reach <= 0.0 {
        return [0; 3];
    }
    let scaled = |corner: usize| side(corner) / reach;
    let fan = 1..corners.len().saturating_sub(1);
    let area = fan.map(|corner| scaled(corner).cross(scaled(corner + 1))).fold(DVec3::ZERO, |sum, area| sum + area);
    let length = area.length_squared().sqrt();
    if length < THIN {
        return [0; 3];
    }
    (area / length * f64::from(1 << BITS)).to_array().map(|coordinate| coordinate.round_ties_even() as i32)
}
