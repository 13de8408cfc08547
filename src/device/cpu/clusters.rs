//! Sums and proxies of the clusters, in exact integers ([`crate::energy`]).
//!
//! Faces move and clusters merge one at a time; [`Clusters::refit`] then fits the proxies of all clusters that changed.
//! A proxy has a *drift*: the length of its way so far. Bounds of faces are made of drifts ([`super::nearby`]).

use super::change_log::{ChangeLog, Cursor};
use super::tuning::chunks::ITEMS;
use crate::device::FREE;
use crate::energy::{Functional, LatticeEnergy, Sums};
use crate::parallel;
use crate::prefetch::prefetch;
use crate::surface::DualGraph;

/// Resolution of drift: 256 lattice units. A cluster of a thousandth of the mesh's width is still some 500 steps wide,
/// and the bound of a face fits 32 bits.
pub const DRIFT_STEP: u64 = 256;

/// More steps than any distance has, and than any slack: a bound that a cluster which ended is part of is exceeded
/// ([`super::active_faces::ActiveFaces::moved`] relies on that).
const FAR: u64 = (1 << 30) / DRIFT_STEP;

/// Faces for each cluster of a thread's sums, at least: the sums of all threads then take no more than a quarter of
/// those with a cluster a face.
const FACES_A_CLUSTER: usize = 4;

/// Fits that are computed before they are stored.
const FITS: usize = 1 << 15;

/// What the evaluation of a face reads of a cluster.
#[derive(Debug, Clone, Copy)]
pub struct CachedProxy<E: Functional> {
    /// Of a cluster without faces, its last one.
    pub proxy: E::Point,
    /// How far the proxy has moved: the sum of its ways in steps of [`DRIFT_STEP`], each rounded up by up to a step, so
    /// that every change adds to it; at least 2. [`FAR`] is added when the weight falls below `least_weight`, and when
    /// the cluster ends.
    pub drift: u64,
    /// A lower bound of the cluster's weight.
    pub least_weight: u64,
}

/// The index of a cluster among the cached proxies. Slot 0 is no cluster, and its proxy never drifts.
#[inline]
pub fn slot(cluster: u32) -> u32 {
    cluster + 1
}

impl<E: Functional> CachedProxy<E> {
    /// That of slot 0.
    const NOWHERE: Self = Self { proxy: E::NO_PROXY, drift: 0, least_weight: 0 };

    /// The cost of a face of weight 1 at a point ([`Functional::cost`]).
    #[inline]
    pub fn cost(&self, point: E::Point) -> u64 {
        E::cost(point, self.proxy)
    }
}

/// All clusters of a clustering.
#[derive(Debug)]
pub struct Clusters<E: Functional> {
    sums: Vec<E::Sums>,
    /// By [`slot`]; apart from the sums, to stay in cache.
    cached: Vec<CachedProxy<E>>,
    /// 2·P·S − M·|P|² of each cluster, in units of its component.
    explained: Vec<i128>,
    energy_shifts: Vec<u8>,
    /// Σ explained << energy_shift.
    total: i128,
    /// Which of them gained or lost a face.
    pub change_log: ChangeLog,
}

impl<E: Functional> Clusters<E> {
    /// The clusters of these labels; free faces count for none. All clusters have changed.
    pub fn of(graph: &DualGraph<E>, component_of_cluster: &[u32], labels: &[u32]) -> Self {
        let shift = |&component: &u32| graph.components[component as usize].energy_shift as u8;
        let count = component_of_cluster.len();
        let threads =
            rayon::current_num_threads().min(labels.len() / (FACES_A_CLUSTER * count).max(parallel::LEAST)).max(1);
        let mut parts: Vec<Vec<E::Sums>> =
            parallel::pieces(labels.len(), labels.len().div_ceil(threads).max(1), &|range| {
                let mut sums = vec![E::Sums::default(); count];
                for (face, &label) in range.clone().zip(&labels[range]).filter(|&(_, &label)| label != FREE) {
                    sums[label as usize].add_face(graph.face(face), 1);
                }
                sums
            });
        let mut sums = parts.pop().unwrap_or_else(|| vec![E::Sums::default(); count]);
        parts.iter().for_each(|part| sums.iter_mut().zip(part).for_each(|(sum, of_part)| sum.add(of_part, 1)));
        let mut cached = vec![CachedProxy { drift: 2, ..CachedProxy::NOWHERE }; count + 1];
        cached[0] = CachedProxy::NOWHERE;
        let mut clusters = Self {
            sums,
            cached,
            explained: vec![0; count],
            energy_shifts: component_of_cluster.iter().map(shift).collect(),
            total: 0,
            change_log: ChangeLog::all(count),
        };
        clusters.refit();
        clusters
    }

