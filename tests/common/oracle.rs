//! Boundary-based clustering as the definition in `tesserae::cluster` says it, one sentence a statement: sequential,
//! everything recomputed in every iteration, wide integers throughout. Slow and plain on purpose.

use tesserae::device::FREE;
use tesserae::surface::Surface;

/// The state after an iteration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct State {
    pub labels: Vec<u32>,
    /// Σ (2·P·S − M·|P|²) << shift.
    pub explained: i128,
    pub moves: u64,
}

/// Labels after growth from `seeds`.
pub fn grow(surface: &Surface, labels: &[u32]) -> Vec<u32> {
    let mut labels = labels.to_vec();
    loop {
        let before = labels.clone();
        for face in 0..labels.len() as u32 {
            if before[face as usize] == FREE {
                let reach = surface.neighbours_of(face).iter().map(|&near| before[near as usize]);
                labels[face as usize] = reach.min().unwrap_or(FREE);
            }
        }
        if labels == before {
            return labels;
        }
    }
}

/// Sums of one cluster: S, M, faces.
#[derive(Clone, Default)]
struct Sums {
    s: [i128; 3],
    m: i128,
    faces: usize,
}

fn sums(surface: &Surface, clusters: usize, labels: &[u32]) -> Vec<Sums> {
    let mut all = vec![Sums::default(); clusters];
    for (face, &label) in labels.iter().enumerate() {
        let weight = i128::from(surface.weights[face]);
        let sums = &mut all[label as usize];
        for axis in 0..3 {
            sums.s[axis] += weight * i128::from(surface.centroids[face][axis]);
        }
        sums.m += weight;
        sums.faces += 1;
    }
    all
}

fn proxy(sums: &Sums) -> [i128; 3] {
    sums.s.map(|s| (2 * s + sums.m).div_euclid(2 * sums.m))
}

/// The proxy of each cluster, all of which have faces.
pub fn proxies(surface: &Surface, clusters: usize, labels: &[u32]) -> Vec<[i128; 3]> {
    sums(surface, clusters, labels).iter().map(proxy).collect()
}

pub fn explained(surface: &Surface, component_of_cluster: &[u32], labels: &[u32]) -> i128 {
    let sums = sums(surface, component_of_cluster.len(), labels);
    sums.iter()
        .zip(component_of_cluster)
        .filter(|(sums, _)| sums.faces > 0)
        .map(|(sums, &component)| {
            let proxy = proxy(sums);
            let along: i128 = (0..3).map(|axis| 2 * proxy[axis] * sums.s[axis]).sum();
            let square: i128 = proxy.iter().map(|p| p * p).sum();
            (along - sums.m * square) << surface.components[component as usize].energy_shift
        })
        .sum()
}

/// One iteration; None when nothing moves.
pub fn iterate(surface: &Surface, component_of_cluster: &[u32], labels: &[u32]) -> Option<State> {
    let sums = sums(surface, component_of_cluster.len(), labels);
    let proxies: Vec<Option<[i128; 3]>> = sums.iter().map(|sums| (sums.faces > 0).then(|| proxy(sums))).collect();
    let distance = |face: usize, cluster: u32| {
        let proxy = proxies[cluster as usize].expect("a cluster that a face carries has faces");
        (0..3).map(|axis| (i128::from(surface.centroids[face][axis]) - proxy[axis]).pow(2)).sum::<i128>()
    };
    let wishes: Vec<Option<u32>> = (0..labels.len())
        .map(|face| {
            let own = labels[face];
            let near = surface.neighbours_of(face as u32).iter().map(|&near| labels[near as usize]);
            let (best, to) = near.filter(|&label| label != own).map(|label| (distance(face, label), label)).min()?;
            (best < distance(face, own)).then_some(to)
        })
        .collect();
    let mut after = labels.to_vec();
    let mut moves = 0;
    for face in 0..labels.len() {
        let Some(to) = wishes[face] else { continue };
        let own = labels[face];
        let leavers: Vec<usize> = (0..labels.len()).filter(|&f| labels[f] == own && wishes[f].is_some()).collect();
        if leavers.len() == sums[own as usize].faces && leavers[0] == face {
            continue;
        }
        after[face] = to;
        moves += 1;
    }
    let explained = explained(surface, component_of_cluster, &after);
    (moves > 0).then_some(State { labels: after, explained, moves })
}

/// A refinement as `tesserae::cluster::refinement` says it: its state between iterations is who was refused.
pub struct Refinement<'a> {
    pub surface: &'a Surface,
    pub component_of_cluster: &'a [u32],
    pub labels: Vec<u32>,
    refused: Vec<bool>,
    /// Whether only winners move, and only those that leave their cluster connected.
    pub connected: bool,
}

impl<'a> Refinement<'a> {
    pub fn new(surface: &'a Surface, component_of_cluster: &'a [u32], labels: Vec<u32>) -> Self {
        let refused = vec![false; labels.len()];
        Self { surface, component_of_cluster, labels, refused, connected: false }
    }

