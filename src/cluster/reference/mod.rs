//! The flat algorithms that the paper compares itself with, as users may call them: sequential, on the cpu, written for
//! clarity. The energies of [`super::flat`] are compared with theirs; times are not.
//!
//! | what | where |
//! |---|---|
//! | energy minimisation by local queries (Valette & Chassery 2004), `acvd` | [`acvd`] |
//! | variational clustering with a priority queue (Cohen-Steiner et al. 2004), `vc` | [`variational`] |
//!
//! Both decide by integers, so their labels are as reproducible as all others.

pub mod acvd;
pub mod variational;
