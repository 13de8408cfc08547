//! Merges to a number of clusters, and others that go on from a state on the way there.
//!
//! Where the number of faces is many times that of clusters, most of the time goes into the merges before that state.
//!
//! Planes have one start, whose last merges are made one by one, with moves of faces after each
//! ([`multilevel`](super::multilevel)): that takes as long as the other starts of curved shapes, or less.

use glam::DVec3;

use super::multilevel::{Settled, Settling};
use super::one_by_one::{Queue, no_edge};
use super::{KEPT_FROM, Merged, Merging, Part};
use crate::device::Cancel;
use crate::error::Result;
use crate::parallel;
use crate::shapes::best::{Allowed, Best, FEWEST_FACES};
use crate::shapes::faces::{Faces, members};
use crate::shapes::moments::{Higher, Moments};

/// Clusters for each that is wanted, in the state from which other merges go on.
const FORK: usize = 64;

/// Planes merge one by one from so many clusters for each that is wanted.
const ONE_BY_ONE: f64 = 1.25;

/// They merge in rounds to the end where clusters have fewer faces, on average.
const FEWEST: usize = 8;

/// Merges one by one end after so many looks at a face or a neighbour of one, on average: faces may have very many
/// neighbours.
const LOOKS_A_FACE: u64 = 64;

/// Merges faces until there are so many clusters, which must be possible
/// ([`crate::cluster::seeds::shares`]). Also returns the state with [`FORK`] times as many, or all faces, unless all
/// shapes are planes, which prices do not touch; and whether a bound on work ended merges one by one.
pub fn merged(
    faces: Faces<'_>,
    allowed: Allowed<'_>,
    clusters: usize,
    cancel: &Cancel,
) -> Result<(Merged, Option<Merged>, bool)> {
    let mut merging = Merging::new(faces, allowed);
    let is_one_by_one = !allowed.are_curved() && clusters <= faces.count() / FEWEST;
    let factor = if is_one_by_one { ONE_BY_ONE } else { 1.0 };
    let surplus = faces.count().saturating_sub((factor * clusters as f64) as usize);
    let mut fork = None;
    merging.merge_all(&vec![0; faces.count()], vec![surplus], cancel, &mut |merging, left| {
        if allowed.are_curved() && fork.is_none() && left <= (FORK - 1).saturating_mul(clusters) {
            fork = Some(merging.clusters(None));
        }
    })?;
    if !is_one_by_one {
        return Ok((merging.clusters(None), fork, false));
    }
    let merged = merging.one_by_one(faces.count() - surplus, clusters, cancel)?;
    let is_bounded = merged.axes.len() > clusters;
    let merged = if is_bounded { merged_on(faces, allowed, &merged, clusters, cancel)? } else { merged };
    Ok((merged, None, is_bounded))
}

/// Merges the clusters of a state until there are so many.
pub fn merged_on(
    faces: Faces<'_>,
    allowed: Allowed<'_>,
    state: &Merged,
    clusters: usize,
    cancel: &Cancel,
) -> Result<Merged> {
    let mut merging = Merging::new(faces, allowed);
    merging.begin(&state.labels, &state.axes);
    let surplus = state.axes.len().saturating_sub(clusters);
    merging.merge_all(&vec![0; faces.count()], vec![surplus], cancel, &mut |_, _| ())?;
    Ok(merging.clusters(None))
}

