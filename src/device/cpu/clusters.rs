//! Sums and proxies of the clusters, in exact integers (DESIGN §3).

use rayon::prelude::*;

use super::changes::{Changes, Reader};
use crate::cluster::sums::{ClusterSums, squared_distance};
use crate::device::{FREE, LatticeEnergy};
use crate::prefetch::prefetch;
use crate::surface::DualGraph;

/// Drifts are counted in steps of so many lattice units: so few that a cluster is a thousand steps wide where that is a thousandth
/// of the mesh, and so many that how long a face rests takes 32 bits.
pub const STEP: u64 = 256;

/// More steps than any distance has.
const FAR: u64 = (1 << 30) / STEP;

/// Clusters that one thread fits; more are fitted by all.
const FEW: usize = 512;

/// Fits that are kept until they are taken over.
const FITS: usize = 1 << 15;

/// Faces on their way from one cluster to another.
#[derive(Debug, Clone, Copy, Default)]
pub struct Change(ClusterSums);

/// What faces look at of a cluster.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// P = S / M rounded to nearest, halves up.
    proxy: [i32; 3],
    /// How far the proxy has moved, in steps of [`STEP`] lattice units, all its ways added up and rounded up beyond them, so
    /// that each change adds to it; at least 2. It moves by [`FAR`] at once when the cluster gets lighter than `least_weight`
    /// said, or ends.
    pub drift: u64,
    /// A weight that the cluster has at least.
    pub least_weight: u64,
}

impl Place {
    /// In place of a cluster: it never moves.
    const NOWHERE: Self = Self { proxy: [0; 3], drift: 0, least_weight: 0 };

    /// Squared distance between a lattice point and the proxy, below 2⁵⁸.
    #[inline]
    pub fn squared_distance(&self, point: [i32; 3]) -> u64 {
        squared_distance(point, self.proxy)
    }
}

/// All clusters of a clustering.
#[derive(Debug)]
pub struct Clusters {
    sums: Vec<ClusterSums>,
    /// What faces look at; kept apart from the sums to stay in cache. Before them comes [`Place::NOWHERE`].
    places: Vec<Place>,
    /// 2·P·S − M·|P|² of each cluster, in units of its component.
    explained: Vec<i128>,
    energy_shifts: Vec<u8>,
    /// Σ explained << energy_shift.
    total: i128,
    changes: Changes,
}

impl Clusters {
    /// No faces yet.
    pub fn new(graph: &DualGraph, component_of_cluster: &[u32]) -> Self {
        let shift = |&component: &u32| graph.components[component as usize].energy_shift as u8;
        let clusters = component_of_cluster.len();
        Self {
            sums: vec![ClusterSums::default(); clusters],
            places: places(clusters),
            explained: vec![0; clusters],
            energy_shifts: component_of_cluster.iter().map(shift).collect(),
            total: 0,
            changes: Changes::all(clusters),
        }
    }

    /// Sums all labelled faces anew. All clusters have changed.
    pub fn gather(&mut self, graph: &DualGraph, labels: &[u32]) {
        self.sums.fill(ClusterSums::default());
        for (face, &label) in labels.iter().enumerate() {
            if label != FREE {
                self.sums[label as usize].add_face(graph, face, 1);
            }
        }
        self.changes = Changes::all(self.sums.len());
        self.places.iter_mut().for_each(|place| place.least_weight = 0);
        self.refit();
    }

    /// Number of clusters, those without faces included.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// The sums of a cluster.
    pub fn sums(&self, cluster: u32) -> &ClusterSums {
        &self.sums[cluster as usize]
    }

    /// The proxy of a cluster that has faces.
    pub fn proxy(&self, cluster: u32) -> [i32; 3] {
        self.place(cluster).proxy
    }

    /// The component's energy shift of a cluster.
    pub fn energy_shift(&self, cluster: u32) -> u32 {
        u32::from(self.energy_shifts[cluster as usize])
    }

    /// What faces look at of a cluster.
    #[inline]
    pub fn place(&self, cluster: u32) -> &Place {
        &self.places[cluster as usize + 1]
    }

    /// The same for the number after the cluster's. 0 is after that of none, and nowhere.
    #[inline]
    pub fn place_before(&self, next: u32) -> &Place {
        &self.places[next as usize]
    }

