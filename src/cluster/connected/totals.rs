//! Exact totals of a cluster: what energies and merges are computed from.

use crate::energy::{Functional, Item, Sums};

/// The totals of a cluster. `constant` and `fit` are in the component's unit; the methods shift their results left by
/// `shift`, to that of the finest component.
#[derive(Debug, Clone, Copy)]
pub struct Totals<E: Functional> {
    /// Sums over its faces.
    pub sums: E::Sums,
    /// The part of F that no labels change.
    constant: i128,
    /// The proxy, and what it explains ([`Sums::fit`]).
    pub fit: (E::Point, i128),
    /// The `energy_shift` of its component.
    pub shift: u32,
}

impl<E: Functional> Default for Totals<E> {
    fn default() -> Self {
        Self { sums: E::Sums::default(), constant: 0, fit: (E::NO_PROXY, 0), shift: 0 }
    }
}

impl<E: Functional> Totals<E> {
    /// Counts a face in (1) or out (−1); the proxy is not fitted.
    pub fn count(&mut self, face: Item<E::Point>, sign: i64) {
        self.sums.add_face(face, sign);
        self.constant += E::constant(face) * i128::from(sign);
    }

    /// Fits the proxy. Returns what is explained in addition.
    pub fn refit(&mut self) -> i128 {
        let before = std::mem::replace(&mut self.fit, self.sums.fit().unwrap_or((E::NO_PROXY, 0)));
        (self.fit.1 - before.1) << self.shift
    }

    /// What the cluster explains of F.
    pub fn explained(&self) -> i128 {
        self.fit.1 << self.shift
    }

    /// F of the cluster. No split gains more.
    pub fn energy(&self) -> i128 {
        (self.constant - self.fit.1) << self.shift
    }

    /// What merging two clusters of one component raises F by.
    pub fn merge_cost(&self, other: &Self) -> i128 {
        let mut sums = self.sums;
        sums.add(&other.sums, 1);
        (self.fit.1 + other.fit.1 - sums.explained()) << self.shift
    }
}
