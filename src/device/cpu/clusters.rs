//! Sums and proxies of the clusters, in exact integers (DESIGN §3).

use crate::device::{FREE, LatticeEnergy};
use crate::surface::Surface;

/// The cluster sums: S, M and the number of faces.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// S = Σ w·g, |S| < 2⁶¹ an axis.
    centroid: [i64; 3],
    /// M = Σ w < 2³⁴.
    weight: i64,
    faces: u32,
}

/// Faces on their way from one cluster to another.
#[derive(Debug, Clone, Copy, Default)]
pub struct Change(Sums);

/// All clusters of a clustering.
#[derive(Debug)]
pub struct Clusters {
    sums: Vec<Sums>,
    /// P = S / M rounded to nearest, halves up. What a face compares; kept apart from the sums to stay in cache.
    proxies: Vec<[i32; 3]>,
    /// 2·P·S − M·|P|² of each cluster, in units of its component.
    explained: Vec<i128>,
    energy_shifts: Vec<u8>,
    /// Σ explained << energy_shift.
    total: i128,
    /// The iteration in which a cluster last gained or lost a face.
    changed_in: Vec<u32>,
    /// The clusters that did in the current iteration.
    changed: Vec<u32>,
    iteration: u32,
}

impl Clusters {
    /// No faces yet.
    pub fn new(surface: &Surface, component_of_cluster: &[u32]) -> Self {
        let shift = |&component: &u32| surface.components[component as usize].energy_shift as u8;
        let clusters = component_of_cluster.len();
        Self {
            sums: vec![Sums::default(); clusters],
            proxies: vec![[0; 3]; clusters],
            explained: vec![0; clusters],
            energy_shifts: component_of_cluster.iter().map(shift).collect(),
            total: 0,
            changed_in: vec![0; clusters],
            changed: Vec::new(),
            iteration: 0,
        }
    }

    /// Sums all labelled faces anew. All clusters have changed.
    pub fn gather(&mut self, surface: &Surface, labels: &[u32]) {
        self.sums.fill(Sums::default());
        for (face, &label) in labels.iter().enumerate() {
            if label != FREE {
                self.sums[label as usize].add(surface, face, 1);
            }
        }
        self.mark_all_changed();
        self.refit();
    }

    /// Lets every cluster count as changed, so that all boundary faces look again.
    pub fn mark_all_changed(&mut self) {
        self.begin_iteration();
        self.changed.extend(0..self.sums.len() as u32);
        self.changed_in.fill(self.iteration);
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Number of faces of a cluster.
    pub fn faces(&self, cluster: u32) -> u32 {
        self.sums[cluster as usize].faces
    }

    /// M of a cluster.
    pub fn weight(&self, cluster: u32) -> u64 {
        self.sums[cluster as usize].weight as u64
    }

    /// Squared distance between a lattice point and a cluster's proxy, below 2⁵⁸.
    pub fn squared_distance(&self, point: [i32; 3], cluster: u32) -> i64 {
        let proxy = self.proxies[cluster as usize];
        (0..3)
            .map(|axis| {
                let difference = i64::from(point[axis]) - i64::from(proxy[axis]);
                difference * difference
            })
            .sum()
    }

    /// The clusters that gained or lost a face in the current iteration.
    pub fn changed(&self) -> &[u32] {
        &self.changed
    }

    /// Begins an iteration: nothing has changed in it yet.
    pub fn begin_iteration(&mut self) {
        self.iteration += 1;
        self.changed.clear();
    }

    /// Moves a face's share from one cluster to another. Proxies follow in [`refit`](Self::refit).
    pub fn transfer(&mut self, surface: &Surface, face: u32, from: u32, to: u32) {
        self.sums[from as usize].add(surface, face as usize, -1);
        self.sums[to as usize].add(surface, face as usize, 1);
        for cluster in [from, to] {
            if self.changed_in[cluster as usize] != self.iteration {
                self.changed_in[cluster as usize] = self.iteration;
                self.changed.push(cluster);
            }
        }
    }

    /// Fits the proxies of the clusters that changed in this iteration.
    pub fn refit(&mut self) {
        for &cluster in &self.changed {
            let cluster = cluster as usize;
            // a cluster without faces keeps its proxy, which nobody asks for
            let (proxy, explained) = self.sums[cluster].fit().unwrap_or((self.proxies[cluster], 0));
            self.total += (explained - self.explained[cluster]) << self.energy_shifts[cluster];
            self.proxies[cluster] = proxy;
            self.explained[cluster] = explained;
        }
        // clusters with close numbers lie close together: whoever visits what has changed finds it in memory order
        self.changed.sort_unstable();
    }

    /// Whether the energy falls, exactly, when `change` goes from one cluster to another, and leaves it a face.
    pub fn improves(&self, from: u32, to: u32, change: &Change) -> bool {
        let explained = |cluster: u32, sign: i64| {
            let mut sums = self.sums[cluster as usize];
            sums.add_all(&change.0, sign);
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

impl Change {
    /// Adds a face.
    pub fn add(&mut self, surface: &Surface, face: u32) {
        self.0.add(surface, face as usize, 1);
    }
}

impl Sums {
    /// Adds a face (`sign` 1) or takes it away (−1).
    fn add(&mut self, surface: &Surface, face: usize, sign: i64) {
        let weight = i64::from(surface.weights[face]);
        let centroid = surface.centroids[face].map(|g| weight * i64::from(g));
        self.add_all(&Sums { centroid, weight, faces: 1 }, sign);
    }

    fn add_all(&mut self, other: &Sums, sign: i64) {
        for axis in 0..3 {
            self.centroid[axis] += sign * other.centroid[axis];
        }
        self.weight += sign * other.weight;
        self.faces = self.faces.wrapping_add_signed(sign as i32 * other.faces as i32);
    }

    /// The nearest lattice point to S/M and 2·P·S − M·|P|²; None without faces.
    fn fit(&self) -> Option<([i32; 3], i128)> {
        if self.faces == 0 {
            return None;
        }
        let proxy = self.centroid.map(|s| (2 * s + self.weight).div_euclid(2 * self.weight) as i32);
        let mut along = 0;
        let mut square = 0;
        for axis in 0..3 {
            along += i128::from(proxy[axis]) * i128::from(self.centroid[axis]);
            square += i64::from(proxy[axis]) * i64::from(proxy[axis]);
        }
        Some((proxy, 2 * along - i128::from(self.weight) * i128::from(square)))
    }
}
