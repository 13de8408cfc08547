//! Boundary-based clustering (P§3): its definition, why it ends, and the driver of flat clusterings.
//! [`super::refinement`] continues it, and [`super::connected`] makes clusters connected.
//!
//! # Definition
//!
//! Every face f has a centroid g on the lattice and a weight w ≥ 1; a cluster c has the proxy P_c, the lattice point
//! nearest to its weighted mean centroid (per axis, halves up). All of it is integer arithmetic ([`crate::surface`]).
//!
//! *Growth.* In each pass every free face with labelled neighbours takes the smallest of their labels, all faces at
//! once, until no free face is left that has one.
//!
//! *Iteration.* All faces decide at once, on the labels and proxies at its start:
//!
//! 1. For face f in cluster a, consider the clusters of the faces that it shares an edge with. The nearest is the one
//!    with the smallest |g − P_b|², the smaller number where two are equal. If |g − P_b|² < |g − P_a|², f wants to move
//!    to b. (The paper's test of a boundary edge, D⁰ D¹ D²; a cluster grows by its neighbour's shrinking, P§5.3.)
//! 2. *Last face.* If all faces that a had at the start want to leave, the one with the smallest internal number stays.
//!    Faces that arrive in the same iteration do not count, so no cluster is ever empty.
//! 3. All other faces that want to move do. Sums and proxies follow.
//!
//! *Flood.* 1. to 3. are a pass. From iteration 256 of a phase on ([`FLOOD_FROM`]), an iteration repeats it with the
//! proxies held until nothing moves; then sums and proxies follow. Only faces that moved or were refused in a pass, and
//! faces beside those that moved, can decide otherwise in the next.
//!
//! *Convergence.* The phase ends when nothing moves. Then no face wants to, either: a cluster of one face has its proxy
//! on that face's centroid, so that face does not want to leave; and of several faces that all want to leave, all but
//! one do. So nothing is admissible any more, and a face refused by the last-face rule is looked at again because its
//! cluster has lost the others.
//!
//! # F never rises, and the phase ends
//!
//! F = Σ_c Σ_{f∈c} w·|g − P_c|² over the lattice proxies. With the proxies held, every face that moves lowers its own
//! term strictly and touches no other, whatever else moves; so does every pass of a flood, which therefore ends. The
//! refit that follows never raises F (`docs/arithmetic.md`). So an iteration in which something moves lowers F, an
//! integer that is not negative; there are finitely many labellings, none comes back, and the phase ends without a cap
//! on iterations.
//!
//! # Why floods
//!
//! An iteration moves a border by one face. Where thousands of faces lie at one place (boxes stacked by instancing) or
//! in one thin ring (a cone), borders have as many to go; a flood moves a border to where the proxies put it. No
//! refinement follows ([`super::run::Run::optimise`]): it exchanges some two faces a pair of clusters and iteration, so
//! that it has as far to go as the borders had.

use super::record::Record;
use super::run::{Phase, Row, Run};
#[cfg(doc)]
use crate::device::FLOOD_FROM;
use crate::device::{Cancel, Ending, FREE, Steps};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::DualGraph;

/// Options of a flat clustering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Iterations with moves after which to stop, converged or not; growth and repairs do not count.
    pub max_iterations: Option<u32>,
    /// Refine what the boundary phase has converged to.
    pub refine: bool,
    /// Leave clusters in the pieces that the optimisation left.
    pub allow_disconnected: bool,
}

/// The result of a run; labels in internal order.
#[derive(Debug)]
pub struct Clustering {
    /// After the initial growth.
    pub initial: Vec<u32>,
    /// In the end: every cluster has a face, and is connected unless that was waived.
    pub labels: Vec<u32>,
    /// Whether the optimisation converged, or ran into the limit on iterations.
    pub ending: Ending,
}

/// Clusters the faces of a graph from a start: one label a face, or [`FREE`] for faces that clusters grow over. The
/// device was opened with the same graph and clusters.
///
/// `on_row` is called with every step as it happens; `record` keeps the labels of the iterations that it wants.
pub fn boundary_based<E: Functional>(
    graph: &DualGraph<E>,
    start: &[u32],
    options: Options,
    steps: &mut dyn Steps,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
    record: &mut Record,
) -> Result<Clustering> {
    let (mut run, initial) = grown(start, options, steps, cancel, on_row, record)?;
    let ending = run.complete(graph, options.allow_disconnected, |run| run.optimise(graph, options.refine))?;
    Ok(Clustering { initial, labels: run.steps.labels()?, ending })
}

/// Begins a run: grows clusters from a start over all faces, and reports that. Returns the run and the labels.
pub(super) fn grown<'a>(
    start: &[u32],
    options: Options,
    steps: &'a mut dyn Steps,
    cancel: &'a Cancel,
    on_row: &'a mut dyn FnMut(Row),
    record: &'a mut Record,
) -> Result<(Run<'a>, Vec<u32>)> {
    let left = options.max_iterations.unwrap_or(u32::MAX);
    let mut run = Run { left, record: Some(record), ..Run::new(steps, cancel, on_row) };
    run.steps.set_labels(start)?;
    run.steps.grow(cancel)?;
    run.report(Phase::Boundary, 0)?;
    let is_grown = !start.contains(&FREE);
    let initial = if is_grown { start.to_vec() } else { run.steps.labels()? };
    Ok((run, initial))
}
