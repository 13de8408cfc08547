//! Merges to a number of clusters, and others that go on from a state on the way there.
//!
//! Where the number of faces is many times that of clusters, most of the time goes into the merges before that state.

use super::*;
use crate::shapes::faces::members;

/// Clusters for each that is wanted, in the state from which other merges go on.
const FORK: usize = 64;

/// Merges faces until there are so many clusters, which must be possible
/// ([`crate::cluster::seeds::shares`]). Also returns the state with [`FORK`] times as many, or all faces, unless all
/// shapes are planes, which prices do not touch.
pub fn merged(
    faces: Faces<'_>,
    allowed: Allowed<'_>,
    clusters: usize,
    cancel: &Cancel,
) -> Result<(Merged, Option<Merged>)> {
    let mut merging = Merging::new(faces, allowed);
    let surplus = faces.count().saturating_sub(clusters);
    let mut fork = None;
    merging.merge_all(&vec![0; faces.count()], vec![surplus], cancel, &mut |merging, left| {
        if allowed.are_curved() && fork.is_none() && left <= (FORK - 1).saturating_mul(clusters) {
            fork = Some(merging.clusters(None));
        }
    })?;
    Ok((merging.clusters(None), fork))
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

impl Merging<'_> {
    /// Makes clusters of faces in place of those so far, without merges; axes are of clusters that are cylinders.
    /// Returns their numbers.
    pub(super) fn begin(&mut self, labels: &[u32], axes: &[Option<DVec3>]) -> Vec<u32> {
        let members = members(labels, axes.len(), |_| true);
        let part = |(members, axis): (&Vec<u32>, &Option<DVec3>)| self.part_of(members, *axis);
        let parts: Vec<_> = members.par_iter().zip(axes).map(part).collect();
        self.higher.fill(None);
        for (members, part) in members.iter().zip(parts) {
            self.members.set(members[0], members);
            members.iter().for_each(|&face| self.into[face as usize] = members[0]);
            self.set(members[0], part);
        }
        members.iter().map(|members| members[0]).collect()
    }

    /// Sums a cluster up anew after faces have moved.
    pub(super) fn refresh(&mut self, cluster: u32, axis: Option<DVec3>) {
        let members: Vec<u32> = self.members.of(cluster).collect();
        let part = self.part_of(&members, axis);
        self.set(cluster, part);
    }

    fn set(&mut self, cluster: u32, (part, higher): (Part, Option<Box<Higher>>)) {
        self.parts[cluster as usize] = part;
        if self.allowed.are_curved() {
            self.higher[cluster as usize] = higher;
        }
    }

    fn part_of(&self, members: &[u32], axis: Option<DVec3>) -> (Part, Option<Box<Higher>>) {
        let count = members.len() as u32;
        let moments = Moments::of_all(&self.faces, members);
        let has_enough = self.allowed.are_curved() && count >= FEWEST_FACES;
        let higher = has_enough.then(|| Higher::of_all(&self.faces, members));
        let component = self.parts[members[0] as usize].component;
        let best = self.allowed.fits(component, &moments, || higher, axis.as_slice()).best();
        let Best { energy, kind, axis, .. } = best;
        let part = Part { moments, energy, kind, axis, faces: count, component };
        (part, higher.filter(|_| count >= KEPT_FROM).map(Box::new))
    }
}
