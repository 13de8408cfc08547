//! What a request for an output may choose besides its form: flags of the command line, members of the query.

use crate::remesh::Placement;

/// Something that a request may choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Where the vertices of a remesh are placed.
    Placement,
    /// Colours vertices of a PLY instead of its faces.
    PlyVertexColours,
    /// Writes what takes readers long.
    Force,
    /// Whether a mesh has colours; not on the command line.
    Colours,
}

/// What a request chose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Choices {
    /// Where the vertices of a remesh are placed.
    pub placement: Placement,
    /// Whether vertices of a PLY are coloured instead of its faces.
    pub ply_vertex_colours: bool,
    /// Whether to write what takes readers long.
    pub force: bool,
    /// Whether to leave out clusters and their colours.
    pub is_plain: bool,
}

impl Choice {
    /// Its name in queries; its flag has dashes.
    pub fn name(self) -> &'static str {
        match self {
            Choice::Placement => "placement",
            Choice::PlyVertexColours => "ply_vertex_colours",
            Choice::Force => "force",
            Choice::Colours => "colours",
        }
    }
}
