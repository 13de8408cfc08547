//! Phases as batches of iterations.
//!
//! A batch is queued at once, and then the host waits for its statistics: a round trip costs as much as some 15
//! dispatches, an iteration 3 or 4 of them. The device itself ends a phase: the kernel that finds an iteration without
//! moves writes zeros into the arguments of the indirect dispatches that follow. Those still cost most of a dispatch,
//! so the next batch has as many iterations as the moves so far foretell ([`foretold`]).
//!
//! A batch before the last is not known to be the last, and queueing the next one ahead of its statistics would leave
//! that idle after every phase. The pause of a round trip between batches costs less.

use std::mem::take;
use std::time::{Duration, Instant};

use super::FaultPoint;
use super::buffers::{BATCH, Buffer};
use super::kernels::{self, Kernel};
use super::layout::IterationStats;
use super::state::{GpuSteps, History, Search};
use crate::device::{Cancel, Ending, FLOOD_FROM};
use crate::error::Result;

/// What an iteration does.
pub(super) struct Phase {
    /// Name of its passes in profiles.
    name: &'static str,
    fault_point: FaultPoint,
    kernels: &'static [&'static Kernel],
    /// What completes the last iteration of a batch.
    at_end: &'static [&'static Kernel],
    /// The first iteration that is a flood: it takes several passes, each with a number of its own, until one in which
    /// nothing moves.
    flood_from: u32,
    /// Whether an iteration without moves found nothing left to do.
    is_over: fn(&IterationStats) -> bool,
    /// Whether a batch ends with the energy: iterations of the others report it.
    is_growth: bool,
    /// Whether a search for dual edges may be next.
    precedes_searches: bool,
}

pub(super) const GROWTH: Phase = Phase {
    name: "grow",
    fault_point: FaultPoint::Grow,
    kernels: &[kernels::GROWTH_PROPOSE, kernels::GROWTH_APPLY],
    at_end: &[],
    flood_from: u32::MAX,
    is_over: |_| true,
    is_growth: true,
    precedes_searches: false,
};

pub(super) const BOUNDARY: Phase = Phase {
    name: "boundary",
    fault_point: FaultPoint::Boundary,
    kernels: &[kernels::BOUNDARY_PROPOSE, kernels::BOUNDARY_APPLY, kernels::PROXIES_FIT],
    at_end: &[],
    flood_from: FLOOD_FROM,
    is_over: |_| true,
    is_growth: false,
    precedes_searches: true,
};

pub(super) const REFINEMENT: Phase = Phase {
    name: "refine",
    fault_point: FaultPoint::Refine,
    kernels: &[kernels::FACE_BID, kernels::SELECT_BIDS, kernels::JOIN_MOVES, kernels::EVALUATE_MOVES],
    at_end: &[kernels::COMMIT_MOVES],
    flood_from: u32::MAX,
    is_over: |stats| stats.bids == 0,
    is_growth: false,
    precedes_searches: false,
};

