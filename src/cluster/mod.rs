//! Boundary-based clustering (P§3): its definition, why it ends, and its driver. [`refinement`] goes on where it ends.
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
//! 1. Face f in cluster a looks at the clusters of the faces it shares an edge with. The nearest is the one with the
//!    smallest |g − P_b|², the smaller number where two are equal. If |g − P_b|² < |g − P_a|², f wants to move to b.
//!    (The paper's test of a boundary edge, D⁰ D¹ D²; a cluster grows by its neighbour's shrinking, P§5.3.)
//! 2. *Last face.* If all faces that a had at the start want to leave, the one with the smallest internal number stays.
//!    Faces that arrive in the same iteration do not count, so no cluster is ever empty.
//! 3. All other faces that want to move do. Sums and proxies follow.
//!
//! *Convergence.* The phase ends when nothing moves. Then no face wants to, either: a cluster of one face has its proxy
//! on that face's centroid, so that face does not want to leave; and of several faces that all want to leave, all but
//! one do. So nothing is admissible any more, and a face refused by the last-face rule is looked at again because its
//! cluster has lost the others.
//!
//! # F never rises, and the phase ends
//!
//! F = Σ_c Σ_{f∈c} w·|g − P_c|² over the lattice proxies. With the proxies held, every face that moves lowers its own
//! term strictly and touches no other, whatever else moves. Refitting P_c then minimises Σ w·|g − P|² over the lattice:
//! the sum is M·|P − S/M|² plus a constant, each axis a parabola about S/M, and the lattice point nearest to the vertex
//! of a parabola is its minimum there. So an iteration in which something moves lowers F, an integer that is not
//! negative; there are finitely many labellings, none comes back, and the phase ends without a cap on iterations.
//!
//! # Connectivity
//!
//! Moves at the same time can cut a cluster in two. When a phase has converged, a repair frees all but the largest
//! piece of each cluster; growth hands the freed faces to their neighbours, and the next boundary phase begins. Repair
//! may raise F, and is its own row in the report. After [`MAX_REPAIRS`] rounds the last word is a repair: what grows
//! from connected pieces is connected.

pub mod dual_edge;
pub mod refinement;
pub mod repair;
pub mod seeds;
pub mod sums;

use crate::device::{Cancel, Ending, FREE, LatticeEnergy, Step, Steps};
use crate::error::Result;
use crate::report::Phase;
use crate::surface::Surface;
use seeds::SeedFaces;

/// Rounds of repair and optimisation before a repair has the last word. Real meshes take 1 to 6 (k from 10 to 30,000).
pub const MAX_REPAIRS: u32 = 32;

/// What a flat clustering is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Iterations with moves after which to stop, converged or not; growth and repairs do not count.
    pub max_iterations: Option<u32>,
    /// Refine what the boundary phase has converged to.
    pub refine: bool,
    /// Leave clusters in the pieces that the optimisation left.
    pub allow_disconnected: bool,
}

/// What happens in a run, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// 0 is the state after the initial growth.
    pub iteration: u32,
    /// What kind of step it was.
    pub phase: Phase,
    /// Energy after it.
    pub energy: LatticeEnergy,
    /// Faces that changed their cluster.
    pub moves: u64,
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

/// Clusters a surface from the given seeds, on a device that was opened with the same surface and seeds.
///
/// `on_row` is told of every step as it happens.
pub fn boundary_based(
    surface: &Surface,
    seeds: &SeedFaces,
    options: Options,
    steps: &mut dyn Steps,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
) -> Result<Clustering> {
    let mut labels = vec![FREE; surface.faces()];
    for (cluster, &face) in seeds.face_of_cluster.iter().enumerate() {
        labels[face as usize] = cluster as u32;
    }
    let left = options.max_iterations.unwrap_or(u32::MAX);
    let mut run = Run { steps, cancel, on_row, iteration: 0, left };
    run.steps.set_labels(&labels)?;
    run.steps.grow(cancel)?;
    run.tell(Phase::Boundary, 0)?;
    let initial = run.steps.labels()?;

    let mut repairs = 0;
    loop {
        let mut ending = run.phase(Phase::Boundary)?;
        if options.refine && ending == Ending::Converged {
            ending = run.phase(Phase::Refine)?;
        }
        let cut_off = if options.allow_disconnected { Vec::new() } else { run.steps.cut_off_faces()? };
        if cut_off.is_empty() {
            return Ok(Clustering { initial, labels: run.steps.labels()?, ending });
        }
        run.steps.regrow(&cut_off, cancel)?;
        run.iteration += 1;
        run.tell(Phase::Repair, cut_off.len() as u64)?;
        repairs += 1;
        if repairs == MAX_REPAIRS || ending == Ending::IterationLimit {
            return Ok(Clustering { initial, labels: run.steps.labels()?, ending: Ending::IterationLimit });
        }
    }
}

/// A run under way: counts iterations and tells of them.
struct Run<'a> {
    steps: &'a mut dyn Steps,
    cancel: &'a Cancel,
    on_row: &'a mut dyn FnMut(Row),
    iteration: u32,
    /// Iterations with moves that may still be made.
    left: u32,
}

impl Run<'_> {
    /// Tells of the current state.
    fn tell(&mut self, phase: Phase, moves: u64) -> Result<()> {
        let energy = self.steps.energy()?;
        (self.on_row)(Row { iteration: self.iteration, phase, energy, moves });
        Ok(())
    }

    /// Runs a phase to its end.
    fn phase(&mut self, phase: Phase) -> Result<Ending> {
        let Self { steps, cancel, on_row, iteration, left } = self;
        let allowed = *left;
        let mut on_step = |Step { energy, moves }| {
            *iteration += 1;
            *left -= 1;
            on_row(Row { iteration: *iteration, phase, energy, moves });
        };
        match phase {
            Phase::Boundary | Phase::Repair => steps.optimise_boundary(allowed, cancel, &mut on_step),
            Phase::Refine => steps.refine(allowed, cancel, &mut on_step),
        }
    }
}