    /// The next iteration in which something moves; None when there are no bids.
    pub fn iterate(&mut self) -> Option<State> {
        loop {
            let bids = self.bids();
            let winners = self.winners(&bids);
            if bids.iter().all(Option::is_none) {
                return None;
            }
            let before = self.labels.clone();
            for &face in &winners {
                let (_, to) = bids[face].expect("winners bid");
                let from = before[face];
                let same: Vec<usize> =
                    (0..before.len()).filter(|&f| before[f] == from && bids[f].is_some_and(|(_, t)| t == to)).collect();
                let together = !self.connected && self.try_moving(&same, to);
                if !together && !self.try_moving(&[face], to) {
                    self.refused[face] = true;
                }
            }
            let moves = (0..before.len()).filter(|&face| self.labels[face] != before[face]).count() as u64;
            if moves > 0 {
                let changed: Vec<u32> = (0..before.len())
                    .filter(|&face| self.labels[face] != before[face])
                    .flat_map(|face| [self.labels[face], before[face]])
                    .collect();
                for face in 0..before.len() {
                    let near = self.surface.neighbours_of(face as u32).iter().map(|&near| self.labels[near as usize]);
                    if near.chain([self.labels[face]]).any(|label| changed.contains(&label)) {
                        self.refused[face] = false;
                    }
                }
                let explained = explained(self.surface, self.component_of_cluster, &self.labels);
                return Some(State { labels: self.labels.clone(), explained, moves });
            }
        }
    }

    /// What each face bids, and for which cluster.
    fn bids(&self) -> Vec<Option<(u32, u32)>> {
        use tesserae::cluster::refinement::{Side, bid, gain};
        let sums = sums(self.surface, self.component_of_cluster.len(), &self.labels);
        let proxies: Vec<[i128; 3]> =
            sums.iter().map(|sums| if sums.faces > 0 { proxy(sums) } else { [0; 3] }).collect();
        (0..self.labels.len())
            .map(|face| {
                let from = self.labels[face];
                if self.refused[face] || sums[from as usize].faces == 1 {
                    return None;
                }
                let side = |cluster: u32| {
                    let proxy = proxies[cluster as usize];
                    let g = self.surface.centroids[face].map(i128::from);
                    let square: i128 = (0..3).map(|axis| (g[axis] - proxy[axis]).pow(2)).sum();
                    Side { squared_distance: square as u64, weight: sums[cluster as usize].m as u64 }
                };
                let weight = self.surface.weights[face];
                let near = self.surface.neighbours_of(face as u32).iter().map(|&near| self.labels[near as usize]);
                let (gain, to) = near
                    .filter(|&to| to != from)
                    .map(|to| (gain(weight, side(from), side(to)), to))
                    .max_by_key(|&(gain, to)| (gain, std::cmp::Reverse(to)))?;
                (gain > 0).then(|| (bid(gain, weight), to))
            })
            .collect()
    }

    /// Faces whose bid is the best at both its clusters.
    fn winners(&self, bids: &[Option<(u32, u32)>]) -> Vec<usize> {
        let best_at = |cluster: u32| {
            (0..bids.len())
                .filter(|&face| bids[face].is_some_and(|(_, to)| to == cluster || self.labels[face] == cluster))
                .max_by_key(|&face| (bids[face].map(|(bid, _)| bid), std::cmp::Reverse(face)))
        };
        let best: Vec<Option<usize>> = (0..self.component_of_cluster.len() as u32).map(best_at).collect();
        let wins = |face: usize| {
            let clusters = bids[face].map(|(_, to)| [to, self.labels[face]]);
            clusters.is_some_and(|both| both.iter().all(|&cluster| best[cluster as usize] == Some(face)))
        };
        (0..bids.len()).filter(|&face| wins(face)).collect()
    }

    /// Moves faces of one cluster to another if the energy falls by it and a face is left.
    fn try_moving(&mut self, faces: &[usize], to: u32) -> bool {
        let before = self.labels.clone();
        for &face in faces {
            self.labels[face] = to;
        }
        let from = before[faces[0]];
        let energy = |labels: &[u32]| explained(self.surface, self.component_of_cluster, labels);
        let falls = self.labels.contains(&from)
            && energy(&self.labels) > energy(&before)
            && !(self.connected && self.is_in_pieces(from));
        if !falls {
            self.labels = before;
        }
        falls
    }

    /// Whether a cluster's faces are not all connected.
    fn is_in_pieces(&self, cluster: u32) -> bool {
        let faces: Vec<u32> = (0..self.labels.len() as u32).filter(|&f| self.labels[f as usize] == cluster).collect();
        let mut reached = vec![faces[0]];
        for next in 0.. {
            let Some(&face) = reached.get(next) else { break };
            for &near in self.surface.neighbours_of(face) {
                if self.labels[near as usize] == cluster && !reached.contains(&near) {
                    reached.push(near);
                }
            }
        }
        reached.len() != faces.len()
    }
}
