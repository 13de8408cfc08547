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
    /// 2·P·S − M·|P|² in units of the cluster's component.
    explained: i128,
}

/// All clusters of a clustering.
#[derive(Debug)]
pub struct Clusters {
    sums: Vec<Sums>,
    /// P = S / M rounded to nearest, halves up. What a face compares; kept apart from the sums to stay in cache.
    proxies: Vec<[i32; 3]>,
    energy_shifts: Vec<u8>,
    /// Σ explained << energy_shift.
    explained: i128,
    /// Whether the sums fit the labels.
    is_current: bool,
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
        Self {
            sums: vec![Sums::default(); component_of_cluster.len()],
            proxies: vec![[0; 3]; component_of_cluster.len()],
            energy_shifts: component_of_cluster.iter().map(shift).collect(),
            explained: 0,
            is_current: false,
            changed_in: vec![0; component_of_cluster.len()],
            changed: Vec::new(),
            iteration: 0,
        }
    }

    /// Marks the sums as stale: labels changed elsewhere.
    pub fn forget(&mut self) {
        self.is_current = false;
    }

    /// Sums all faces anew, unless the sums are current.
    pub fn gather(&mut self, surface: &Surface, labels: &[u32]) {
        if self.is_current {
            return;
        }
        self.sums.fill(Sums::default());
        for (face, &label) in labels.iter().enumerate() {
            if label != FREE {
                self.sums[label as usize].add(surface, face, 1);
            }
        }
        self.explained = 0;
        for cluster in 0..self.sums.len() {
            self.fit(cluster);
        }
        self.is_current = true;
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Number of faces of a cluster.
    pub fn faces(&self, cluster: u32) -> u32 {
        self.sums[cluster as usize].faces
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

    /// Whether the cluster gained or lost a face in the last iteration.
    pub fn has_changed(&self, cluster: u32) -> bool {
        self.changed_in[cluster as usize] == self.iteration
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
        for index in 0..self.changed.len() {
            self.fit(self.changed[index] as usize);
        }
    }

    /// Energy with respect to the proxies.
    pub fn energy(&self) -> LatticeEnergy {
        LatticeEnergy {
            explained: self.explained,
        }
    }

    /// Fits one proxy and keeps the energy in step. A cluster without faces explains nothing.
    fn fit(&mut self, cluster: usize) {
        let sums = &mut self.sums[cluster];
        let before = std::mem::take(&mut sums.explained);
        if sums.faces > 0 {
            let proxy = sums
                .centroid
                .map(|s| (2 * s + sums.weight).div_euclid(2 * sums.weight) as i32);
            let mut square = 0;
            for axis in 0..3 {
                sums.explained += 2 * i128::from(proxy[axis]) * i128::from(sums.centroid[axis]);
                square += i64::from(proxy[axis]) * i64::from(proxy[axis]);
            }
            sums.explained -= i128::from(sums.weight) * i128::from(square);
            self.proxies[cluster] = proxy;
        }
        self.explained += (sums.explained - before) << self.energy_shifts[cluster];
    }
}

impl Sums {
    /// Adds a face (`sign` 1) or takes it away (−1).
    fn add(&mut self, surface: &Surface, face: usize, sign: i64) {
        let weight = sign * i64::from(surface.weights[face]);
        let centroid = surface.centroids[face];
        for axis in 0..3 {
            self.centroid[axis] += weight * i64::from(centroid[axis]);
        }
        self.weight += weight;
        self.faces = self.faces.wrapping_add_signed(sign as i32);
    }
}
