//! Clusters that are merged from single faces, over all components at once.
//!
//! A merge costs what it raises the energy by, by the fits of the moments, and a little of what the distance of the
//! means would cost clusters by places: costs on CAD models are 0 over whole regions, and without that, regions grow as
//! stars. Of the pairs that are each other's cheapest, an eighth of the merges that are left happen in a round, the
//! cheapest, so that none merges across an edge while cheaper merges wait.
//!
//! # Work
//!
//! A round prices the edges of the clusters that merged: at most all that are left. Meshes take a round for every 12 %
//! of the clusters, so that all rounds together look at every edge some 10 times. Where few pairs choose each other,
//! there are more rounds. After [`LOOKS_AN_EDGE`] times as many looks as the mesh has edges, a cluster merges with its
//! cheapest neighbour whether or not that chose it, which leaves at most half of the clusters of each component after a
//! round.
//! (The edges that are the cheapest at one end form no circle, since no two have the same rank.)

mod multilevel;
mod one_by_one;
mod starts;
pub mod tree;
mod within;

use glam::DVec3;
use rayon::prelude::*;

pub use self::starts::{merged, merged_on};
pub use self::within::{Begun, MergedWithin, merged_within};
use super::best::{Allowed, Best, Candidates, FEWEST_FACES};
use super::circles::Circles;
use super::faces::Faces;
use super::kind::Kind;
use super::moments::{Higher, Moments};
use crate::cluster::merging::an_eighth;
use crate::device::Cancel;
use crate::device::dual_edge::{Rank, Ties, from_into, keep_first};
use crate::error::{Error, Result};
use crate::parallel;
use crate::union_find;

/// How much the distance of the means counts beside the energy.
const NEARNESS: f64 = 1e-8;

/// Looks at an edge, on average, in rounds in which clusters merge only if both chose each other.
const LOOKS_AN_EDGE: usize = 64;

/// Clusters of fewer faces keep no higher moments: they are sums over the faces.
const KEPT_FROM: u32 = 4;

/// No edge.
const NONE: u32 = u32::MAX;

/// Clusters that were merged.
#[derive(Debug)]
pub struct Merged {
    /// One a face, without gaps.
    pub labels: Vec<u32>,
    /// The component of each cluster.
    pub component_of_cluster: Vec<u32>,
    /// The axes of those that are cylinders.
    pub axes: Vec<Option<DVec3>>,
    /// The energies of their best shapes: weight × squared units of moments.
    pub energies: Vec<f64>,
    /// What numbers they had while they merged: of a face of each.
    numbers: Vec<u32>,
}

/// Merges faces of one group, so many times in each of the groups. Faces of a group must be connected.
pub fn merged_in_groups(
    faces: Faces<'_>,
    allowed: Allowed<'_>,
    group_of_face: &[u32],
    surplus: Vec<usize>,
    cancel: &Cancel,
) -> Result<Merged> {
    let mut merging = Merging::new(faces, allowed);
    merging.merge_all(group_of_face, surplus, cancel, &mut |_, _| ())?;
    Ok(merging.clusters(None))
}

/// A dual edge by its price.
type Edge = Rank<i64>;

/// A cluster.
#[derive(Debug, Clone, Copy)]
struct Part {
    moments: Moments,
    /// The energy of its best shape: weight × squared units of moments.
    energy: f64,
    /// The type of that.
    kind: Kind,
    /// Its axis, if it has one.
    axis: Option<DVec3>,
    faces: u32,
    component: u32,
}

/// Two clusters that became one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Union {
    /// The one that ended.
    pub from: u32,
    /// The one that goes on.
    pub into: u32,
    /// What that raised the energy by, prices aside, in units of moments and of the finest component.
    pub rise: f64,
}

/// Clusters that merge.
pub(super) struct Merging<'a> {
    faces: Faces<'a>,
    allowed: Allowed<'a>,
    /// One a number of a cluster, which is that of a face at first.
    parts: Vec<Part>,
    /// Higher moments of clusters of [`KEPT_FROM`] faces; empty for planes.
    higher: Vec<Option<Box<Higher>>>,
    members: Circles,
    /// The cluster that each one became part of; its own number while it is left.
    into: Vec<u32>,
    /// Whether a cluster merged in this round.
    has_merged: Vec<bool>,
    /// The cheapest edge of each cluster that has edges.
    cheapest: Vec<u32>,
}

impl<'a> Merging<'a> {
    fn new(faces: Faces<'a>, allowed: Allowed<'a>) -> Self {
        let count = faces.count();
        let component_of_face = faces.graph.component_of_face();
        let numbers: Vec<u32> = (0..count as u32).collect();
        let part = |face: usize| {
            let (face, component) = (face as u32, component_of_face[face]);
            let moments = Moments::of(&faces, face);
            // three samples lie in a plane
            let energy = match faces.samples(face) {
                [_, _, _] => 0.0,
                _ => allowed.fits(component, &moments, || None, &[]).best().energy,
            };
            Part { moments, energy, kind: Kind::Plane, axis: None, faces: 1, component }
        };
        Self {
            faces,
            allowed,
            parts: parallel::map(count, 1, part),
            higher: if allowed.are_curved() { vec![None; count] } else { Vec::new() },
            members: Circles::new(count),
            into: numbers,
            has_merged: vec![false; count],
            cheapest: vec![NONE; count],
        }
    }