impl<'a> Merging<'a> {
    /// Merges one pair after the other, and moves faces after each, until `left` clusters have become so many or a
    /// bound on work is reached.
    fn one_by_one(mut self, mut left: usize, clusters: usize, cancel: &Cancel) -> Result<Merged> {
        let labels: Vec<u32> = (0..self.parts.len() as u32).map(|face| self.root(face)).collect();
        self.into.copy_from_slice(&labels);
        let mut queue = Queue::new(&self, self.edges_inside(&vec![0; labels.len()], &[1]));
        let mut settling = Settling::new(&self, labels)?;
        settling.clusters.limit_looks(LOOKS_A_FACE);
        while left > clusters && !queue.is_exhausted() && !settling.clusters.is_bounded() {
            cancel.check()?;
            let edge = queue.pop(&self).ok_or_else(no_edge)?;
            let union = self.merge(edge.ends());
            let Settled { clusters: changed, .. } = settling.settle(&mut self, &union)?;
            queue.changed(&self, &changed, |cluster| settling.beside(&self, cluster));
            left -= 1;
        }
        Ok(self.clusters(Some(&settling.clusters.labels)))
    }

    /// Makes clusters of faces in place of those so far, without merges; axes are of clusters that are cylinders.
    /// Returns their numbers.
    pub(super) fn begin(&mut self, labels: &[u32], axes: &[Option<DVec3>]) -> Vec<u32> {
        let members = members(labels, axes.len(), |_| true);
        let part = |cluster: usize| {
            let (members, axis) = (&members[cluster], axes[cluster]);
            let (moments, higher) = (Moments::of_all(&self.faces, members), || Higher::of_all(&self.faces, members));
            let of_face = self.parts[members[0] as usize];
            self.best(Part { moments, axis, faces: members.len() as u32, ..of_face }, higher)
        };
        let parts = parallel::map(members.len(), 1, part);
        self.higher.fill(None);
        for (members, part) in members.iter().zip(parts) {
            self.members.set(members[0], members);
            members.iter().for_each(|&face| self.into[face as usize] = members[0]);
            self.set(members[0], part);
        }
        members.iter().map(|members| members[0]).collect()
    }

    /// Gives a face to another cluster; [`refresh`](Self::refresh) finds their shapes.
    pub(super) fn give(&mut self, face: u32, from: u32, to: u32) {
        self.members.give(face, from, to);
        let moments = Moments::of(&self.faces, face);
        for (cluster, moments, sign) in [(from, moments.negated(), -1), (to, moments, 1)] {
            let part = &mut self.parts[cluster as usize];
            part.moments.add(&moments);
            part.faces = part.faces.saturating_add_signed(sign);
        }
        if self.allowed.are_curved() {
            let higher = Higher::of(&self.faces, face);
            for (cluster, higher) in [(from, higher.negated()), (to, higher)] {
                self.higher[cluster as usize].iter_mut().for_each(|sums| sums.add(&higher));
            }
        }
    }

    /// Finds the best shape of a cluster after faces have moved.
    pub(super) fn refresh(&mut self, cluster: u32, axis: Option<DVec3>) {
        let part = Part { axis, ..self.parts[cluster as usize] };
        debug_assert!({
            let members: Vec<u32> = self.members.of(cluster).collect();
            part.moments == Moments::of_all(&self.faces, &members)
                && (!self.allowed.are_curved() || self.higher_of(cluster) == Higher::of_all(&self.faces, &members))
        });
        let best = self.best(part, || self.higher_of(cluster));
        self.set(cluster, best);
    }

    fn set(&mut self, cluster: u32, (part, higher): (Part, Option<Box<Higher>>)) {
        self.parts[cluster as usize] = part;
        if self.allowed.are_curved() {
            self.higher[cluster as usize] = higher;
        }
    }

    /// A cluster with its best shape, and the higher moments that are kept.
    fn best(&self, of: Part, higher: impl FnOnce() -> Higher) -> (Part, Option<Box<Higher>>) {
        let Part { ref moments, axis, faces, component, .. } = of;
        let has_enough = self.allowed.are_curved() && faces >= FEWEST_FACES;
        let higher = has_enough.then(higher);
        let Best { energy, kind, axis, .. } = self.allowed.fits(component, moments, || higher, axis.as_slice()).best();
        (Part { energy, kind, axis, ..of }, higher.filter(|_| faces >= KEPT_FROM).map(Box::new))
    }
}
