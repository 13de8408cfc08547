//! What a type costs. A plane is a flat sphere: without a price, noise turns planes into spheres.
//!
//! A sphere costs 3·R²·Ā, a cylinder twice and a cone three times that, R the resolution and Ā the area of the mesh
//! over the number of clusters: what faces at the distance R would cost in a cluster of mean size. Prices are those of
//! clusters, so that borders do not shift.

use super::kind::Kind;
use super::moments::SHIFT;
use crate::surface::DualGraph;

/// The price of one number more than a plane has, in a component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prices {
    /// Weight × squared units of moments.
    unit: f64,
}

/// The number of clusters that prices are for where a tolerance decides it, and of whole hierarchies.
const LIKELY: usize = 100;

/// No resolution counts as larger: the diagonal of the lattice.
const LARGEST: f64 = 4.68e8;

impl Prices {
    /// Those of each component, for so many clusters; `resolution` in lattice units, the diagonal at most.
    pub fn of(graph: &DualGraph, clusters: usize, resolution: f64) -> Vec<Self> {
        let units = |shift: u32| f64::from(1u32 << shift);
        let all: f64 =
            graph.components.iter().map(|component| component.weight as f64 * units(component.energy_shift)).sum();
        let mean = all / clusters as f64;
        let scaled = resolution.min(LARGEST) / f64::from(1u32 << SHIFT);
        let price = |shift: u32| Self { unit: 3.0 * scaled * scaled * mean / units(shift) };
        graph.components.iter().map(|component| price(component.energy_shift)).collect()
    }

    /// Those of each component, for clusters within a tolerance. Large resolutions are cut, so that the prices of a
    /// cluster a face sum up to no more than those of the largest resolution.
    pub fn of_tolerance(graph: &DualGraph, resolution: f64) -> Vec<Self> {
        Self::of_tree(graph, None, resolution)
    }

    /// Those of each component, for a hierarchy that ends with so many clusters, if it does. Large resolutions are cut
    /// as in [`of_tolerance`](Self::of_tolerance).
    pub fn of_tree(graph: &DualGraph, clusters: Option<u64>, resolution: f64) -> Vec<Self> {
        let clusters = clusters.map_or(LIKELY, |clusters| clusters as usize);
        let most = LARGEST * (clusters as f64 / graph.faces() as f64).sqrt();
        Self::of(graph, clusters, resolution.min(most))
    }

    /// The price of a type in units of moments.
    pub fn of_kind(&self, kind: Kind) -> f64 {
        f64::from(kind.prices()) * self.unit
    }

    /// The price of a type in the energy: weight × squared lattice units. A cluster that it does not pay for, within a
    /// tolerance, has three faces at least, so that those of all sum up to less than 2¹²⁶ in units of the finest
    /// component.
    pub fn exact(&self, kind: Kind) -> i128 {
        (self.of_kind(kind) * f64::from(1u32 << (2 * SHIFT))) as i128
    }
}
