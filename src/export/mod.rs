//! Geometry as files: GLB, PLY, VTP, OBJ, STL, index buffers, and archives of them.
//!
//! An encoder takes points, polygons and the cluster of each polygon or point, and writes them. Its bytes follow from
//! these alone: archives have fixed dates, and floating-point numbers are made by exactly rounded operations in a fixed
//! order. It knows no jobs, no flags and no HTTP; [`crate::artifacts`] says which output is written by which encoder.
//!
//! | format | what carries the clusters |
//! |---|---|
//! | [`glb`] | a colour and a feature id a vertex, and a table of clusters that ids refer to |
//! | [`ply`], [`vtp`] | a colour and the cluster of each face, or of each point |
//! | [`obj`] | a group a cluster; colours of points |
//! | [`stl`] | nothing |
//! | [`submeshes`] | a mesh a cluster |
//!
//! Positions stay doubles in PLY, VTP and OBJ. GLB and STL have single precision; GLB keeps more of it by a translation
//! to the centre of the bounding box.

pub mod archive;
pub mod colour;
pub mod glb;
pub mod npz;
pub mod obj;
pub mod ply;
mod split;
pub mod stl;
pub mod submeshes;
pub mod vtp;

use crate::error::{Error, Result};
use crate::mesh::Faces;

pub use split::Split;

/// Points and polygons, and the clusters that they are coloured by.
#[derive(Debug, Clone, Copy)]
pub struct Geometry<'a> {
    /// Positions, source units.
    pub points: &'a [[f64; 3]],
    /// The polygons: corners are indices of points.
    pub faces: &'a Faces,
    /// The clusters.
    pub clusters: Clusters<'a>,
}

/// Which clusters a geometry shows.
#[derive(Debug, Clone, Copy)]
pub enum Clusters<'a> {
    /// One a polygon.
    OfFaces(&'a [u32]),
    /// One a point: of a remesh, whose triangles lie between clusters.
    OfPoints(&'a [u32]),
}

impl<'a> Clusters<'a> {
    /// The numbers.
    pub fn numbers(self) -> &'a [u32] {
        match self {
            Clusters::OfFaces(numbers) | Clusters::OfPoints(numbers) => numbers,
        }
    }
}

/// The triangles of a polygon: a fan from its first corner.
pub fn fan(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    let first = corners.first().copied().unwrap_or_default();
    corners.windows(2).skip(1).map(move |pair| [first, pair[0], pair[1]])
}

/// Positions relative to a centre in single precision.
///
/// # Errors
/// One of them is beyond its range.
fn single(points: impl Iterator<Item = [f64; 3]>, centre: [f64; 3], format: &str) -> Result<Vec<[f32; 3]>> {
    points
        .map(|point| {
            let near: [f32; 3] = std::array::from_fn(|axis| (point[axis] - centre[axis]) as f32);
            match near.iter().all(|x| x.is_finite()) {
                true => Ok(near),
                false => Err(Error::conflict(format_args!(
                    "{format} has single precision, whose range positions leave: take ply, vtp or obj, or scale \
                     the mesh; the position is {point:?}"
                ))),
            }
        })
        .collect()
}

/// Whether single precision holds all positions exactly.
fn are_single(points: &[[f64; 3]]) -> bool {
    points.iter().flatten().all(|&x| f64::from(x as f32).to_bits() == x.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    #[test]
    fn a_fan_covers_a_polygon() {
        assert_eq!(fan(&[7, 8, 9, 5]).collect::<Vec<_>>(), [[7, 8, 9], [7, 9, 5]]);
        assert_eq!(fan(&[7, 8]).chain(fan(&[7])).count(), 0);
    }

    #[test]
    fn positions_beyond_single_precision_are_refused_where_it_is_all_there_is() {
        let near = single([[1e200 + 1e190, 2.0, 3.0]].into_iter(), [1e200, 0.0, 0.0], "GLB");
        assert_eq!(near.expect_err("far").kind, Kind::Conflict);
        let points = [[0.1, 2.0, 3.0], [0.5, 0.25, 3.0]];
        assert_eq!(single(points.into_iter(), [0.0; 3], "GLB").map(|near| near[1]), Ok([0.5, 0.25, 3.0]));
        assert!(!are_single(&points) && are_single(&points[1..]));
    }
}
