//! Clusterings by shapes, from the merges to the end.
//!
//! Boundary phases and fits alternate until neither changes anything. A fit is taken only if the energy of the cluster,
//! summed up over its faces in integers, is strictly below that of the shape so far. So F, an integer that is not
//! negative, falls with every pass and every round of fits, and the run ends. There is no refinement, and no repair:
//! clusters are connected all along.
//!
//! Other starts do the same, which merged by the prices of other resolutions ([`OTHER_STARTS`]). The one with the
//! lowest F goes on. Then whole clusters move ([`super::swaps`]), and faces after them; that is kept if F is lower, at
//! most [`SWAPS`] times.
//!
//! With a tolerance in place of a number of clusters, all of this keeps corners within it. In place of swaps, clusters
//! dissolve ([`super::dissolve`]) and merge on ([`super::merging`]), and faces move after them, at most [`MERGES`]
//! times. By induction from single faces, no corner is further from its shape than the tolerance, but those of single
//! polygons that bend by more.

use glam::DVec3;

use super::best::Allowed;
use super::central::Central;
use super::dissolve::{Dissolved, dissolved};
use super::faces::{Faces, members};
use super::fitted::{Cluster, Fitted, Sums, cost, fitted};
use super::kind::Kind;
use super::merging::{Begun, Merged, MergedWithin, merged, merged_on, merged_within};
use super::moves::{Clusters, Gpu};
use super::prices::Prices;
use super::proxy::Proxy;
use super::shape::Shape;
use super::swaps::{Swapped, Swaps};
use super::tolerance::Tolerance;
use crate::cluster::numbers;
use crate::cluster::run::Phase;
use crate::device::{Cancel, Ending};
use crate::error::{Error, Result};
use crate::parallel;

/// Rounds of fits at most. Scans take 5 to 60.
const ROUNDS: usize = 1024;

/// Resolutions, times the given one, by whose prices other starts merge.
const OTHER_STARTS: [f64; 2] = [2.0, 0.5];

/// Rounds of swaps at most.
const SWAPS: usize = 4;

/// How often clusters within a tolerance merge on at most.
const MERGES: usize = 4;

/// How many clusters there are.
#[derive(Debug, Clone, Copy)]
pub enum Wanted<'a> {
    /// So many.
    Clusters(usize),
    /// Few, within a tolerance.
    Within(Tolerance<'a>),
}

/// What to make.
#[derive(Debug, Clone)]
pub struct Options<'a> {
    /// How many clusters.
    pub wanted: Wanted<'a>,
    /// Types, in the order of [`Kind::ALL`], planes among them.
    pub kinds: Vec<Kind>,
    /// Distances below it are noise, in lattice units.
    pub resolution: f64,
    /// Steps after which to stop, converged or not.
    pub most_steps: Option<u32>,
}

/// A step of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// What kind of step it was.
    pub phase: Phase,
    /// F after it, in units of the finest component.
    pub energy: i128,
    /// Faces that moved; of merges, clusters that are gone.
    pub moves: u64,
}

/// What a run ends with.
#[derive(Debug)]
pub struct Clustering {
    /// After the merges; one a face.
    pub initial: Vec<u32>,
    /// In the end.
    pub labels: Vec<u32>,
    /// The shape of each cluster, in units of moments.
    pub shapes: Vec<Shape>,
    /// F before and after, without prices.
    pub energies: [i128; 2],
    /// Why it ended.
    pub ending: Ending,
}

