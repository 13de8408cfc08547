//! A mesh by reference: what a surface is built of, whether a file was read or a program has the points in memory.
//!
//! Points that a program has, as f32 or f64, are not copied. An f32 becomes an f64 exactly, whenever it is read; so
//! labels are those of the same points in f64.

use super::{Faces, PolygonMesh};
use crate::error::{Error, Result};
use crate::prefetch::prefetch;

/// Positions in source units, as they are stored.
#[derive(Debug, Clone, Copy)]
pub enum Positions<'a> {
    /// In double precision.
    Double(&'a [[f64; 3]]),
    /// In single precision.
    Single(&'a [[f32; 3]]),
}

impl<'a> Positions<'a> {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::Double(positions) => positions.len(),
            Self::Single(positions) => positions.len(),
        }
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The position of a vertex.
    #[inline(always)]
    pub fn at(&self, vertex: usize) -> [f64; 3] {
        match self {
            Self::Double(positions) => positions[vertex],
            Self::Single(positions) => positions[vertex].map(f64::from),
        }
    }

    /// All positions, in order.
    pub fn iter(self) -> impl Iterator<Item = [f64; 3]> + 'a {
        (0..self.len()).map(move |vertex| self.at(vertex))
    }

    /// Requests the cache line of a position.
    #[inline(always)]
    pub(crate) fn prefetch(&self, vertex: usize) {
        match self {
            Self::Double(positions) => prefetch(positions, vertex),
            Self::Single(positions) => prefetch(positions, vertex),
        }
    }
}

/// Positions and faces of a mesh; every corner is a valid index, and every position finite.
#[derive(Debug, Clone, Copy)]
pub struct MeshView<'a> {
    /// Vertex positions.
    pub positions: Positions<'a>,
    /// The faces.
    pub faces: &'a Faces,
}

impl<'a> MeshView<'a> {
    /// A mesh that a program has in memory.
    ///
    /// # Errors
    /// There is no face, a corner is no vertex, a position is not finite, or points cannot be numbered.
    pub fn new(positions: Positions<'a>, faces: &'a Faces) -> Result<Self> {
        if faces.is_empty() {
            return Err(Error::mesh(format_args!("the mesh has no faces; points: {}", positions.len())));
        }
        if u32::try_from(positions.len()).is_err() {
            return Err(Error::too_large(format_args!(
                "the mesh has more points than {} can be numbered: {}",
                u32::MAX,
                positions.len()
            )));
        }
        if let Some(at) = faces.all_corners().iter().position(|&corner| corner as usize >= positions.len()) {
            return Err(Error::mesh(format_args!(
                "face {} has a corner that is none of the {} points: {}",
                faces.face_of_corner(at),
                positions.len(),
                faces.all_corners()[at]
            )));
        }
        if let Some(at) = positions.iter().position(|position| position.iter().any(|x| !x.is_finite())) {
            return Err(Error::mesh(format_args!("point {at}: a coordinate is not finite: {:?}", positions.at(at))));
        }
        Ok(Self { positions, faces })
    }
}

impl<'a> From<&'a PolygonMesh> for MeshView<'a> {
    fn from(mesh: &'a PolygonMesh) -> Self {
        Self { positions: Positions::Double(&mesh.positions), faces: &mesh.faces }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_mesh_is_refused_with_its_place() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, f64::NAN, 0.0]];
        let faces = Faces::from_triangles(vec![0, 1, 2, 0, 2, 4]);
        let refusal =
            |positions: Positions<'_>, faces: &Faces| MeshView::new(positions, faces).expect_err("no mesh").message;
        let double = Positions::Double(&square);
        let none = Faces::default();
        assert!(refusal(double, &none).contains("no faces"));
        assert!(refusal(double, &faces).starts_with("face 1 has a corner that is none of the 4 points: 4"));
        let faces = Faces::from_triangles(vec![0, 1, 2]);
        assert!(refusal(double, &faces).starts_with("point 3: "));
        let single = square.map(|position| position.map(|x| x as f32));
        assert!(refusal(Positions::Single(&single), &faces).contains("NaN"));
        assert!(MeshView::new(Positions::Single(&single[..3]), &faces).is_ok());
    }
}
