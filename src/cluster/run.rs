//! A run: carries out phases, counts their iterations and reports them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::record::Record;
use crate::device::{Cancel, Ending, FLOOD_FROM, OnStep, Step, Steps};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::Result;
use crate::surface::{DualGraph, Moves};

/// Kinds of optimisation steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Boundary-based optimisation: faces at a boundary move to the neighbouring cluster whose centre is nearer.
    Boundary,
    /// Refinement: faces move where the energy falls, centres counted as they will be.
    Refine,
    /// Shapes are fitted to the clusters anew, where that lowers the energy.
    Refit,
    /// Clusters merge, where their shapes stay within the tolerance.
    Merge,
    /// Pieces cut off from their cluster are given to their neighbours.
    Repair,
    /// Variational clustering: all clusters are grown anew, each from its most central face.
    Regrow,
    /// Paying swaps: two clusters become one and a third becomes two, where that lowers the energy at once.
    Swap,
    /// Labels that were merged from single faces, or a mix with them, because their energy is lower.
    MergedStart,
    /// Those of quality `fast`, after swaps, or a mix with them.
    FastStart,
    /// Those of quality `fast`, settled before the swaps, or a mix with them.
    SettledStart,
    /// Those of a job with another quality or algorithm, or a mix with them.
    OtherJob,
    /// Merges and splits that pay after their surroundings have settled.
    Trial,
    /// More clusters by splits, then as many again by merges.
    Breathe,
}

/// One step of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// 0 is the state after the initial growth.
    pub iteration: u32,
    /// Hierarchies: the round of merges it follows.
    pub round: Option<u32>,
    /// What kind of step it was.
    pub phase: Phase,
    /// Energy after it.
    pub energy: LatticeEnergy,
    /// Faces that changed their cluster.
    pub moves: u64,
}

/// A run.
pub struct Run<'a> {
    /// The surface on its device.
    pub steps: &'a mut dyn Steps,
    /// Ends the run early.
    pub cancel: &'a Cancel,
    /// Called with every step as it happens.
    pub on_row: &'a mut dyn FnMut(Row),
    /// Hierarchies: the current round.
    pub round: Option<u32>,
    /// Number of the last row.
    pub iteration: u32,
    /// Iterations with moves that may still be made.
    pub left: u32,
    /// Keeps the labels of wanted iterations, if any.
    pub record: Option<&'a mut Record>,
}

impl<'a> Run<'a> {
    /// A run from its beginning, without a limit on iterations.
    pub fn new(steps: &'a mut dyn Steps, cancel: &'a Cancel, on_row: &'a mut dyn FnMut(Row)) -> Self {
        Self { steps, cancel, on_row, round: None, iteration: 0, left: u32::MAX, record: None }
    }

    /// Reports the current state.
    pub fn report(&mut self, phase: Phase, moves: u64) -> Result<()> {
        let energy = self.steps.energy()?;
        (self.on_row)(Row { iteration: self.iteration, round: self.round, phase, energy, moves });
        self.keep_labels()
    }

    /// Keeps the labels if those of this iteration are wanted.
    fn keep_labels(&mut self) -> Result<()> {
        if let Some(record) = self.record.as_mut().filter(|record| record.wants(self.iteration)) {
            record.keep(self.iteration, self.steps.labels()?);
        }
        Ok(())
    }

    /// Runs the boundary phase to its end, then refinement if `refine`, unless the limit was reached or the boundary
    /// phase has flooded ([`super::flat`] has the reason). On a graph whose [`Moves`] are connected, faces move one
    /// after the other in place of both.
    pub fn optimise<E: Functional>(&mut self, graph: &DualGraph<E>, refine: bool) -> Result<Ending> {
        if graph.moves == Moves::Connected {
            return self.settle(graph);
        }
        let before = self.iteration;
        let ending =
            self.phase(Phase::Boundary, |steps, left, cancel, on_step| steps.optimise_boundary(left, cancel, on_step))?;
        let has_flooded = self.iteration - before >= FLOOD_FROM;
        if ending == Ending::IterationLimit || !refine || has_flooded {
            return Ok(ending);
        }
        self.phase(Phase::Refine, |steps, left, cancel, on_step| steps.refine(left, cancel, on_step))
    }

    /// Repairs clusters in several pieces ([`Steps::repair`]). Returns whether there were any.
    pub fn repair(&mut self) -> Result<bool> {
        let cut_off = self.steps.repair(self.cancel)?;
        if cut_off > 0 {
            self.iteration += 1;
            self.report(Phase::Repair, cut_off)?;
        }
        Ok(cut_off > 0)
    }

    /// Carries out the iterations of a phase, interrupted where labels are wanted.
    pub(super) fn phase(
        &mut self,
        phase: Phase,
        mut iterate: impl FnMut(&mut dyn Steps, u32, &Cancel, OnStep<'_>) -> Result<Ending>,
    ) -> Result<Ending> {
        loop {
            let Self { steps, cancel, on_row, round, iteration, left, record, .. } = self;
            let stop = record.as_ref().and_then(|record| record.next());
            let allowed = stop.map_or(u32::MAX, |stop| stop.saturating_sub(*iteration).max(1)).min(*left);
            let mut on_step = |Step { energy, moves }| {
                *iteration += 1;
                *left -= 1;
                on_row(Row { iteration: *iteration, round: *round, phase, energy, moves });
            };
            let ending = iterate(*steps, allowed, cancel, &mut on_step)?;
            self.keep_labels()?;
            if ending != Ending::IterationLimit || self.left == 0 {
                return Ok(ending);
            }
            self.steps.resume();
        }
    }
}
