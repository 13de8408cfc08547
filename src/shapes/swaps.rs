//! Moves of whole clusters: two neighbours become one and a third becomes two, wherever that lowers the energy.
//!
//! Where merges from single faces went wrong, no move of a face makes up for it. Fits of moments say what a merge costs
//! and what a split gains. For the splits, the faces of all clusters merge to two parts each, in the time of a start;
//! clusters whose energy is below the cost of the cheapest merge cannot pay, and are left out, as are those of two
//! faces. The split with the largest gain and the cheapest merge make a swap, then the next, each of clusters of its
//! own. A cluster of fewer than three faces merges at the cost of a plane, which is more than it need be beside curved
//! ones.

use glam::DVec3;

use super::best::{Allowed, Best, FEWEST_FACES};
use super::faces::{Faces, members};
use super::merging::{Merged, merged_in_groups};
use super::moments::{Higher, Moments};
use crate::device::Cancel;
use crate::error::Result;
use crate::parallel;

/// A clustering whose clusters may be swapped.
pub(super) struct Swaps<'a> {
    pub faces: Faces<'a>,
    pub allowed: Allowed<'a>,
    /// One a face.
    pub labels: &'a [u32],
    pub component_of_cluster: &'a [u32],
    /// Of clusters that are cylinders.
    pub axes: Vec<Option<DVec3>>,
}

/// What is known of a cluster.
struct Part {
    moments: Moments,
    higher: Option<Box<Higher>>,
    component: u32,
    axis: Option<DVec3>,
    /// In units of the finest component.
    energy: f64,
}

/// What clusters become.
pub(super) struct Swapped {
    pub labels: Vec<u32>,
    pub component_of_cluster: Vec<u32>,
    pub axes: Vec<Option<DVec3>>,
}

/// A split of a cluster.
struct Split {
    gain: f64,
    cluster: u32,
    halves: [u32; 2],
}

