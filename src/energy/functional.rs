//! The parts of an energy, as traits.

use std::fmt::Debug;

use super::shape_kind::Kind as ShapeKind;

/// The parts of an energy.
pub trait Functional: Copy + Debug + Default + Send + Sync + 'static {
    /// A proxy that is not read.
    const NO_PROXY: Self::Point;

    /// [Rough](Self::rough_merge_cost) merge costs that differ by more than this factor are in the order of the packed
    /// ones.
    const ROUGH_MARGIN: f32;

    /// What the energy sees of a face beside its weight; and the proxy of a cluster, which faces are compared with.
    type Point: Copy + Debug + PartialEq + Send + Sync;
    /// The sums over the faces of a cluster.
    type Sums: Sums<Self>;
    /// The sums in 128 bits, as their definition reads: for the plain device.
    type WideSums: WideSums<Self>;
    /// What bounds the changes by splits and merges of a cluster.
    type SplitBounds: Bounds<Self>;
    /// A position in f64, on the lattice or in the source.
    type Position: Copy + Debug + AsRef<[f64]> + AsMut<[f64]> + Send + Sync;

    /// The cost of a face of weight 1 in a cluster; below 2⁵⁸.
    fn cost(point: Self::Point, proxy: Self::Point) -> u64;

    /// The share of a face in the part of the energy that no labels change, in units of its component.
    fn constant(item: Item<Self::Point>) -> i128;

    /// What merging two clusters raises the energy by, rounded down, in units of their component; below 2⁹².
    fn merge_cost(a: End<Self::Point>, b: End<Self::Point>) -> u128;

    /// The merge cost in 32 bits whose order is the order of the values, in units of the finest component.
    fn packed_merge_cost(a: End<Self::Point>, b: End<Self::Point>, energy_shift: u32) -> u32;

    /// The merge cost in single precision, in units of the component: to leave out edges that cost more than others by
    /// the [margin](Self::ROUGH_MARGIN).
    fn rough_merge_cost(a: End<Self::Point, f32>, b: End<Self::Point, f32>) -> f32;

    /// What moving a face of weight `weight` lowers the energy by, per weight; rounded, and only ever used to rank
    /// bids. `from.weight > weight`.
    fn gain(weight: u32, from: Side, to: Side) -> i64;

    /// `gain · weight` of a positive gain in 32 bits whose order is the order of the values. At least 1.
    fn bid(gain: i64, weight: u32) -> u32;

    /// How far a proxy has moved, rounded down: a face's distances change by no more than 1 above that.
    fn drift(from: Self::Point, to: Self::Point) -> u64;

    /// The proxies of clusters in f64, from source positions: for reports, never for labels. Takes the point (in f64),
    /// the area and the label of each face; sums go in the order of the faces.
    fn source_proxies(faces: impl Iterator<Item = (Self::Position, f64, u32)>, clusters: usize) -> Vec<Self::Position>;

    /// What a face adds to the energy of its cluster, given its point, its area and such a proxy.
    fn source_term(position: Self::Position, area: f64, proxy: Self::Position) -> f64;

    /// The [terms](Self::source_term) of faces, with their labels.
    fn source_terms(
        faces: impl Iterator<Item = (Self::Position, f64, u32)> + Clone,
        clusters: usize,
    ) -> impl Iterator<Item = (u32, f64)> {
        let proxies = Self::source_proxies(faces.clone(), clusters);
        faces.map(move |(at, area, label)| (label, Self::source_term(at, area, proxies[label as usize])))
    }
}

/// Exact sums over the faces of a cluster.
pub trait Sums<E: Functional>: Copy + Debug + Default + PartialEq + Send + Sync {
    /// Adds a face (`sign` 1) or takes it away (−1).
    fn add_face(&mut self, face: Item<E::Point>, sign: i64);

    /// Adds other faces (`sign` 1) or takes them away (−1).
    fn add(&mut self, other: &Self, sign: i64);

    /// Number of faces.
    fn faces(&self) -> u32;

    /// Sum of their weights, below 2³⁴.
    fn weight(&self) -> u64;

    /// The proxy that minimises the energy. None without faces.
    fn proxy(&self) -> Option<E::Point>;

    /// The proxy, and what it explains of the energy ([`LatticeEnergy`]) in units of the component. None without faces.
    fn fit(&self) -> Option<(E::Point, i128)>;

    /// What the proxy explains of the energy; nothing without faces.
    fn explained(&self) -> i128 {
        self.fit().map_or(0, |(_, explained)| explained)
    }

    /// What merging two clusters raises the energy by, exactly, in units of their component. Not below 0.
    fn rise(&self, other: &Self) -> i128 {
        let mut both = *self;
        both.add(other, 1);
        self.explained() + other.explained() - both.explained()
    }

    /// What a merge cost reads of the cluster that has this proxy.
    fn end(&self, proxy: E::Point) -> End<E::Point> {
        End { weight: self.weight(), proxy }
    }

    /// The mean place of the faces, on the lattice.
    fn mean(&self) -> E::Position;
}

/// [`Sums`] in 128 bits. Methods but the first need a cluster that has faces.
pub trait WideSums<E: Functional>: Clone + Debug + Default {
    /// Adds a face.
    fn add_face(&mut self, face: Item<E::Point>);

    /// Number of faces.
    fn faces(&self) -> u32;

    /// M.
    fn weight(&self) -> u64;

    /// The [cost](Functional::cost) of a face.
    fn cost(&self, face: Item<E::Point>) -> i128;

    /// What the proxy explains of the energy.
    fn explained(&self) -> i128;

    /// What a merge cost reads.
    fn end(&self) -> End<E::Point>;

    /// The same sums in 64 bits.
    fn narrow(&self) -> E::Sums;
}

/// Bounds of what splits and merges of a cluster change the energy by, in units of its component.
pub trait Bounds<E: Functional>: Clone + Default + Send + Sync {
    /// Adds a face of the cluster.
    fn add(&mut self, face: Item<E::Point>);

    /// No split gains more.
    fn most_gain(&self) -> f64;

    /// A merge with this cluster costs no less.
    fn least_merge_cost(&self, other: &Self) -> f64;
}

/// What the energy sees of a face.
#[derive(Debug, Clone, Copy)]
pub struct Item<P> {
    /// g.
    pub point: P,
    /// w, at least 1.
    pub weight: u32,
}

/// A cluster as an end of a dual edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct End<P, W = u64> {
    /// M < 2³⁴.
    pub weight: W,
    /// P.
    pub proxy: P,
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
    /// Its weighted mean point, the first three coordinates.
    pub proxy: [f64; 3],
    /// The type of its shape, of energies that have some.
    pub shape: Option<ShapeKind>,
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