    /// Merges so many times in each group. Calls `on_round` before each round with the merges that are left.
    fn merge_all(
        &mut self,
        group_of_face: &[u32],
        mut surplus: Vec<usize>,
        cancel: &Cancel,
        on_round: &mut dyn FnMut(&mut Self, usize),
    ) -> Result<()> {
        let mut edges = self.edges_inside(group_of_face, &surplus);
        let mut left: usize = surplus.iter().sum();
        let mut looks_left = LOOKS_AN_EDGE * edges.len();
        while left > 0 {
            cancel.check()?;
            on_round(self, left);
            looks_left = looks_left.saturating_sub(edges.len());
            for edge in self.choose_some(&edges, left, looks_left == 0)? {
                let of_group = &mut surplus[group_of_face[edge.ends().0 as usize] as usize];
                if *of_group > 0 {
                    self.merge(edge.ends());
                    *of_group -= 1;
                    left -= 1;
                }
            }
            edges.retain(|edge| surplus[group_of_face[edge.ends().0 as usize] as usize] > 0);
            self.contract(&mut edges, &mut Vec::new());
        }
        Ok(())
    }

    /// As [`choose`](Self::choose); an error if there are none.
    fn choose_some(&mut self, edges: &[Edge], surplus: usize, one_end_suffices: bool) -> Result<Vec<Edge>> {
        let chosen = self.choose(edges, surplus, one_end_suffices);
        match chosen.is_empty() {
            true => Err(Error::internal("no two clusters chose each other")),
            false => Ok(chosen),
        }
    }

    /// The edges inside groups in which there are merges, between clusters that are parts of no others.
    fn edges_inside(&self, group_of_face: &[u32], surplus: &[usize]) -> Vec<Edge> {
        let beside = |face: u32| self.faces.graph.neighbours_of(face).iter().map(move |&near| (face, near));
        let is_inside = |&(a, b): &(u32, u32)| {
            let [of_a, of_b] = [a, b].map(|face| group_of_face[face as usize]);
            a < b && of_a == of_b && surplus[of_a as usize] > 0
        };
        let of_clusters = |(a, b): (u32, u32)| {
            let [a, b] = [a, b].map(|face| self.into[face as usize]);
            (a != b).then_some((a.min(b), a.max(b)))
        };
        let pairs = (0..self.parts.len() as u32).flat_map(beside).filter(is_inside).filter_map(of_clusters);
        let mut pairs: Vec<(u32, u32)> = pairs.collect();
        pairs.sort_unstable();
        pairs.dedup();
        parallel::map(pairs.len(), 1, |pair| self.edge(pairs[pair]))
    }

    /// A dual edge, given with the smaller number first.
    fn edge(&self, (low, high): (u32, u32)) -> Edge {
        Rank::new(in_order(self.price(low, high)), low, high, Ties::Hash)
    }

    /// What a merge costs, in units of the finest component; infinitely much beyond the tolerance.
    fn price(&self, low: u32, high: u32) -> f64 {
        let [a, b] = [low, high].map(|number| &self.parts[number as usize]);
        let best = self.union(low, high).1.best();
        if !best.is_within {
            return f64::INFINITY;
        }
        let rise = best.energy - a.energy - b.energy;
        let [weight_a, weight_b] = [a, b].map(|part| part.moments.weight as f64);
        let mean = |part: &Part| DVec3::from(part.moments.first.map(|sum| sum as f64 / part.moments.weight as f64));
        let apart = (mean(a) - mean(b)).length_squared();
        let nearness = NEARNESS * weight_a * weight_b / (weight_a + weight_b) * apart;
        (rise + nearness) * self.scale(a.component)
    }

    /// The moments of two clusters together, and their fits.
    fn union(&self, low: u32, high: u32) -> (Moments, Candidates) {
        let [a, b] = [low, high].map(|number| &self.parts[number as usize]);
        let moments = a.moments.with(&b.moments);
        let axes = [a.axis.or(b.axis), b.axis].map(|axis| axis.unwrap_or(DVec3::ZERO));
        let known = [a, b].iter().filter(|part| part.axis.is_some()).count();
        let has_enough = a.faces + b.faces >= FEWEST_FACES;
        let higher = || has_enough.then(|| self.higher_of(low).with(&self.higher_of(high)));
        (moments, self.allowed.fits(a.component, &moments, higher, &axes[..known]))
    }

    fn higher_of(&self, cluster: u32) -> Higher {
        if let Some(higher) = &self.higher[cluster as usize] {
            return **higher;
        }
        let mut higher = Higher::default();
        self.members.of(cluster).for_each(|face| higher.add(&Higher::of(&self.faces, face)));
        higher
    }

