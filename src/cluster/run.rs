//! A run under way: carries out phases, counts their iterations and tells of them.

use crate::device::{Cancel, Ending, LatticeEnergy, Step, Steps};
use crate::error::Result;
use crate::report::Phase;

/// What happens in a run, in order.
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

/// A run under way.
pub struct Run<'a> {
    /// The surface on its device.
    pub steps: &'a mut dyn Steps,
    /// Asks to stop.
    pub cancel: &'a Cancel,
    /// Is told of every step as it happens.
    pub on_row: &'a mut dyn FnMut(Row),
    /// Hierarchies: the current round.
    pub round: Option<u32>,
    /// Number of the last row.
    pub iteration: u32,
    /// Iterations with moves that may still be made.
    pub left: u32,
}

impl Run<'_> {
    /// Tells of the current state.
    pub fn tell(&mut self, phase: Phase, moves: u64) -> Result<()> {
        let energy = self.steps.energy()?;
        (self.on_row)(Row { iteration: self.iteration, round: self.round, phase, energy, moves });
        Ok(())
    }

    /// Runs a phase to its end.
    pub fn phase(&mut self, phase: Phase) -> Result<Ending> {
        let Self { steps, cancel, on_row, round, iteration, left } = self;
        let allowed = *left;
        let mut on_step = |Step { energy, moves }| {
            *iteration += 1;
            *left -= 1;
            on_row(Row { iteration: *iteration, round: *round, phase, energy, moves });
        };
        match phase {
            Phase::Boundary | Phase::Repair => steps.optimise_boundary(allowed, cancel, &mut on_step),
            Phase::Refine => steps.refine(allowed, cancel, &mut on_step),
        }
    }
}
