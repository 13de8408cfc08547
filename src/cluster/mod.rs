//! The algorithms: their definitions, why they end, and their drivers.
//!
//! | what | where |
//! |---|---|
//! | boundary-based clustering (P§3), and the proof that F falls | [`flat`] |
//! | refinement by exact gains, beyond the paper | [`refinement`] |
//! | connected clusters | [`connected`] |
//! | parallel multilevel, multilevel and hierarchical clustering (P§4) | [`hierarchy`], `rounds` |
//! | where flat clusterings start | [`seeds`], [`coarse`], [`merging`], [`grouping`], `group_start` |
//! | how much time to take for how low an energy | [`quality`] |
//! | the order of merges | [`crate::device::dual_edge`] |
//! | moves of whole clusters in a coarse start | [`teleport`] |
//! | moves of whole clusters after the phases, for uneven meshes | [`relocation`] |
//! | sums, proxies, merge costs and gains in exact integers | [`crate::energy`] |
//! | pieces of clusters | [`crate::device::pieces`] |
//! | numbers of clusters from one clustering to the next | [`numbers`] |
//! | the labels of chosen iterations | [`record`] |
//! | the flat algorithms that the paper compares with: ACVD, variational clustering | [`mod@reference`] |
//!
//! Drivers know devices only as [`crate::device::Steps`]; what a step computes is defined here, how is the device's.

pub mod coarse;
pub mod connected;
pub mod fast;
pub mod flat;
mod group_start;
pub mod grouping;
pub mod hierarchy;
mod hubs;
pub mod merging;
pub mod numbers;
pub mod quality;
pub mod record;
pub mod reference;
pub mod refinement;
pub mod relocation;
mod rounds;
pub mod run;
pub mod seeds;
pub mod teleport;
pub(crate) mod tree_builder;