impl GpuSteps<'_> {
    /// Runs iterations, numbered from `first`, until one has nothing left to do or `limit` of them moved something.
    /// Calls `on_iteration` with each that did and the number of moves, in order. Also returns the number of the next
    /// iteration.
    pub(super) fn run(
        &mut self,
        phase: &Phase,
        (first, limit): (u32, u32),
        cancel: &Cancel,
        mut on_iteration: impl FnMut(&IterationStats, u64),
    ) -> Result<(Ending, u32)> {
        let tuning = self.connection.tuning;
        // iterations that may still move something
        let mut left = limit;
        let mut number = first;
        // moves of a flood that goes on
        let mut flooded = 0;
        let mut size = if self.is_repaired { tuning.batch_after_repair } else { tuning.first_batch };
        let mut all_moves = Vec::new();
        loop {
            cancel.check()?;
            let iterations = size.min(left).min(BATCH);
            if iterations == 0 {
                return Ok((Ending::IterationLimit, number));
            }
            let started = Instant::now();
            for stats in self.run_batch(phase, number, iterations, iterations == left)? {
                let is_flood = number >= phase.flood_from;
                number = number.wrapping_add(1);
                all_moves.push(stats.moves);
                if stats.moves > 0 {
                    self.note_moves();
                    if is_flood {
                        flooded += u64::from(stats.moves);
                        continue;
                    }
                }
                let moves = take(&mut flooded) + u64::from(stats.moves);
                if moves > 0 {
                    left -= 1;
                    on_iteration(&stats, moves);
                } else if (phase.is_over)(&stats) {
                    cancel.check()?;
                    return Ok((Ending::Converged, number));
                }
            }
            let affordable = Duration::from_millis(tuning.batch_ms.into()).as_nanos() * u128::from(iterations)
                / started.elapsed().as_nanos().max(1);
            let most = tuning.largest_batch.min(affordable.try_into().unwrap_or(u32::MAX)).max(1);
            size = foretold(&all_moves).max(tuning.least_batch).min(most);
        }
    }

    /// Queues a batch and waits for its statistics. With the last one of a boundary phase goes the search for dual
    /// edges, if one followed the phase before.
    fn run_batch(&mut self, phase: &Phase, number: u32, iterations: u32, is_last: bool) -> Result<Vec<IterationStats>> {
        self.connection.reach(phase.fault_point);
        let search = match self.last_search {
            Some(Search::Best(ties)) if is_last && self.search_follows && phase.precedes_searches => Some(ties),
            _ => None,
        };
        if let Some(ties) = search {
            self.memory.announce_for_batch(self.summed() as u32, ties);
        }
        self.memory.number(&self.connection.queue, number);
        let mut encoder = self.encoder();
        encoder.clear_buffer(self.memory.get(Buffer::Stats), 0, None);
        // after a merge the host may ask for moves, so faces that moved stay listed
        let compacts = !phase.is_growth
            && self.history == History::Unmerged
            && self.iterations_listed >= self.connection.tuning.compact_after;
        {
            let mut pass = self.connection.pass(&mut encoder, phase.name);
            let mut dispatch = |kernel: &Kernel, slot| self.memory.dispatch(&self.connection, &mut pass, kernel, slot);
            if compacts {
                dispatch(kernels::BOUNDARY_COMPACT, 0);
                dispatch(kernels::BOUNDARY_PUBLISH, 0);
            }
            for slot in 0..iterations {
                phase.kernels.iter().for_each(|kernel| dispatch(kernel, slot));
            }
            phase.at_end.iter().for_each(|kernel| dispatch(kernel, iterations - 1));
        }
        self.iterations_listed = match compacts {
            true => iterations,
            // free faces are listed, wherever they are
            false if phase.is_growth && !self.is_repaired => u32::MAX,
            false => self.iterations_listed.saturating_add(iterations),
        };
        self.forget();
        if !phase.is_growth {
            return match search {
                Some(_) => self.read_stats_and_best(encoder, iterations),
                None => self.read_stats(encoder, iterations),
            };
        }
        self.encode(&mut encoder, "fit", &[kernels::PROXIES_FIT]);
        let ((stats, between), moves, _) = self.read_stats_and_moves(encoder, iterations, 0)?;
        self.is_fitted = true;
        self.moves = moves;
        // of a growth that is not over, the next batch reports both anew
        self.set_energy(Some(between.energy()));
        Ok(stats)
    }
}

/// How many iterations to queue next, from the moves of those so far. They fall by about a constant factor, taken from
/// the second half; to fewer than one after this many iterations, of which four fifths are queued, since the last moves
/// come one by one (`benches/results/choices.md`). As many as there were where they do not fall.
fn foretold(moves: &[u32]) -> u32 {
    let recent = &moves[moves.len() / 2..];
    let (Some(&first), Some(&last)) = (recent.first(), recent.last()) else { return 0 };
    if recent.len() < 2 || last >= first {
        return moves.len() as u32;
    }
    let fall_an_iteration = (f64::from(first) / f64::from(last.max(1))).ln() / (recent.len() - 1) as f64;
    (0.8 * f64::from(last.max(1)).ln() / fall_an_iteration + 1.0).ceil() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moves_foretell_the_iterations_that_are_left() {
        let halved: Vec<u32> = (0..12).map(|at| 1 << 20 >> at).collect();
        // 512 moves fall to 1 in nine more, and then to none
        assert_eq!(foretold(&halved), 9);
        assert_eq!(foretold(&[5, 5, 5, 5]), 4);
        assert_eq!(foretold(&[1, 2, 4]), 3);
        assert_eq!(foretold(&[9]), 1);
        assert_eq!(foretold(&[]), 0);
        assert!(foretold(&[7, 7, 1_000_000, 999_999]) > 1_000_000);
    }
}