/// Clusters faces. Calls `on_step` with the start and with every step, and the labels after it.
pub fn cluster(
    faces: Faces<'_>,
    options: &Options<'_>,
    gpu: &mut Gpu,
    cancel: &Cancel,
    on_step: &mut dyn FnMut(Step, &[u32]),
) -> Result<Clustering> {
    let Options { wanted, kinds, resolution, most_steps } = options;
    let most_steps = most_steps.unwrap_or(u32::MAX);
    match *wanted {
        Wanted::Clusters(clusters) => {
            let prices = Prices::of(faces.graph, clusters, *resolution);
            let allowed = Allowed { kinds, prices: &prices, tolerance: None };
            let (merged, fork, is_bounded) = merged(faces, allowed, clusters, cancel)?;
            let start =
                |merged: Merged| Run::of(faces, allowed, merged.labels, merged.component_of_cluster, &merged.axes);
            let other = |(&factor, state): (&f64, &Merged)| {
                let prices = Prices::of(faces.graph, clusters, factor * resolution);
                merged_on(faces, Allowed { prices: &prices, ..allowed }, state, clusters, cancel).and_then(start)
            };
            let state = fork.filter(|_| *resolution > 0.0);
            let others = OTHER_STARTS.iter().filter_map(|factor| Some(other((factor, state.as_ref()?))));
            Run { is_bounded, ..start(merged)? }.with_swaps(others, most_steps, gpu, cancel, on_step)
        }
        Wanted::Within(tolerance) => {
            let prices = Prices::of_tolerance(faces.graph, *resolution);
            let allowed = Allowed { kinds, prices: &prices, tolerance: Some(tolerance) };
            let merged = merged_within(faces, allowed, tolerance, None, cancel)?;
            Run::of_shapes(faces, allowed, merged)?.with_merges(tolerance, most_steps, cancel, on_step)
        }
    }
}

/// Clusters on the way.
pub(super) struct Run<'a> {
    allowed: Allowed<'a>,
    component_of_cluster: Vec<u32>,
    clusters: Clusters<'a>,
    /// Of the clusters at their last fits.
    sums: Vec<Sums>,
    /// Whether a bound on work ended merges.
    is_bounded: bool,
}

impl<'a> Run<'a> {
    /// Of clusters to which shapes are fitted.
    pub(super) fn of(
        faces: Faces<'a>,
        allowed: Allowed<'a>,
        labels: Vec<u32>,
        component_of_cluster: Vec<u32>,
        axes: &[Option<DVec3>],
    ) -> Result<Self> {
        let members = members(&labels, axes.len(), |_| true);
        let fit = |cluster: usize| {
            let (members, axis, component) = (&members[cluster], axes[cluster], component_of_cluster[cluster]);
            let sums = Sums::of(&faces, members);
            let cluster = Cluster { component, members, moments: &sums.moments, axis };
            let fit = fitted(faces, allowed, &cluster, || sums.higher(&faces, members), None)?;
            Some((fit, sums))
        };
        let fits = parallel::map(members.len(), 1, fit).into_iter().collect();
        Self::new(faces, allowed, labels, component_of_cluster, fits, false)
    }

    /// Of clusters with shapes.
    fn of_shapes(faces: Faces<'a>, allowed: Allowed<'a>, merged: MergedWithin) -> Result<Self> {
        let MergedWithin { merged: Merged { labels, component_of_cluster, .. }, shapes, is_bounded } = merged;
        let members = members(&labels, shapes.len(), |_| true);
        let fit = |cluster: usize| {
            let (members, shape) = (&members[cluster], shapes[cluster]);
            let sums = Sums::of(&faces, members);
            let proxy = Proxy::new(&shape, Central::of(&sums.moments).mean)?;
            Some((Fitted { shape, proxy, cost: cost(faces, members, &proxy) }, sums))
        };
        let fits = parallel::map(members.len(), 1, fit).into_iter().collect();
        Self::new(faces, allowed, labels, component_of_cluster, fits, is_bounded)
    }

    fn new(
        faces: Faces<'a>,
        allowed: Allowed<'a>,
        labels: Vec<u32>,
        component_of_cluster: Vec<u32>,
        fits: Option<Vec<(Fitted, Sums)>>,
        is_bounded: bool,
    ) -> Result<Self> {
        let fits = fits.ok_or_else(|| Error::internal("a cluster has no shape"))?;
        let (fits, sums): (Vec<_>, Vec<_>) = fits.into_iter().unzip();
        let clusters = Clusters::new(faces, allowed.tolerance, labels, &fits);
        Ok(Self { allowed, component_of_cluster, clusters, sums, is_bounded })
    }

