//! The surface as the algorithms see it: integer centroids and weights, and which faces share an edge.
use crate::report::Energy;

/// A mesh on the integer lattice, faces in an internal order chosen for locality.
#[derive(Debug)]
pub struct Surface {
    /// Face centroids on the lattice, |coordinate| < 2²⁷; internal order.
    pub centroids: Vec<[i32; 3]>,
    /// Face weights, at least 1; internal order. A component's weights sum to less than 2³⁴.
    pub weights: Vec<u32>,
    /// First neighbour of each face in `neighbours`, and one past the last: faces + 1 numbers.
    pub neighbour_offsets: Vec<u32>,
    /// Faces that share an edge with each face, internal order. Symmetric; a face may be listed twice, never itself.
    pub neighbours: Vec<u32>,
    /// The connected components, each a run of faces in internal order.
    pub components: Vec<Component>,
    /// The face of the upload that each internal face is.
    pub upload_face: Vec<u32>,
}

/// A set of faces connected across shared edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Component {
    /// First face, internal order.
    pub first_face: u32,
    /// Number of faces.
    pub faces: u32,
    /// Sum of their weights.
    pub weight: u64,
    /// Weights of this component count `2^energy_shift` units of the finest component's: 0 ..= 30.
    pub energy_shift: u32,
}
#[allow(unused)]
fn _x(_: Energy) {}
