//! The parts of an energy, as traits.

use std::fmt::Debug;

use glam::DVec3;

/// The parts of an energy.
pub trait Functional {
    /// Its name in reports, and that of its file in `shaders/energy/`.
    const NAME: &'static str;

    /// See [`super::Item`].
    type Item: Copy + Debug;
    /// See [`super::Point`].
    type Point: Copy + Debug;
    /// See [`super::Proxy`].
    type Proxy: Copy + Debug + PartialEq;
    /// See [`super::ClusterSums`].
    type Sums: Sums<Item = Self::Item, Proxy = Self::Proxy, End = Self::End>;
    /// See [`super::End`].
    type End: Copy + Debug;
    /// See [`super::RefinementSlack`].
    type RefinementSlack: Copy + Debug;
    /// See [`super::SplitBounds`].
    type SplitBounds: Bounds<Item = Self::Item>;

    /// What the energy sees of a face.
    fn item(point: Self::Point, weight: u32) -> Self::Item;

    /// The proxy that fits one point alone.
    fn proxy_at(point: Self::Point) -> Self::Proxy;

    /// The cost of a face of weight 1 in a cluster; below 2⁵⁸.
    fn cost(point: Self::Point, proxy: Self::Proxy) -> u64;

    /// The share of a face in the part of the energy that no labels change, in units of its component.
    fn constant(item: Self::Item) -> i128;

    /// What merging two clusters raises the energy by, rounded down, in units of their component; below 2⁹².
    fn merge_cost(a: Self::End, b: Self::End) -> u128;

    /// The merge cost in 32 bits whose order is the order of the values, in units of the finest component.
    fn packed_merge_cost(a: Self::End, b: Self::End, energy_shift: u32) -> u32;

    /// The merge cost in units of the component, with a relative error of some 2⁻⁵⁰: to leave out edges that cost far
    /// more.
    fn merge_cost_about(a: Self::End, b: Self::End) -> f64;

    /// The merge cost with respect to exact proxies, in units of the component: for records.
    fn merge_cost_of_means(a: &Self::Sums, b: &Self::Sums) -> f64;

    /// What moving a face of weight `weight` lowers the energy by, per weight; rounded, and only ever used to rank
    /// bids. `from.weight > weight`.
    fn gain(weight: u32, from: Side, to: Side) -> i64;

    /// `gain · weight` of a positive gain in 32 bits whose order is the order of the values. At least 1.
    fn bid(gain: i64, weight: u32) -> u32;

    /// How far a proxy has moved, rounded down: a face's distances change by no more than 1 above that.
    fn drift(from: Self::Proxy, to: Self::Proxy) -> u64;

    /// What each face adds to the energy of its cluster, with its label, in f64, from source positions: for reports,
    /// never for labels. Takes the point (in f64), the area and the label of each face; sums go in the order of the
    /// faces.
    fn source_terms(
        faces: impl Iterator<Item = (DVec3, f64, u32)> + Clone,
        clusters: usize,
    ) -> impl Iterator<Item = (u32, f64)>;

    /// The sum of the [terms](Self::source_terms).
    fn source_energy(faces: impl Iterator<Item = (DVec3, f64, u32)> + Clone, clusters: usize) -> f64 {
        Self::source_terms(faces, clusters).map(|(_, term)| term).sum()
    }

    /// By how much proxies may drift, together, before a face that stays could want to move in the boundary phase.
    /// Takes its cost in its own cluster and the least in another.
    fn boundary_slack(own: u64, least_other: u64) -> u64;
}

/// Exact sums over the faces of a cluster.
pub trait Sums: Copy + Debug + Default + PartialEq {
    /// See [`super::Item`].
    type Item;
    /// See [`super::Proxy`].
    type Proxy;
    /// See [`super::End`].
    type End;

    /// Adds a face (`sign` 1) or takes it away (−1).
    fn add_face(&mut self, face: Self::Item, sign: i64);

    /// Adds other faces (`sign` 1) or takes them away (−1).
    fn add(&mut self, other: &Self, sign: i64);

    /// Number of faces.
    fn faces(&self) -> u32;

    /// Sum of their weights, below 2³⁴.
    fn weight(&self) -> u64;

    /// The proxy that minimises the energy. None without faces.
    fn proxy(&self) -> Option<Self::Proxy>;

    /// The proxy, and what it explains of the energy ([`LatticeEnergy`]) in units of the component. None without faces.
    fn fit(&self) -> Option<(Self::Proxy, i128)>;

    /// What a merge cost reads of the cluster that has this proxy.
    fn end(&self, proxy: Self::Proxy) -> Self::End;

    /// The mean place of the faces, on the lattice.
    fn mean(&self) -> DVec3;
}

/// Bounds of what splits and merges of a cluster change the energy by, in units of its component.
pub trait Bounds: Clone + Default {
    /// See [`super::Item`].
    type Item;

    /// Adds a face of the cluster.
    fn add(&mut self, face: Self::Item);

    /// No split gains more.
    fn most_gain(&self) -> f64;

    /// A merge with this cluster costs no less.
    fn least_merge_cost(&self, other: &Self) -> f64;
}

/// A cluster as a bidding face sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Side {
    /// The face's [cost](Functional::cost).
    pub cost: u64,
    /// M < 2³⁴.
    pub weight: u64,
}

/// What a merge of two clusters makes, in source units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Merged {
    /// Rise of the energy by the merge (P§6, dual edge collapse cost).
    pub cost: f64,
    /// Energy of the merged cluster, before any optimisation.
    pub energy: f64,
    /// Its number of faces.
    pub faces: u32,
    /// Its weight, as area.
    pub weight: f64,
    /// Its weighted mean centroid.
    pub proxy: [f64; 3],
}

/// What the proxies explain of the constant part of the energy, exactly.
///
/// The energy is `F = constant − explained` with the constant of the surface ([`Functional::constant`], summed over its
/// faces); devices leave the constant out, because it needs no device. |explained| < 2¹²³.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct LatticeEnergy {
    /// The explained part, in units of the lattice with the finest weights.
    pub explained: i128,
}