    /// Converges, as do other starts; then the best of them swaps clusters as long as that pays.
    pub(super) fn with_swaps(
        mut self,
        mut others: impl Iterator<Item = Result<Self>>,
        mut most_steps: u32,
        gpu: &mut Gpu,
        cancel: &Cancel,
        on_step: &mut dyn FnMut(Step, &[u32]),
    ) -> Result<Clustering> {
        let (initial, before) = self.tell_start(on_step);
        let mut ending = self.converge(&mut most_steps, gpu, cancel, on_step)?;
        while ending == Ending::Converged
            && let Some(other) = others.next()
        {
            let mut other = other?;
            let after = other.converge(&mut u32::MAX.clone(), gpu, cancel, &mut |_, _| ())?;
            if other.energy() < self.energy() {
                ending = after;
                self.replace(other, Phase::MergedStart, on_step);
            }
        }
        for _ in 0..SWAPS {
            if ending != Ending::Converged {
                break;
            }
            let Some(mut other) = self.swapped(cancel)? else { break };
            let after = other.converge(&mut u32::MAX.clone(), gpu, cancel, &mut |_, _| ())?;
            if other.energy() >= self.energy() {
                break;
            }
            ending = after;
            self.replace(other, Phase::Swap, on_step);
        }
        Ok(self.ended(initial, before, ending))
    }

    /// Becomes another run of as many clusters, whose energy is lower. Where no face moves, shapes are better alone.
    fn replace(&mut self, other: Self, phase: Phase, on_step: &mut dyn FnMut(Step, &[u32])) {
        let before = &self.clusters.labels;
        let after = numbers::kept(before, &other.clusters.labels);
        let moves = before.iter().zip(&after).filter(|(a, b)| a != b).count() as u64;
        let phase = if moves == 0 { Phase::Refit } else { phase };
        *self = Self { is_bounded: self.is_bounded || other.is_bounded, ..other };
        on_step(Step { phase, energy: self.energy(), moves }, &self.clusters.labels);
    }

    /// Converges, and merges on as long as the tolerance allows that.
    fn with_merges(
        mut self,
        tolerance: Tolerance<'_>,
        most_steps: u32,
        cancel: &Cancel,
        on_step: &mut dyn FnMut(Step, &[u32]),
    ) -> Result<Clustering> {
        let (initial, before) = self.tell_start(on_step);
        let mut left = most_steps;
        let mut ending = self.converge(&mut left, &mut Gpu::default(), cancel, on_step)?;
        for _ in 0..MERGES {
            if ending != Ending::Converged {
                break;
            }
            let Dissolved { labels, stay, is_bounded } = dissolved(&self.clusters, cancel)?;
            self.is_bounded |= is_bounded;
            let Clusters { faces, shapes, .. } = &self.clusters;
            let stay: Vec<Shape> = stay.iter().map(|&cluster| shapes[cluster as usize]).collect();
            let begun = Begun { labels: &labels, shapes: &stay };
            let merged = merged_within(*faces, self.allowed, tolerance, Some(begun), cancel)?;
            let moves = (shapes.len() - merged.shapes.len()) as u64;
            let is_bounded = self.is_bounded | merged.is_bounded;
            if moves == 0 {
                self.is_bounded = is_bounded;
                break;
            }
            self = Self { is_bounded, ..Self::of_shapes(*faces, self.allowed, merged)? };
            on_step(Step { phase: Phase::Merge, energy: self.energy(), moves }, &self.clusters.labels);
            ending = self.converge(&mut left, &mut Gpu::default(), cancel, on_step)?;
        }
        Ok(self.ended(initial, before, ending))
    }

    /// Tells the start. Returns its labels, and F without prices.
    fn tell_start(&self, on_step: &mut dyn FnMut(Step, &[u32])) -> (Vec<u32>, i128) {
        on_step(Step { phase: Phase::Boundary, energy: self.energy(), moves: 0 }, &self.clusters.labels);
        (self.clusters.labels.clone(), self.costs())
    }

    /// The clustering without any step.
    pub(super) fn ended_at_once(self) -> Clustering {
        let (initial, before) = (self.clusters.labels.clone(), self.costs());
        self.ended(initial, before, Ending::Converged)
    }

    fn ended(self, initial: Vec<u32>, before: i128, ending: Ending) -> Clustering {
        let energies = [before, self.costs()];
        let ending = if self.is_bounded && ending == Ending::Converged { Ending::WorkLimit } else { ending };
        Clustering { initial, labels: self.clusters.labels, shapes: self.clusters.shapes, energies, ending }
    }

    /// F, in units of the finest component.
    fn energy(&self) -> i128 {
        let price = |(shape, &component): (&Shape, &u32)| {
            self.allowed.prices[component as usize].exact(shape.kind()) << self.shift(component)
        };
        self.costs() + self.clusters.shapes.iter().zip(&self.component_of_cluster).map(price).sum::<i128>()
    }