    /// The clusters that gained or lost a face and that this reader has not yet seen.
    pub fn take_changes(&mut self, reader: Reader) -> Vec<u32> {
        self.changes.take(reader)
    }

    /// Moves a face's share from one cluster to another. Proxies follow in [`refit`](Self::refit).
    pub fn transfer(&mut self, graph: &DualGraph, face: u32, from: u32, to: u32) {
        self.sums[from as usize].add_face(graph, face as usize, -1);
        self.sums[to as usize].add_face(graph, face as usize, 1);
        self.changes.changed(from);
        self.changes.changed(to);
    }

    /// Asks for the sums of a cluster.
    #[inline]
    pub fn prefetch(&self, cluster: u32) {
        prefetch(&self.sums, cluster as usize);
    }

    /// Gives all of one cluster to another. Proxies follow in [`refit`](Self::refit).
    pub fn merge(&mut self, into: u32, from: u32) {
        let from_sums = std::mem::take(&mut self.sums[from as usize]);
        self.sums[into as usize].add(&from_sums, 1);
        self.changes.merged(into, from);
        // so that what ended needs no fit
        let from = from as usize;
        self.total -= std::mem::take(&mut self.explained[from]) << self.energy_shifts[from];
        let ended = &mut self.places[from + 1];
        ended.least_weight = 0;
        ended.drift += FAR;
    }

    /// Fits the proxies of the clusters whose sums changed.
    pub fn refit(&mut self) {
        let changed = self.changes.take(Reader::Proxies);
        if changed.len() <= FEW {
            changed.into_iter().for_each(|cluster| self.keep_fit(cluster, self.sums[cluster as usize].fit()));
            return;
        }
        for changed in changed.chunks(FITS) {
            let fits = changed.par_iter().with_min_len(FEW).map(|&cluster| self.sums[cluster as usize].fit());
            let fits: Vec<Option<([i32; 3], i128)>> = fits.collect();
            changed.iter().zip(fits).for_each(|(&cluster, fit)| self.keep_fit(cluster, fit));
        }
    }

    /// Takes over what [`ClusterSums::fit`] says of a cluster.
    fn keep_fit(&mut self, cluster: u32, fit: Option<([i32; 3], i128)>) {
        let cluster = cluster as usize;
        let place = &mut self.places[cluster + 1];
        // a cluster without faces keeps its proxy, which nobody asks for
        let (proxy, explained) = fit.unwrap_or((place.proxy, 0));
        self.total += (explained - self.explained[cluster]) << self.energy_shifts[cluster];
        self.explained[cluster] = explained;
        // the root of a rounded square is off by far less than one
        let way = squared_distance(proxy, place.proxy);
        place.drift += (way as f64).sqrt() as u64 / STEP + 1;
        place.proxy = proxy;
        let weight = self.sums[cluster].weight as u64;
        if weight < place.least_weight {
            place.drift += FAR;
        }
        if weight < place.least_weight || weight / 2 > place.least_weight {
            place.least_weight = weight - weight / 8;
        }
    }

    /// Whether the energy falls, exactly, when `change` goes from one cluster to another, and leaves it a face.
    pub fn improves(&self, from: u32, to: u32, change: &Change) -> bool {
        let explained = |cluster: u32, sign: i64| {
            let mut sums = self.sums[cluster as usize];
            sums.add(&change.0, sign);
            sums.fit().map(|(_, explained)| explained)
        };
        let before = self.explained[from as usize] + self.explained[to as usize];
        // both clusters lie in one component: the shift is the same
        explained(from, -1).zip(explained(to, 1)).is_some_and(|(from, to)| from + to > before)
    }

    /// Energy with respect to the proxies.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy { explained: self.total }
    }
}

/// Places of so many clusters that have no faces yet.
fn places(clusters: usize) -> Vec<Place> {
    let mut places = vec![Place { drift: 2, ..Place::NOWHERE }; clusters + 1];
    places[0] = Place::NOWHERE;
    places
}

impl Change {
    /// One face.
    pub fn of(graph: &DualGraph, face: u32) -> Self {
        let mut change = Self::default();
        change.add(graph, face);
        change
    }

    /// Adds a face.
    pub fn add(&mut self, graph: &DualGraph, face: u32) {
        self.0.add_face(graph, face as usize, 1);
    }
}
