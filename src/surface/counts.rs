//! What is counted while a mesh becomes a surface.

/// What is unusual about the connectivity.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Sets of faces connected across shared edges, without bridges; loose faces are none.
    pub components: u64,
    /// Distinct positions among the vertices that faces use.
    pub welded_vertices: u64,
    /// Edges of exactly one face; a face that runs along an edge an even number of times does not count for it.
    pub boundary_edges: u64,
    /// Edges of more than two faces, counted in the same way.
    pub non_manifold_edges: u64,
    /// Faces with two corners at one position.
    pub degenerate_faces: u64,
    /// Faces without area, degenerate ones included.
    pub zero_area_faces: u64,
    /// Faces with less area than a square of the lattice, but some.
    pub tiny_faces: u64,
    /// Faces without area that shared edges connect with no face that has area; they take no cluster.
    pub loose_faces: u64,
    /// Extra copies of faces with the same set of corner positions.
    pub duplicate_faces: u64,
}