    /// Number of clusters, those without faces included.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// The sums of a cluster.
    pub fn sums(&self, cluster: u32) -> &E::Sums {
        &self.sums[cluster as usize]
    }

    /// The component's energy shift of a cluster.
    pub fn energy_shift(&self, cluster: u32) -> u32 {
        u32::from(self.energy_shifts[cluster as usize])
    }

    /// What the evaluation of a face reads of a cluster.
    #[inline]
    pub fn cached(&self, cluster: u32) -> &CachedProxy<E> {
        self.at_slot(slot(cluster))
    }

    /// The same by [`slot`].
    #[inline]
    pub fn at_slot(&self, slot: u32) -> &CachedProxy<E> {
        &self.cached[slot as usize]
    }

    /// Moves a face's share from one cluster to another. Proxies follow in [`refit`](Self::refit). Whether
    /// the clusters [may be in pieces](ChangeLog::may_be_in_pieces) is for the caller to note.
    pub fn transfer(&mut self, graph: &DualGraph<E>, face: u32, from: u32, to: u32) {
        self.sums[from as usize].add_face(graph.face(face as usize), -1);
        self.sums[to as usize].add_face(graph.face(face as usize), 1);
        self.change_log.changed(from);
        self.change_log.changed(to);
    }

    /// Requests the sums of a cluster.
    #[inline]
    pub fn prefetch(&self, cluster: u32) {
        prefetch(&self.sums, cluster as usize);
    }

    /// Merges the first cluster of each pair into the second, and fits the proxies.
    pub fn merge(&mut self, pairs: &[(u32, u32)]) {
        for &(from, into) in pairs {
            self.change_log.merged(into, from);
            let ended = &mut self.cached[slot(from) as usize];
            ended.least_weight = 0;
            ended.drift += FAR;
            let from = from as usize;
            let from_sums = std::mem::take(&mut self.sums[from]);
            self.sums[into as usize].add(&from_sums, 1);
            // a cluster that ended needs no fit
            self.total -= std::mem::take(&mut self.explained[from]) << self.energy_shifts[from];
        }
        self.refit();
    }

    /// Fits the proxies of the clusters whose sums changed.
    pub fn refit(&mut self) {
        let changed = self.change_log.take(Cursor::Proxies);
        for changed in changed.chunks(FITS) {
            let fits = parallel::map(changed.len(), ITEMS, |nth| self.sums[changed[nth] as usize].fit());
            changed.iter().zip(fits).for_each(|(&cluster, fit)| self.store_fit(cluster, fit));
        }
    }

    /// Stores what [`Sums::fit`] gives for a cluster.
    fn store_fit(&mut self, cluster: u32, fit: Option<(E::Point, i128)>) {
        let cluster = cluster as usize;
        let cached = &mut self.cached[slot(cluster as u32) as usize];
        // a cluster without faces keeps its last proxy, which is not read
        let (proxy, explained) = fit.unwrap_or((cached.proxy, 0));
        self.total += (explained - self.explained[cluster]) << self.energy_shifts[cluster];
        self.explained[cluster] = explained;
        cached.drift += E::drift(cached.proxy, proxy) / DRIFT_STEP + 1;
        cached.proxy = proxy;
        let weight = self.sums[cluster].weight();
        if weight < cached.least_weight {
            cached.drift += FAR;
        }
        if weight < cached.least_weight || weight / 2 > cached.least_weight {
            cached.least_weight = weight - weight / 8;
        }
    }

    /// Whether the energy falls, exactly, when faces with these sums move from one cluster to another, and a face is
    /// left in the first.
    pub fn improves(&self, from: u32, to: u32, moved: &E::Sums) -> bool {
        let explained = |cluster: u32, sign: i64| {
            let mut sums = self.sums[cluster as usize];
            sums.add(moved, sign);
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
