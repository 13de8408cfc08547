//! The shape that a cluster takes: a fit, judged by the sum of costs over its faces, in integers.

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

/// The best shape of some faces that is better than the one so far, given by its type and costs; with a tolerance, of
/// those within it.
pub(super) fn fitted(
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
