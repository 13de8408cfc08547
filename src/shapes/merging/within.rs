//! Clusters that merge as long as every corner stays within a tolerance of the shape of its cluster.
//!
//! An edge whose clusters have no shape with a mean square within the tolerance waits. When the turn of another comes,
//! shapes are compared with all corners of both clusters; if none is within the tolerance, the edge waits, too. It is
//! priced again when one of its clusters has merged.
//!
//! # Work
//!
//! A round prices and looks at edges as in [`super`], those that wait included. Merging ends after twice as many such
//! looks as that has until one end suffices, or after [`LOOKS_A_CORNER`] looks at a corner on average: there are more
//! clusters than need be then. Scans take 1 to 35, and a fit of [`super::super::geometric`], 30 steps at most, for
//! some.

use std::cell::Cell;

use super::{Edge, LOOKS_AN_EDGE, Merged, Merging, Union};
use crate::device::Cancel;
use crate::device::dual_edge::from_into;
use crate::error::Result;
use crate::parallel;
use crate::shapes::best::{Allowed, Candidates};
use crate::shapes::faces::Faces;
use crate::shapes::proxy::Proxy;
use crate::shapes::shape::Shape;
use crate::shapes::tolerance::Tolerance;

/// Looks at a corner on average, to see whether it is within the tolerance of a shape.
const LOOKS_A_CORNER: usize = 512;

/// Tries to merge between two looks whether the job is cancelled.
const TRIES: usize = 256;

/// The price of an edge that waits.
const BEYOND: i64 = f64::INFINITY.to_bits() as i64;

/// Clusters to begin with.
#[derive(Debug, Clone, Copy)]
pub struct Begun<'a> {
    /// One a face.
    pub labels: &'a [u32],
    /// The shape of each cluster.
    pub shapes: &'a [Shape],
}

/// Clusters that were merged within a tolerance.
#[derive(Debug)]
pub struct MergedWithin {
    /// The clusters.
    pub merged: Merged,
    /// A shape of each; all corners are within the tolerance, but of a single face.
    pub shapes: Vec<Shape>,
    /// Whether a bound on work ended it.
    pub is_bounded: bool,
}

/// Merges clusters, single faces at first, until no merge is within the tolerance.
pub fn merged_within(
    faces: Faces<'_>,
    allowed: Allowed<'_>,
    tolerance: Tolerance<'_>,
    begun: Option<Begun<'_>>,
    cancel: &Cancel,
) -> Result<MergedWithin> {
    let mut merging = Merging::new(faces, allowed);
    let mut clusters = faces.count();
    let mut shapes: Vec<Shape> = parallel::map(faces.count(), 1, |face| tolerance.plane_of(face as u32));
    if let Some(begun) = begun {
        clusters = begun.shapes.len();
        let axes: Vec<_> = begun.shapes.iter().map(Shape::axis).collect();
        let numbers = merging.begin(begun.labels, &axes);
        numbers.iter().zip(begun.shapes).for_each(|(&number, &shape)| shapes[number as usize] = shape);
    }
    let components = faces.graph.components.len();
    let edges = merging.edges_inside(&vec![0; faces.count()], &[1]);
    let most = LOOKS_AN_EDGE * faces.graph.neighbours.items.len() / 2;
    let (has_begun, looks_left) = (begun.is_some(), LOOKS_A_CORNER * tolerance.corners.faces.all_corners().len());
    let mut state = MergingWithin { merging, tolerance, shapes, has_begun, looks_left, waiting: Vec::new() };
    let mut edges = state.without_waiting(edges);
    let (mut looks, mut is_bounded) = (0, false);
    while !edges.is_empty() && !is_bounded {
        cancel.check()?;
        looks += edges.len() + state.waiting.len();
        let chosen = state.merging.choose(&edges, clusters - components, looks > most);
        let tried = chosen.len();
        let mut refused = Vec::new();
        for (at, edge) in chosen.into_iter().enumerate() {
            if at % TRIES == TRIES - 1 {
                cancel.check()?;
            }
            if !state.merge(edge.ends()) {
                refused.push(edge);
            }
        }
        clusters -= tried - refused.len();
        edges.retain(|edge| refused.binary_search(edge).is_err());
        state.waiting.extend(refused.iter().map(Edge::ends));
        state.merging.contract(&mut edges, &mut state.waiting);
        edges = state.without_waiting(edges);
        is_bounded = looks > 2 * most || state.looks_left == 0;
    }
    let MergingWithin { mut merging, shapes, .. } = state;
    let merged = merging.clusters(None);
    let shapes = merged.numbers.iter().map(|&number| shapes[number as usize]).collect();
    Ok(MergedWithin { merged, shapes, is_bounded })
}

