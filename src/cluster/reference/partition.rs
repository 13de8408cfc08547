//! Labels with the exact sums of their clusters.

use crate::device::FREE;
use crate::energy::{Functional, LatticeEnergy, Sums};
use crate::surface::Items;

/// A clustering in which every cluster has a face.
#[derive(Debug, Clone)]
pub struct Partition<'a, E: Functional> {
    items: &'a Items<E>,
    component_of_cluster: &'a [u32],
    /// One label a face, internal order.
    pub labels: Vec<u32>,
    sums: Vec<E::Sums>,
    /// Proxy of each cluster, and what it explains of the energy in units of the cluster's component.
    fits: Vec<Fit<E>>,
}

/// A proxy, and what it explains ([`Sums::fit`]).
type Fit<E> = (<E as Functional>::Proxy, i128);

impl<'a, E: Functional> Partition<'a, E> {
    /// Sums up labels. Free faces count nowhere; every cluster must have a face.
    pub fn new(items: &'a Items<E>, component_of_cluster: &'a [u32], labels: Vec<u32>) -> Self {
        let mut sums = vec![E::Sums::default(); component_of_cluster.len()];
        for (face, &label) in labels.iter().enumerate() {
            if label != FREE {
                sums[label as usize].add_face(items.face(face), 1);
            }
        }
        let fits = sums.iter().map(fit::<E>).collect();
        Self { items, component_of_cluster, labels, sums, fits }
    }

    /// Number of clusters.
    pub fn clusters(&self) -> usize {
        self.sums.len()
    }

    /// The proxy of a cluster.
    pub fn proxy(&self, cluster: u32) -> E::Proxy {
        self.fits[cluster as usize].0
    }

    /// The cost of a face in a cluster, per weight; below 2⁵⁸.
    pub fn cost(&self, face: u32, cluster: u32) -> u64 {
        E::cost(self.items.points[face as usize], self.proxy(cluster))
    }

    /// By how much F falls, exactly, when a face goes to another cluster of its component, in units of that component;
    /// none when its own would be left empty.
    pub fn gain(&self, face: u32, to: u32) -> Option<i128> {
        let from = self.labels[face as usize];
        if self.sums[from as usize].faces() == 1 {
            return None;
        }
        let explained = |cluster: u32, sign: i64| {
            let mut sums = self.sums[cluster as usize];
            sums.add_face(self.items.face(face as usize), sign);
            fit::<E>(&sums).1
        };
        let before = self.fits[from as usize].1 + self.fits[to as usize].1;
        Some(explained(from, -1) + explained(to, 1) - before)
    }

    /// Moves a face; sums and proxies follow.
    pub fn move_face(&mut self, face: u32, to: u32) {
        let from = std::mem::replace(&mut self.labels[face as usize], to);
        for (cluster, sign) in [(from as usize, -1), (to as usize, 1)] {
            self.sums[cluster].add_face(self.items.face(face as usize), sign);
            self.fits[cluster] = fit::<E>(&self.sums[cluster]);
        }
    }

    /// Energy with respect to the proxies.
    pub fn energy(&self) -> LatticeEnergy {
        let shift = |component: u32| self.items.components[component as usize].energy_shift;
        let explained = self.fits.iter().zip(self.component_of_cluster);
        LatticeEnergy { explained: explained.map(|((_, explained), &component)| explained << shift(component)).sum() }
    }
}

/// The proxy of some sums, and what it explains; nothing where there are no faces.
fn fit<E: Functional>(sums: &E::Sums) -> Fit<E> {
    sums.fit().unwrap_or((E::NO_PROXY, 0))
}
