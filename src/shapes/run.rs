//! Clusterings by shapes, from the merges to the end.
//!
//! Boundary phases and fits alternate until neither changes anything. A fit is taken only if the energy of the cluster,
//! summed up over its faces in integers, is strictly below that of the shape so far. So F, an integer that is not
//! negative, falls with every pass and every round of fits, and the run ends. There is no refinement, and no repair:
//! clusters are connected all along.
//!
//! Then whole clusters move ([`super::swaps`]), and faces after them; that is kept if F is lower, at most [`SWAPS`]
//! times.

use glam::DVec3;
use rayon::prelude::*;

use super::best::{Allowed, FEWEST_FACES};
use super::faces::{Faces, members};
use super::kind::Kind;
use super::merging::merged;
use super::moments::{Higher, Moments, SHIFT};
use super::moves::Clusters;
use super::prices::Prices;
use super::proxy::Proxy;
use super::shape::Shape;
use super::swaps::{Swapped, Swaps};
use crate::cluster::run::Phase;
use crate::device::{Cancel, Ending};
use crate::error::{self, Error, Result};

/// Rounds of fits at most. Scans take 5 to 60.
const ROUNDS: usize = 1024;

/// Rounds of swaps at most.
const SWAPS: usize = 4;

/// Fits whose energy, by moments, is this many times that of the shape so far are not worth a sum over the faces.
const MARGIN: f64 = 1.01;

/// What to make.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Number of clusters.
    pub clusters: usize,
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
    /// Faces that moved.
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
    options: &Options,
    cancel: &Cancel,
    on_step: &mut dyn FnMut(Step, &[u32]),
) -> Result<Clustering> {
    let prices = Prices::of(faces.graph, options.clusters, options.resolution);
    let allowed = Allowed { kinds: &options.kinds, prices: &prices };
    let merged = merged(faces, allowed, options.clusters, cancel)?;
    let mut run = Run::new(faces, allowed, merged.labels, merged.component_of_cluster, &merged.axes)?;
    let initial = run.clusters.labels.clone();
    let before = run.costs();
    on_step(Step { phase: Phase::Boundary, energy: run.energy(), moves: 0 }, &initial);
    let mut ending = run.converge(options.most_steps.unwrap_or(u32::MAX), cancel, on_step)?;
    for _ in 0..SWAPS {
        if ending != Ending::Converged {
            break;
        }
        let Some(mut other) = run.swapped(cancel)? else { break };
        let after = other.converge(u32::MAX, cancel, &mut |_, _| ())?;
        if other.energy() >= run.energy() {
            break;
        }
        let moves = run.clusters.labels.iter().zip(&other.clusters.labels).filter(|(a, b)| a != b).count() as u64;
        (run, ending) = (other, after);
        on_step(Step { phase: Phase::Swap, energy: run.energy(), moves }, &run.clusters.labels);
    }
    let energies = [before, run.costs()];
    Ok(Clustering { initial, labels: run.clusters.labels, shapes: run.shapes, energies, ending })
}

struct Run<'a> {
    allowed: Allowed<'a>,
    component_of_cluster: Vec<u32>,
    shapes: Vec<Shape>,
    clusters: Clusters<'a>,
}

/// A shape with its proxy, and the costs of its faces.
struct Fitted {
    shape: Shape,
    proxy: Proxy,
    cost: i128,
}

impl<'a> Run<'a> {
    fn new(
        faces: Faces<'a>,
        allowed: Allowed<'a>,
        labels: Vec<u32>,
        component_of_cluster: Vec<u32>,
        axes: &[Option<DVec3>],
    ) -> Result<Self> {
        let members = members(&labels, axes.len(), |_| true);
        let fit = |((members, axis), &component): ((&Vec<u32>, &Option<DVec3>), &u32)| {
            fitted(faces, allowed, component, members, *axis, None)
        };
        let fits: Option<Vec<Fitted>> = members.par_iter().zip(axes).zip(&component_of_cluster).map(fit).collect();
        let fits = fits.ok_or_else(|| Error::new(error::Kind::Internal, "a cluster has no shape"))?;
        let shapes = fits.iter().map(|fit| fit.shape).collect();
        let proxies = fits.iter().map(|fit| fit.proxy).collect();
        let costs = fits.iter().map(|fit| fit.cost).collect();
        Ok(Self { allowed, component_of_cluster, shapes, clusters: Clusters::new(faces, labels, proxies, costs) })
    }

    /// F, in units of the finest component.
    fn energy(&self) -> i128 {
        let price = |(shape, &component): (&Shape, &u32)| {
            self.allowed.prices[component as usize].exact(shape.kind()) << self.shift(component)
        };
        self.costs() + self.shapes.iter().zip(&self.component_of_cluster).map(price).sum::<i128>()
    }

    /// F without prices.
    fn costs(&self) -> i128 {
        let costs = self.clusters.costs.iter().zip(&self.component_of_cluster);
        costs.map(|(cost, &component)| cost << self.shift(component)).sum()
    }

    fn shift(&self, component: u32) -> u32 {
        self.clusters.faces.graph.components[component as usize].energy_shift
    }