    /// The edges whose clusters merge in a round, the cheapest first.
    fn choose(&mut self, edges: &[Edge], surplus: usize, one_end_suffices: bool) -> Vec<Edge> {
        let cheapest = &mut self.cheapest;
        let ends = |edge: &Edge| [edge.ends().0, edge.ends().1].map(|end| end as usize);
        edges.iter().flat_map(ends).for_each(|end| cheapest[end] = NONE);
        for (number, edge) in (0..).zip(edges) {
            for end in ends(edge) {
                if edges.get(cheapest[end] as usize).is_none_or(|best| edge < best) {
                    cheapest[end] = number;
                }
            }
        }
        let is_chosen = |&(number, edge): &(u32, &Edge)| {
            let [low, high] = ends(edge).map(|end| cheapest[end] == number);
            low && high || one_end_suffices && (low || high)
        };
        let mut chosen: Vec<Edge> = (0..).zip(edges).filter(is_chosen).map(|(_, &edge)| edge).collect();
        keep_first(&mut chosen, if one_end_suffices { surplus } else { an_eighth(surplus) });
        chosen
    }

    /// Merges the clusters that two have become.
    fn merge(&mut self, (low, high): (u32, u32)) -> Union {
        let [a, b] = [low, high].map(|cluster| self.root(cluster));
        let (low, high) = (a.min(b), a.max(b));
        let (moments, candidates) = self.union(low, high);
        self.unite((low, high), moments, candidates.best())
    }

    /// Makes one of two clusters, given its moments and best shape.
    fn unite(&mut self, (low, high): (u32, u32), moments: Moments, best: Best) -> Union {
        let before = self.cost(low) + self.cost(high);
        let faces = [low, high].map(|cluster| self.parts[cluster as usize].faces);
        let all = faces[0] + faces[1];
        let (from, into) = from_into((low, high), faces);
        if self.allowed.are_curved() && all >= KEPT_FROM {
            let higher = self.higher_of(low).with(&self.higher_of(high));
            self.higher[from as usize] = None;
            self.higher[into as usize] = Some(Box::new(higher));
        }
        let part = &mut self.parts[into as usize];
        let Best { energy, kind, axis, .. } = best;
        *part = Part { moments, energy, kind, axis, faces: all, component: part.component };
        self.members.unite(low, high);
        self.into[from as usize] = into;
        self.has_merged[from as usize] = true;
        self.has_merged[into as usize] = true;
        Union { from, into, rise: self.cost(into) - before }
    }

    /// The energy of a cluster without its price, in units of moments and of the finest component.
    fn cost(&self, cluster: u32) -> f64 {
        let part = &self.parts[cluster as usize];
        let price = self.allowed.prices[part.component as usize].of_kind(part.kind);
        (part.energy - price) * self.scale(part.component)
    }

    fn scale(&self, component: u32) -> f64 {
        f64::from(1u32 << self.faces.graph.components[component as usize].energy_shift)
    }

    /// The cluster that one has become.
    fn root(&mut self, cluster: u32) -> u32 {
        union_find::root(&mut self.into, cluster)
    }

    /// Prices the edges of clusters that merged anew, those that wait among them.
    fn contract(&mut self, edges: &mut Vec<Edge>, waiting: &mut Vec<(u32, u32)>) {
        let mut changed = Vec::new();
        let mut stays = |(low, high): (u32, u32)| {
            let has_changed = self.has_merged[low as usize] || self.has_merged[high as usize];
            if has_changed {
                changed.push((low, high));
            }
            !has_changed
        };
        edges.retain(|edge| stays(edge.ends()));
        waiting.retain(|&ends| stays(ends));
        for (low, high) in &mut changed {
            for end in [*low, *high] {
                self.has_merged[end as usize] = false;
            }
            let ends = [*low, *high].map(|end| self.root(end));
            (*low, *high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        }
        changed.retain(|(low, high)| low != high);
        changed.par_sort_unstable();
        changed.dedup();
        edges.extend(parallel::map(changed.len(), 1, |pair| self.edge(changed[pair])));
    }

    /// The clusters so far; with labels, numbers that clusters of faces have or had, if faces have moved.
    fn clusters(&mut self, labels: Option<&[u32]>) -> Merged {
        let mut number_of = vec![NONE; self.parts.len()];
        let (mut component_of_cluster, mut axes, mut energies) = (Vec::new(), Vec::new(), Vec::new());
        let mut numbers = Vec::new();
        let labels = (0..self.parts.len() as u32).map(|face| {
            let cluster = self.root(labels.map_or(face, |labels| labels[face as usize])) as usize;
            if number_of[cluster] == NONE {
                number_of[cluster] = axes.len() as u32;
                component_of_cluster.push(self.parts[cluster].component);
                axes.push(self.parts[cluster].axis);
                energies.push(self.parts[cluster].energy);
                numbers.push(cluster as u32);
            }
            number_of[cluster]
        });
        Merged { labels: labels.collect(), component_of_cluster, axes, energies, numbers }
    }
}

/// Integers in the order of numbers.
fn in_order(price: f64) -> i64 {
    let bits = price.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}
