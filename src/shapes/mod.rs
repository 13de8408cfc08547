//! Shapes that stand for clusters: planes, spheres, cylinders and cones in place of centres (P§8).
//!
//! The energy of a cluster is that of its shape: F = Σ over clusters of (Σ over faces of w·cost + price), where the
//! cost of a face is three times the mean squared distance of its samples, and richer types than planes have a
//! [price](prices). `energy=planes` has planes alone.
//!
//! | what | where |
//! |---|---|
//! | the table of types | [`kind`] |
//! | shapes in f64 | [`shape`] |
//! | faces, and the points of them that are compared | [`faces`], [`mod@crate::surface::samples`] |
//! | exact sums over clusters | [`moments`], [`monomials`]; about the mean: [`central`] |
//! | the shape that fits moments best | [`fit`], [`eigen`] |
//! | the shape nearest to places such as corners | [`geometric`] |
//! | a shape as integers, and what a face costs | [`proxy`] |
//! | the best shape of a cluster | [`best`] |
//! | how far corners may be from it | [`tolerance`] |
//! | merges from single faces | [`merging`], [`circles`] |
//! | the shape that a cluster takes | [`fitted`] |
//! | moves of faces | [`moves`] |
//! | moves of whole clusters | [`swaps`] |
//! | clusters whose faces go to those beside them | [`dissolve`] |
//! | the whole way | [`run`] |
//! | clusterings that are given | [`given`] |
//! | hierarchies | [`merging::tree`] |
//! | what reports say of shapes, fitted to corners | [`mod@table`] |
//!
//! A fit may use any method that computes the same bits on every machine: what decides is the energy of proxies, in
//! integers.
//!
//! A new type needs a row of [`kind::Kind`], a variant of [`shape::Shape`] with its tangent, a file in `fit`, a step in
//! [`geometric`], and in [`mod@table`] its members; one that is no quadric with |∇Q| = 1, as cones, a form of
//! [`proxy::Proxy`]. Outside of this module it needs rows in the Python client and in `web/src/shapes.ts`, and a new
//! `openapi.yaml`.

pub mod best;
pub mod central;
mod circles;
pub mod dissolve;
pub mod eigen;
pub mod faces;
pub mod fit;
pub mod fitted;
pub mod geometric;
pub mod given;
pub mod merging;
pub mod moments;
pub mod monomials;
pub mod moves;
pub mod prices;
pub mod proxy;
pub mod run;
pub mod shape;
pub mod swaps;
pub mod table;
pub mod tolerance;

pub use crate::energy::shape_kind as kind;
