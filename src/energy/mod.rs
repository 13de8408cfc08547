//! What is minimised. Everything above takes it from here: coarse graphs, the definitions of the algorithms, devices
//! and the records of hierarchies.
//!
//! [`Functional`] and [`Sums`] list the parts of an energy; [`cvd`] is the only one so far. All code above names
//! [`Energy`] and the types below, never an energy by its own name: calls are dispatched statically, and structs have
//! no type parameter for it. A second energy implements both traits; where a run can choose, the alias becomes a
//! parameter of the types that hold sums or proxies. The same seam in WGSL is `shaders/energy/`, one file an energy.
//!
//! All arithmetic that decides a label is in integers; `docs/arithmetic.md` derives the bounds. This module knows no
//! mesh, no algorithm and no device.

pub mod cvd;
mod functional;
pub mod shared;

pub use self::functional::{Bounds, Functional, LatticeEnergy, Merged, Side, Sums};

/// The energy that everything is compiled for.
pub type Energy = cvd::Cvd;

/// What it sees of a face: a point and a weight.
pub type Item = <Energy as Functional>::Item;

/// An item without its weight.
pub type Point = <Energy as Functional>::Point;

/// What stands for a cluster when a face is compared with it.
pub type Proxy = <Energy as Functional>::Proxy;

/// The sums over the faces of a cluster.
pub type ClusterSums = <Energy as Functional>::Sums;

/// What a merge cost reads of a cluster.
pub type End = <Energy as Functional>::End;

/// By how much proxies may drift before a face could have a bid in refinement.
pub type RefinementSlack = <Energy as Functional>::RefinementSlack;

/// What bounds the changes by splits and merges of a cluster.
pub type SplitBounds = <Energy as Functional>::SplitBounds;

/// Which words a face, sums and a proxy take on a gpu.
pub use cvd::words;

/// The sums in 128 bits, as their definition reads: for the plain device.
pub use cvd::wide::Sums as WideSums;