    /// F without prices.
    fn costs(&self) -> i128 {
        let costs = self.clusters.costs.iter().zip(&self.component_of_cluster);
        costs.map(|(cost, &component)| cost << self.shift(component)).sum()
    }

    fn shift(&self, component: u32) -> u32 {
        self.clusters.faces.graph.components[component as usize].energy_shift
    }

    /// Moves faces and fits shapes until nothing changes, in so many steps that are `left` at most.
    fn converge(
        &mut self,
        left: &mut u32,
        gpu: &mut Gpu,
        cancel: &Cancel,
        on_step: &mut dyn FnMut(Step, &[u32]),
    ) -> Result<Ending> {
        let all = vec![true; self.clusters.shapes.len()];
        let mut has_new_shape = all.clone();
        for _ in 0..ROUNDS {
            let mut faces = self.clusters.at_boundaries(&has_new_shape);
            let mut has_moved = false;
            while !faces.is_empty() && *left > 0 {
                cancel.check()?;
                let proposals = self.clusters.proposals(&faces, gpu)?;
                let (moves, next) = self.clusters.pass(&faces, &proposals)?;
                if moves > 0 {
                    (*left, has_moved) = (*left - 1, true);
                    on_step(Step { phase: Phase::Boundary, energy: self.energy(), moves }, &self.clusters.labels);
                }
                faces = next;
            }
            if *left == 0 {
                return Ok(Ending::IterationLimit);
            }
            cancel.check()?;
            let takes_shape = self.fit();
            if takes_shape.contains(&true) {
                *left -= 1;
                on_step(Step { phase: Phase::Refit, energy: self.energy(), moves: 0 }, &self.clusters.labels);
                has_new_shape = takes_shape;
            } else if has_moved || has_new_shape != all {
                // a face may have waited for a way around it that is far away: all of them are looked at in the end
                has_new_shape.clone_from(&all);
            } else {
                return Ok(if self.clusters.is_bounded() { Ending::WorkLimit } else { Ending::Converged });
            }
        }
        Ok(Ending::WorkLimit)
    }

    /// The same with clusters that merged and others that were split; none if no such swap pays.
    fn swapped(&self, cancel: &Cancel) -> Result<Option<Self>> {
        let Self { allowed, component_of_cluster, clusters, .. } = self;
        let axes: Vec<Option<DVec3>> = clusters.shapes.iter().map(Shape::axis).collect();
        let swaps =
            Swaps { faces: clusters.faces, allowed: *allowed, labels: &clusters.labels, component_of_cluster, axes };
        let run = |Swapped { labels, component_of_cluster, axes }| {
            Run::of(clusters.faces, *allowed, labels, component_of_cluster, &axes)
        };
        swaps.made(cancel)?.map(run).transpose()
    }

    /// Fits shapes to the clusters that changed. Returns which took one.
    fn fit(&mut self) -> Vec<bool> {
        let Self { allowed, component_of_cluster, clusters, sums, .. } = self;
        let Clusters { faces, labels, shapes, proxies, costs, has_changed, log, .. } = clusters;
        for (face, from, to) in std::mem::take(log) {
            sums[from as usize].count(faces, face, false);
            sums[to as usize].count(faces, face, true);
        }
        let members = members(labels, shapes.len(), |label| has_changed[label as usize]);
        let fit = |number: usize| {
            let members = &members[number];
            let so_far = Some((shapes[number].kind(), costs[number]));
            let (component, axis, sums) = (component_of_cluster[number], shapes[number].axis(), &sums[number]);
            let cluster = Cluster { component, members, moments: &sums.moments, axis };
            let higher = || sums.higher(faces, members);
            if members.is_empty() { None } else { fitted(*faces, *allowed, &cluster, higher, so_far) }
        };
        let fits: Vec<Option<Fitted>> = parallel::map(members.len(), 1, fit);
        has_changed.fill(false);
        let is_new = fits.iter().map(Option::is_some).collect();
        for (number, fit) in fits.into_iter().enumerate() {
            if let Some(Fitted { shape, proxy, cost }) = fit {
                (shapes[number], proxies[number], costs[number]) = (shape, proxy, cost);
            }
        }
        is_new
    }
}

#[cfg(test)]
mod tests;
