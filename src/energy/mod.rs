//! What is minimised. Everything above takes it from here: coarse graphs, the definitions of the algorithms, devices
//! and the records of hierarchies.
//!
//! [`Functional`] and [`Sums`] list the parts of an energy; [`cvd`] is the only one so far, for points of any number of
//! coordinates. All code above is generic over the energy `E`, or names [`Energy`] where it knows meshes: calls are
//! dispatched statically. The same seam in WGSL is `shaders/energy/`, one file an energy.
//!
//! [`Kind`] lists what a job can minimise. L2,1 is [`cvd`] of other points: of [`Normals`].
//!
//! All arithmetic that decides a label is in integers; `docs/arithmetic.md` derives the bounds. This module knows no
//! mesh, no algorithm and no device.

pub mod cvd;
mod functional;
mod kind;
pub mod shape_kind;
pub mod shared;

pub use self::functional::{Bounds, End, Functional, Item, LatticeEnergy, Merged, Side, Sums, WideSums};
pub use self::kind::Kind;

/// The energy of points with D coordinates.
pub type OfPoints<const D: usize> = cvd::Cvd<D>;

/// The energy of meshes, whose points have three coordinates.
pub type Energy = OfPoints<3>;

/// The energy of meshes by normals. A point is the unit normal, and the centroid in so small a unit that it decides
/// only between equal normals ([`crate::surface::of_faces::OfFaces`]); two coordinates are 0.
pub type Normals = OfPoints<8>;

/// The sums over the faces of a cluster of a mesh.
pub type ClusterSums = <Energy as Functional>::Sums;

/// An energy whose numbers a gpu has as words.
pub use self::shared::Words;

/// By how much proxies may drift before a face could move in the boundary phase, or have a bid in refinement.
pub use cvd::{RefinementSlack, boundary_slack};

/// Which words a face, sums and a proxy take on a gpu.
pub use cvd::words;
