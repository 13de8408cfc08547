//! Moves of faces after each merge, around the clusters that changed.
//!
//! The cluster that two have become takes its best shape. Then passes over the faces at its boundary
//! ([`crate::shapes::moves`]) and fits of the clusters that changed alternate, as in flat runs, until neither changes
//! anything, or [`ROUNDS`] times.
//!
//! # Work
//!
//! A merge looks at the faces of the clusters that change. Looks count together with those of passes; when there were
//! too many ([`Clusters::is_bounded`]), no face moves any more.

use glam::DVec3;

use super::{Merging, Part, Union};
use crate::error::{Error, Result};
use crate::parallel;
use crate::shapes::fitted::{Cluster, Fitted, fitted};
use crate::shapes::kind::Kind;
use crate::shapes::moves::Clusters;

/// Rounds of fits after a merge at most; faces that could move on do so after later merges.
const ROUNDS: usize = 4;

/// Clusters whose faces move while they merge.
pub(super) struct Settling<'a> {
    /// A place for each number of a cluster.
    pub clusters: Clusters<'a>,
}

/// What settling changed.
pub(super) struct Settled {
    /// The clusters, ascending, the one that was made among them.
    pub clusters: Vec<u32>,
    /// Faces by their numbers: (face, from, to).
    pub moves: Vec<(u32, u32, u32)>,
    /// What that raised the energy by, as in [`Union`].
    pub rise: f64,
}

impl<'a> Settling<'a> {
    /// Of clusters that no face has moved between, a label a face.
    pub fn new(merging: &Merging<'a>, labels: Vec<u32>) -> Result<Self> {
        let fit = |number: usize| {
            let number = number as u32;
            (merging.into[number as usize] == number).then(|| {
                let members: Vec<u32> = merging.members.of(number).collect();
                fit(merging, number, &members, merging.parts[number as usize].axis, None).ok_or_else(no_shape)
            })
        };
        let fits: Vec<Option<Result<Fitted>>> = parallel::map(labels.len(), 1, fit);
        let mut fits = fits.into_iter().map(Option::transpose).collect::<Result<Vec<_>>>()?;
        // numbers that stand for no cluster have any shape
        if let Some(some) = fits.iter().flatten().next().copied() {
            fits.iter_mut().for_each(|fit| _ = fit.get_or_insert(some));
        }
        let fits: Vec<Fitted> = fits.into_iter().flatten().collect();
        Ok(Self { clusters: Clusters::new(merging.faces, None, labels, &fits) })
    }

    /// Moves faces after a merge, and tells the clusters that changed.
    pub fn settle(&mut self, merging: &mut Merging<'a>, union: &Union) -> Result<Settled> {
        let &Union { from, into, .. } = union;
        let members: Vec<u32> = merging.members.of(into).collect();
        let axis = merging.parts[into as usize].axis;
        let fitted = fit(merging, into, &members, axis, None).ok_or_else(no_shape)?;
        self.clusters.join(from, into, &members, fitted);
        let (mut all_changed, mut log) = (vec![into], Vec::new());
        let mut has_new_shape = vec![into];
        for _ in 0..ROUNDS {
            let mut faces = self.at_boundaries(merging, &has_new_shape);
            while !faces.is_empty() {
                faces = self.clusters.pass(&faces, &[])?.1;
            }
            let moved = std::mem::take(&mut self.clusters.log);
            if moved.is_empty() {
                break;
            }
            let mut changed = Vec::with_capacity(2 * moved.len());
            for &(face, from, to) in &moved {
                merging.give(face, from, to);
                changed.extend([from, to]);
            }
            changed.sort_unstable();
            changed.dedup();
            has_new_shape = changed.iter().copied().filter(|&cluster| self.refit(merging, cluster)).collect();
            all_changed.extend(changed);
            log.extend(moved);
            if has_new_shape.is_empty() {
                break;
            }
        }
        all_changed.sort_unstable();
        all_changed.dedup();
        let mut rise = 0.0;
        for &cluster in &all_changed {
            rise -= merging.cost(cluster);
            merging.refresh(cluster, self.clusters.shapes[cluster as usize].axis());
            rise += merging.cost(cluster);
        }
        // the first move of a face says where it was
        log.sort_by_key(|&(face, ..)| face);
        log.dedup_by_key(|&mut (face, ..)| face);
        let labels = &self.clusters.labels;
        let moves = log.into_iter().map(|(face, from, _)| (face, from, labels[face as usize]));
        let moves = moves.filter(|(_, from, to)| from != to).collect();
        Ok(Settled { clusters: all_changed, moves, rise })
    }

    /// The clusters beside one.
    pub fn beside(&self, merging: &Merging<'_>, cluster: u32) -> Vec<u32> {
        let labels = &self.clusters.labels;
        let near = |face: u32| merging.faces.graph.neighbours_of(face).iter().map(|&near| labels[near as usize]);
        let mut all: Vec<u32> = merging.members.of(cluster).flat_map(near).filter(|&near| near != cluster).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The faces on both sides of the boundaries of some clusters, ascending.
    fn at_boundaries(&mut self, merging: &Merging<'_>, of: &[u32]) -> Vec<u32> {
        let Clusters { faces, labels, .. } = &self.clusters;
        let mut at = Vec::new();
        let mut looks = 0;
        for &cluster in of {
            for face in merging.members.of(cluster) {
                let beside = faces.graph.neighbours_of(face);
                looks += 1 + beside.len();
                let before = at.len();
                at.extend(beside.iter().copied().filter(|&near| labels[near as usize] != cluster));
                if at.len() > before {
                    at.push(face);
                }
            }
        }
        self.clusters.look(looks);
        at.sort_unstable();
        at.dedup();
        at
    }

    /// Fits a shape to a cluster that changed. Returns whether it took one.
    fn refit(&mut self, merging: &Merging<'_>, cluster: u32) -> bool {
        let members: Vec<u32> = merging.members.of(cluster).collect();
        self.clusters.look(members.len());
        let number = cluster as usize;
        let (axis, so_far) =
            (self.clusters.shapes[number].axis(), (self.clusters.shapes[number].kind(), self.clusters.costs[number]));
        let fit = fit(merging, cluster, &members, axis, Some(so_far));
        if let Some(Fitted { shape, proxy, cost }) = fit {
            self.clusters.shapes[number] = shape;
            self.clusters.proxies[number] = proxy;
            self.clusters.costs[number] = cost;
        }
        fit.is_some()
    }
}

fn fit(
    merging: &Merging<'_>,
    cluster: u32,
    members: &[u32],
    axis: Option<DVec3>,
    so_far: Option<(Kind, i128)>,
) -> Option<Fitted> {
    let Part { component, ref moments, .. } = merging.parts[cluster as usize];
    let of = Cluster { component, members, moments, axis };
    fitted(merging.faces, merging.allowed, &of, || merging.higher_of(cluster), so_far)
}

fn no_shape() -> Error {
    Error::internal("a cluster has no shape")
}
