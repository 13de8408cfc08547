//! The shape that a cluster takes: a fit, judged by the sum of costs over its faces, in integers.

use std::sync::OnceLock;

use glam::DVec3;

use super::best::{Allowed, FEWEST_FACES};
use super::faces::Faces;
use super::kind::Kind;
use super::moments::{Higher, Moments, SHIFT};
use super::proxy::Proxy;
use super::shape::Shape;

/// Fits whose energy, by moments, is this many times that of the shape so far are not worth a sum over the faces.
const MARGIN: f64 = 1.01;

/// A shape with its proxy, and the costs of the faces of its cluster.
#[derive(Debug, Clone, Copy)]
pub struct Fitted {
    /// In units of moments.
    pub shape: Shape,
    /// Its proxy.
    pub proxy: Proxy,
    /// Σ w·cost over the faces, below 2⁹¹·⁶.
    pub cost: i128,
}

/// What some faces cost.
pub(super) fn cost(faces: Faces<'_>, members: &[u32], proxy: &Proxy) -> i128 {
    members.iter().map(|&face| i128::from(faces.weight(face)) * i128::from(proxy.cost(faces.samples(face)))).sum()
}

/// A cluster to which a shape is fitted.
pub(super) struct Cluster<'m> {
    pub component: u32,
    /// Its faces.
    pub members: &'m [u32],
    pub moments: &'m Moments,
    /// Its axis, if its shape so far has one.
    pub axis: Option<DVec3>,
}

/// Sums over the faces of a cluster, which follow their moves.
pub(super) struct Sums {
    pub moments: Moments,
    /// Once a curved type was tried.
    higher: OnceLock<Higher>,
}

impl Sums {
    /// Of these faces.
    pub fn of(faces: &Faces<'_>, members: &[u32]) -> Self {
        Self { moments: Moments::of_all(faces, members), higher: OnceLock::new() }
    }

    /// The higher moments, given the faces.
    pub fn higher(&self, faces: &Faces<'_>, members: &[u32]) -> Higher {
        *self.higher.get_or_init(|| Higher::of_all(faces, members))
    }

    /// Counts a face in, or out.
    pub fn count(&mut self, faces: &Faces<'_>, face: u32, is_in: bool) {
        let moments = Moments::of(faces, face);
        self.moments.add(&if is_in { moments } else { moments.negated() });
        if let Some(sums) = self.higher.get_mut() {
            let higher = Higher::of(faces, face);
            sums.add(&if is_in { higher } else { higher.negated() });
        }
    }
}

/// The best shape of a cluster that is better than the one so far, given by its type and costs; with a tolerance, of
/// those within it. `higher` is called if a curved type is tried.
pub(super) fn fitted(
    faces: Faces<'_>,
    allowed: Allowed<'_>,
    cluster: &Cluster<'_>,
    higher: impl FnOnce() -> Higher,
    so_far: Option<(Kind, i128)>,
) -> Option<Fitted> {
    let Cluster { component, members, moments, axis } = *cluster;
    let higher = || (members.len() as u32 >= FEWEST_FACES).then(higher);
    let candidates = allowed.fits(component, moments, higher, axis.as_slice());
    let prices = &allowed.prices[component as usize];
    let with_price = |kind: Kind, cost: i128| cost + prices.exact(kind);
    let mut least = so_far.map(|(kind, cost)| with_price(kind, cost));
    let mut best = None;
    let placed = |shape: Shape| {
        let proxy = Proxy::new(&shape, candidates.mean())?;
        Some(Fitted { shape, proxy, cost: cost(faces, members, &proxy) })
    };
    for candidate in candidates.all() {
        let by_moments = candidate.energy * f64::from(1u32 << (2 * SHIFT));
        if least.is_some_and(|least| by_moments > MARGIN * least as f64) {
            continue;
        }
        let Some(fitted) = placed(candidate.fit.shape) else { continue };
        let is_better = least.is_none_or(|least| with_price(fitted.proxy.kind, fitted.cost) < least);
        let is_within =
            || allowed.tolerance.is_none_or(|tolerance| tolerance.admits(&fitted.shape, members.iter().copied()));
        if is_better && is_within() {
            least = Some(with_price(fitted.proxy.kind, fitted.cost));
            best = Some(fitted);
        }
    }
    best
}