impl Swaps<'_> {
    /// The clusters after the swaps that pay; none if no swap does.
    pub fn made(&self, cancel: &Cancel) -> Result<Option<Swapped>> {
        let parts = self.parts();
        let beside = self.pairs();
        let rise = |pair: usize| {
            let [a, b] = beside[pair];
            (self.together(&parts[a as usize], &parts[b as usize]), [a, b])
        };
        let mut merges: Vec<(f64, [u32; 2])> = parallel::map(beside.len(), 1, rise);
        merges.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let Some(&(least, _)) = merges.first() else { return Ok(None) };
        let mut sizes = vec![0usize; parts.len()];
        self.labels.iter().for_each(|&label| sizes[label as usize] += 1);
        let may_pay = |(part, &size): (&Part, &usize)| if part.energy > least { size.saturating_sub(2) } else { 0 };
        let surplus: Vec<usize> = parts.iter().zip(&sizes).map(may_pay).collect();
        let is_split: Vec<bool> = surplus.iter().map(|&surplus| surplus > 0).collect();
        let halves = merged_in_groups(self.faces, self.allowed, self.labels, surplus, cancel)?;
        let splits = self.splits(&parts, &is_split, &halves);
        Ok(self.swapped(&merges, &splits, &halves))
    }

    fn parts(&self) -> Vec<Part> {
        let components = self.component_of_cluster;
        let members = members(self.labels, components.len(), |_| true);
        let part = |cluster: usize| {
            let (members, component, axis) = (&members[cluster], components[cluster], self.axes[cluster]);
            let moments = Moments::of_all(&self.faces, members);
            let has_enough = self.allowed.are_curved() && members.len() as u32 >= FEWEST_FACES;
            let higher = has_enough.then(|| Box::new(Higher::of_all(&self.faces, members)));
            let of_part = || higher.as_deref().copied();
            let Best { energy, axis, .. } = self.allowed.fits(component, &moments, of_part, axis.as_slice()).best();
            Part { moments, higher, component, axis, energy: energy * self.scale(component) }
        };
        parallel::map(members.len(), 1, part)
    }

    /// The pairs of clusters beside each other.
    fn pairs(&self) -> Vec<[u32; 2]> {
        let label = |face: u32| self.labels[face as usize];
        let beside =
            |face: u32| self.faces.graph.neighbours_of(face).iter().map(move |&near| [label(face), label(near)]);
        let mut pairs: Vec<[u32; 2]> = (0..self.labels.len() as u32).flat_map(beside).filter(|[a, b]| a < b).collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// What merging two clusters raises the energy by.
    fn together(&self, a: &Part, b: &Part) -> f64 {
        let moments = a.moments.with(&b.moments);
        let higher = || Some(a.higher.as_deref()?.with(b.higher.as_deref()?));
        let axes: Vec<DVec3> = a.axis.into_iter().chain(b.axis).collect();
        let best = self.allowed.fits(a.component, &moments, higher, &axes).best();
        best.energy * self.scale(a.component) - a.energy - b.energy
    }

    fn scale(&self, component: u32) -> f64 {
        f64::from(1u32 << self.faces.graph.components[component as usize].energy_shift)
    }

    /// The splits of clusters in two, those with the largest gain first.
    fn splits(&self, parts: &[Part], is_split: &[bool], halves: &Merged) -> Vec<Split> {
        let mut first = vec![None; parts.len()];
        let mut is_seen = vec![false; halves.energies.len()];
        let mut splits = Vec::new();
        for (&cluster, &half) in self.labels.iter().zip(&halves.labels) {
            if !is_split[cluster as usize] || std::mem::replace(&mut is_seen[half as usize], true) {
                continue;
            }
            let Some(other) = first[cluster as usize].replace(half) else { continue };
            let part = &parts[cluster as usize];
            let energy: f64 = [other, half].map(|half: u32| halves.energies[half as usize]).iter().sum();
            splits.push(Split {
                gain: part.energy - energy * self.scale(part.component),
                cluster,
                halves: [other, half],
            });
        }
        splits.sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain).then(a.cluster.cmp(&b.cluster)));
        splits
    }

    /// The clustering after the swaps that pay. Energies add up, wherever the clusters are.
    fn swapped(&self, merges: &[(f64, [u32; 2])], splits: &[Split], halves: &Merged) -> Option<Swapped> {
        let (mut axes, mut components) = (self.axes.clone(), self.component_of_cluster.to_vec());
        let mut is_taken = vec![false; components.len()];
        // what each cluster becomes, and what of it leaves
        let mut becomes: Vec<u32> = (0..components.len() as u32).collect();
        let mut leaves = vec![None; components.len()];
        let mut merges = merges.iter();
        for &Split { gain, cluster, halves: [stays, goes] } in splits {
            if std::mem::replace(&mut is_taken[cluster as usize], true) {
                continue;
            }
            let is_free = |&&(_, [a, b]): &&(f64, [u32; 2])| !is_taken[a as usize] && !is_taken[b as usize];
            let Some(&(_, [a, b])) = merges.find(is_free).filter(|&&(rise, _)| rise < gain) else { break };
            (is_taken[a as usize], is_taken[b as usize]) = (true, true);
            becomes[b as usize] = a;
            leaves[cluster as usize] = Some((goes, b));
            components[b as usize] = components[cluster as usize];
            axes[a as usize] = axes[a as usize].or(axes[b as usize]);
            axes[cluster as usize] = halves.axes[stays as usize];
            axes[b as usize] = halves.axes[goes as usize];
        }
        let after = |(&label, &half): (&u32, &u32)| match leaves[label as usize] {
            Some((goes, to)) if goes == half => to,
            _ => becomes[label as usize],
        };
        let has_any = leaves.iter().any(Option::is_some);
        has_any.then(|| Swapped {
            labels: self.labels.iter().zip(&halves.labels).map(after).collect(),
            component_of_cluster: components,
            axes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::generate_part;
    use crate::shapes::kind::Kind;
    use crate::shapes::prices::Prices;
    use crate::surface::Surface;

    #[test]
    fn two_patches_in_one_cluster_and_one_in_two_change_places() {
        let (mesh, truth) = generate_part(1500, 0.0).expect("a part");
        let surface = Surface::build(&mesh).expect("a surface").with_normals((&mesh).into());
        let samples = surface.samples(&surface.corners((&mesh).into()));
        let faces = Faces { graph: &surface.graph, samples: &samples };
        let prices = Prices::of(faces.graph, 13, surface.on_lattice(|_| 3e-4));
        let allowed = Allowed { kinds: &Kind::ALL, prices: &prices, tolerance: None };
        let truth: Vec<u32> = surface.upload_face.iter().map(|&face| truth[face as usize]).collect();
        let made = |labels: &[u32]| {
            let component_of_cluster = &[0; 13];
            let swaps = Swaps { faces, allowed, labels, component_of_cluster, axes: vec![None; 13] };
            swaps.made(&Cancel::default()).expect("not cancelled").map(|swapped| swapped.labels)
        };
        assert_eq!(made(&truth), None);
        // the first side and the top are one; a face inside the bowl and those beside it are the other
        let mut wrong: Vec<u32> = truth.iter().map(|&patch| if patch == 0 { 8 } else { patch }).collect();
        let beside = |face: u32| surface.neighbours_of(face);
        let is_inside = |&face: &u32| beside(face).iter().all(|&near| truth[near as usize] == 9);
        let face = (0..faces.count() as u32).filter(|&face| truth[face as usize] == 9).find(is_inside).expect("a bowl");
        beside(face).iter().chain([&face]).for_each(|&face| wrong[face as usize] = 0);
        let right = made(&wrong).expect("a swap");
        let pairs: std::collections::BTreeSet<_> = right.into_iter().zip(truth).collect();
        assert_eq!(pairs.len(), 13, "{pairs:?}");
    }
}