/// Clusters that merge within a tolerance.
struct MergingWithin<'a> {
    merging: Merging<'a>,
    tolerance: Tolerance<'a>,
    /// One a number of a cluster.
    shapes: Vec<Shape>,
    /// Whether it began with clusters.
    has_begun: bool,
    /// The ends of edges that wait.
    waiting: Vec<(u32, u32)>,
    looks_left: usize,
}

impl MergingWithin<'_> {
    /// The edges that do not wait.
    fn without_waiting(&mut self, mut edges: Vec<Edge>) -> Vec<Edge> {
        edges.retain(|edge| {
            let waits = edge.cost == BEYOND;
            if waits {
                self.waiting.push(edge.ends());
            }
            !waits
        });
        edges
    }

    /// Merges the clusters that two have become, if there is a shape within the tolerance.
    fn merge(&mut self, (low, high): (u32, u32)) -> bool {
        let [a, b] = [low, high].map(|cluster| self.merging.root(cluster));
        let ends = (a.min(b), a.max(b));
        let (moments, candidates) = self.merging.union(ends.0, ends.1);
        let Some(shape) = self.shape_of(ends, &candidates) else { return false };
        let Union { into, .. } = self.merging.unite(ends, moments, candidates.best());
        self.shapes[into as usize] = shape;
        true
    }

    /// A shape that both clusters are within the tolerance of: of the fits to both, or that of the larger one. Clusters
    /// that were optimised have no better ones to merge with, so that it may be any near the fits then.
    fn shape_of(&mut self, (low, high): (u32, u32), candidates: &Candidates) -> Option<Shape> {
        if self.looks_left == 0 {
            return None;
        }
        let Self { merging, tolerance, shapes, .. } = self;
        let looks = Cell::new(0);
        let look = |&face: &u32| looks.set(looks.get() + tolerance.corners.of(face).len());
        let faces_of = |cluster| merging.members.of(cluster).inspect(look);
        let both = || faces_of(low).chain(faces_of(high));
        let has_proxy = |shape: &Shape| Proxy::new(shape, candidates.mean()).is_some();
        let fits: Vec<Shape> = candidates.within().iter().map(|candidate| candidate.fit.shape).collect();
        let fit = || fits.iter().copied().find(|shape| has_proxy(shape) && tolerance.admits(shape, both()));
        let of_larger = || {
            let faces = [low, high].map(|cluster| merging.parts[cluster as usize].faces);
            let (from, into) = from_into((low, high), faces);
            let shape = shapes[into as usize];
            // a single face may be beyond the tolerance of its own shape
            let is_within =
                tolerance.admits(&shape, faces_of(from)) && tolerance.admits(&shape, faces_of(into).take(1));
            (is_within && has_proxy(&shape)).then_some(shape)
        };
        let near = || fits.iter().find_map(|fit| tolerance.reached_from(fit, both()).filter(has_proxy));
        let shape = fit().or_else(of_larger).or_else(|| self.has_begun.then(near).flatten());
        self.looks_left = self.looks_left.saturating_sub(looks.get());
        shape
    }
}