    fn converge(&mut self, most_steps: u32, cancel: &Cancel, on_step: &mut dyn FnMut(Step, &[u32])) -> Result<Ending> {
        let mut left = most_steps;
        let all = vec![true; self.shapes.len()];
        let mut has_new_shape = all.clone();
        for _ in 0..ROUNDS {
            let mut faces = self.clusters.at_boundaries(&has_new_shape);
            let mut has_moved = false;
            while !faces.is_empty() && left > 0 {
                cancel.check()?;
                let (moves, next) = self.clusters.pass(&faces);
                if moves > 0 {
                    (left, has_moved) = (left - 1, true);
                    on_step(Step { phase: Phase::Boundary, energy: self.energy(), moves }, &self.clusters.labels);
                }
                faces = next;
            }
            if left == 0 {
                return Ok(Ending::IterationLimit);
            }
            cancel.check()?;
            let takes_shape = self.fit();
            if takes_shape.contains(&true) {
                left -= 1;
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
        let Self { allowed, component_of_cluster, shapes, clusters } = self;
        let axes: Vec<Option<DVec3>> = shapes.iter().map(Shape::axis).collect();
        let swaps =
            Swaps { faces: clusters.faces, allowed: *allowed, labels: &clusters.labels, component_of_cluster, axes };
        let begun = |Swapped { labels, component_of_cluster, axes }| {
            Run::new(clusters.faces, *allowed, labels, component_of_cluster, &axes)
        };
        swaps.made(cancel)?.map(begun).transpose()
    }

    /// Fits shapes to the clusters that changed. Returns which took one.
    fn fit(&mut self) -> Vec<bool> {
        let Self { allowed, component_of_cluster, shapes, clusters } = self;
        let members = members(&clusters.labels, shapes.len(), |label| clusters.has_changed[label as usize]);
        let fit = |(number, members): (usize, &Vec<u32>)| {
            let so_far = Some((shapes[number].kind(), clusters.costs[number]));
            (!members.is_empty())
                .then(|| {
                    let axis = shapes[number].axis();
                    fitted(clusters.faces, *allowed, component_of_cluster[number], members, axis, so_far)
                })
                .flatten()
        };
        let fits: Vec<Option<Fitted>> = members.par_iter().enumerate().map(fit).collect();
        clusters.has_changed.fill(false);
        let is_new = fits.iter().map(Option::is_some).collect();
        for (number, fit) in fits.into_iter().enumerate() {
            if let Some(Fitted { shape, proxy, cost }) = fit {
                (shapes[number], clusters.proxies[number], clusters.costs[number]) = (shape, proxy, cost);
            }
        }
        is_new
    }
}

/// The best shape of some faces that is better than the one so far, given by its type and costs.
fn fitted(
    faces: Faces<'_>,
    allowed: Allowed<'_>,
    component: u32,
    members: &[u32],
    axis: Option<DVec3>,
    so_far: Option<(Kind, i128)>,
) -> Option<Fitted> {
    let moments = Moments::of_all(&faces, members);
    let higher = || (members.len() as u32 >= FEWEST_FACES).then(|| Higher::of_all(&faces, members));
    let candidates = allowed.fits(component, &moments, higher, axis.as_slice());
    let prices = &allowed.prices[component as usize];
    let with_price = |kind: Kind, cost: i128| cost + prices.exact(kind);
    let mut least = so_far.map(|(kind, cost)| with_price(kind, cost));
    let mut best = None;
    for candidate in candidates.all() {
        let by_moments = candidate.energy * f64::from(1u32 << (2 * SHIFT));
        if least.is_some_and(|least| by_moments > MARGIN * least as f64) {
            continue;
        }
        let shape = candidate.fit.shape;
        let Some(proxy) = Proxy::new(&shape, candidates.mean()) else { continue };
        let of_face = |&face: &u32| i128::from(faces.weight(face)) * i128::from(proxy.cost(faces.samples(face)));
        let cost = members.iter().map(of_face).sum();
        if least.is_none_or(|least| with_price(proxy.kind, cost) < least) {
            least = Some(with_price(proxy.kind, cost));
            best = Some(Fitted { shape, proxy, cost });
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::generate_part;
    use crate::surface::Surface;

    #[test]
    fn the_energy_that_is_kept_is_that_of_the_labels_and_a_shape_must_be_better_by_one_unit() {
        let (mesh, _) = generate_part(1500, 0.3).expect("a part");
        let surface = Surface::build(&mesh).expect("a surface");
        let samples = surface.samples(&surface.corners((&mesh).into()));
        let faces = Faces { graph: &surface.graph, samples: &samples };
        let options = Options { clusters: 13, kinds: Kind::ALL.to_vec(), resolution: 1e5, most_steps: None };
        let prices = Prices::of(faces.graph, options.clusters, options.resolution);
        let allowed = Allowed { kinds: &options.kinds, prices: &prices };
        let merged = merged(faces, allowed, options.clusters, &Cancel::default()).expect("clusters");
        let mut run =
            Run::new(faces, allowed, merged.labels, merged.component_of_cluster, &merged.axes).expect("shapes");
        let (mut steps, mut last) = (0, run.energy());
        run.converge(u32::MAX, &Cancel::default(), &mut |step, _| {
            assert!(step.energy < last, "{step:?} {last}");
            (steps, last) = (steps + 1, step.energy);
        })
        .expect("an end");
        assert!(steps > 2 && last == run.energy());
        // nothing is left to move
        let all: Vec<u32> = (0..faces.count() as u32).collect();
        assert_eq!(run.clusters.pass(&all).0, 0);
        let members = members(&run.clusters.labels, 13, |_| true);
        for (number, members) in members.iter().enumerate() {
            let proxy = &run.clusters.proxies[number];
            let cost_of = |&face: &u32| i128::from(faces.weight(face)) * i128::from(proxy.cost(faces.samples(face)));
            assert_eq!(run.clusters.costs[number], members.iter().map(cost_of).sum::<i128>());
        }
        let axis = run.shapes[0].axis();
        let again = |so_far| fitted(faces, allowed, 0, &members[0], axis, so_far);
        let found = again(None).expect("a shape");
        let with = |cost| Some((found.proxy.kind, cost));
        assert!(again(with(found.cost)).is_none() && again(with(found.cost + 1)).is_some());
    }
}
