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
            fork = Some(merging.clusters());
        }
    })?;
    Ok((merging.clusters(), fork))
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
    Ok(merging.clusters())
}

impl Merging<'_> {
    /// Makes clusters of single faces, without merges; axes are of clusters that are cylinders. Returns their numbers.
    pub(super) fn begin(&mut self, labels: &[u32], axes: &[Option<DVec3>]) -> Vec<u32> {
        let members = members(labels, axes.len(), |_| true);
        let part = |(members, axis): (&Vec<u32>, &Option<DVec3>)| {
            let count = members.len() as u32;
            let moments = Moments::of_all(&self.faces, members);
            let higher = self
                .allowed
                .are_curved()
                .then(|| Higher::of_all(&self.faces, members))
                .filter(|_| count >= FEWEST_FACES);
            let component = self.parts[members[0] as usize].component;
            let Best { energy, axis, .. } = self.allowed.fits(component, &moments, || higher, axis.as_slice()).best();
            (
                Part { moments, energy, axis, faces: count, component },
                higher.filter(|_| count >= KEPT_FROM).map(Box::new),
            )
        };
        let parts: Vec<_> = members.par_iter().zip(axes).map(part).collect();
        for (members, (part, higher)) in members.iter().zip(parts) {
            let number = members[0] as usize;
            self.parts[number] = part;
            if self.allowed.are_curved() {
                self.higher[number] = higher;
            }
            for (at, &face) in members.iter().enumerate() {
                self.next_face[face as usize] = members[(at + 1) % members.len()];
                self.into[face as usize] = members[0];
            }
        }
        members.iter().map(|members| members[0]).collect()
    }
}
