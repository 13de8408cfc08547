//! Labels with the exact totals of their clusters.

use crate::cluster::relocation::Totals;
use crate::device::FREE;
use crate::energy::{Functional, LatticeEnergy};
use crate::surface::Items;

/// A clustering in which every cluster has a face.
#[derive(Debug, Clone)]
pub struct Partition<'a, E: Functional> {
    items: &'a Items<E>,
    /// One label a face, internal order.
    pub labels: Vec<u32>,
    totals: Vec<Totals<E>>,
}

impl<'a, E: Functional> Partition<'a, E> {
    /// Sums up labels. Free faces count nowhere; every cluster must have a face.
    pub fn new(items: &'a Items<E>, component_of_cluster: &[u32], labels: Vec<u32>) -> Self {
        let mut totals = vec![Totals::default(); component_of_cluster.len()];
        for (totals, &component) in totals.iter_mut().zip(component_of_cluster) {
            totals.shift = items.components[component as usize].energy_shift;
        }
        for (face, &label) in labels.iter().enumerate().filter(|(_, label)| **label != FREE) {
            totals[label as usize].count(items.face(face), 1);
        }
        totals.iter_mut().for_each(|totals| _ = totals.refit());
        Self { items, labels, totals }
    }

    /// Number of clusters.
    pub fn clusters(&self) -> usize {
        self.totals.len()
    }

    /// The cost of a face in a cluster, per weight; below 2⁵⁸.
    pub fn cost(&self, face: u32, cluster: u32) -> u64 {
        E::cost(self.items.points[face as usize], self.totals[cluster as usize].fit.0)
    }

    /// By how much F falls, exactly, when a face goes to another cluster of its component; none when its own would be
    /// left empty.
    pub fn gain(&self, face: u32, to: u32) -> Option<i128> {
        self.after_move(face, to).map(|(_, fall)| fall)
    }

    /// Moves a face, which is not the last of its cluster; totals follow.
    pub fn move_face(&mut self, face: u32, to: u32) {
        if let Some(([without, with], _)) = self.after_move(face, to) {
            let from = std::mem::replace(&mut self.labels[face as usize], to);
            self.totals[from as usize] = without;
            self.totals[to as usize] = with;
        }
    }

    fn after_move(&self, face: u32, to: u32) -> Option<([Totals<E>; 2], i128)> {
        let before = [self.labels[face as usize], to].map(|cluster| self.totals[cluster as usize]);
        Totals::after_move(before, self.items.face(face as usize))
    }

    /// Energy with respect to the proxies.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy { explained: self.totals.iter().map(Totals::explained).sum() }
    }
}
