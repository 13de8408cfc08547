//! How clusters meet: the complex of cells, arcs and junctions, and what is read off it.
//!
//! # Definition
//!
//! [`CutSurface`] turns a mesh into a 2-manifold with boundary S. Vertices at equal positions are one; polygons are
//! fans of triangles; triangles with two equal corners go; triangles are oriented alike where possible. An edge that
//! then has not exactly two opposite half-edges is cut, and a vertex becomes one vertex for each of its umbrellas
//! ([`half_edges`]).
//!
//! Every triangle of S is in a *cell*: a cluster, or a part of one. A half-edge *crosses* if another cell, or none,
//! is on its right. The half-edges that cross divide the triangles around a vertex into *sectors*. A *junction* is a
//! vertex of at least three sectors, on a boundary of at least two. An *arc* is a maximal chain of edges that cross,
//! between the same two cells and without a junction inside; at a boundary it has one cell.
//!
//! # Arcs cover every edge that crosses, once
//!
//! Let a half-edge h cross, with cell a on its left and b on its right, and let its target v be no junction. If v is
//! inside S, its number of sectors is that of the edges at v that cross. It is not 1: around v, a cell that changes
//! changes back. So it is 2, and exactly one further edge at v crosses. Its cells are again a and b, since the
//! triangles between the two edges lie in one sector. If v is on the boundary, it has one sector. Then h is a
//! boundary half-edge, and the only other edge that crosses is the boundary half-edge that leaves v, which has a on
//! its left. So every chain has one continuation in each direction up to a junction, or closes: arcs are classes of
//! edges. The direction of an arc has the lower cell on its left, at a boundary the only one.
//!
//! [`Boundaries`] are the arcs as curves, [`Graph`] is the cells as nodes with the table of clusters, and
//! [`crate::remesh`] is the dual: a vertex a cell, an edge an arc, a polygon a junction.
//!
//! This module knows labels from anywhere and no algorithm. Nothing here decides a label, so lengths and areas are f64,
//! added in a fixed order.

pub mod arcs;
pub mod boundaries;
pub mod graph;
pub mod half_edges;
pub mod surface;
pub mod table;

pub use arcs::{Arc, Complex};
pub use boundaries::Boundaries;
pub use graph::Graph;
pub use surface::{CutSurface, check_labels};
pub use table::Cluster;
