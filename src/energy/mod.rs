//! What is minimised. Everything above takes it from here: building coarse graphs, the definitions of the algorithms,
//! devices and the records of hierarchies.
//!
//! An energy has these parts; [`cvd`] is the only one so far.
//!
//! | part | of `cvd` |
//! |---|---|
//! | item: what it sees of a face | [`cvd::Face`] |
//! | exact sums over the faces of a cluster, and adding and removing faces | [`cvd::ClusterSums`] |
//! | proxy: what a face is compared with, and how it is fitted to the sums | [`cvd::ClusterSums::fit`] |
//! | cost of a face with respect to a proxy | [`cvd::squared_distance`] × weight |
//! | energy of sums, exact | [`LatticeEnergy`], from the explained part of [`cvd::ClusterSums::fit`] |
//! | merge cost, exact and packed | [`cvd::exact_cost`], [`cvd::packed_cost`] |
//! | gain of a move, and its bid | [`cvd::gain`], [`cvd::bid`] |
//! | bound for skipping faces, if distances obey the triangle inequality | `device::cpu::nearby` |
//!
//! Calls are dispatched statically. This module knows no mesh, no algorithm and no device.

pub mod cvd;

pub use cvd::LatticeEnergy;
