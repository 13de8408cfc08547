//! Phases as batches of iterations.
//!
//! A batch is queued at once, and then the host waits for its statistics; `docs/gpu.md` has what that costs. The device
//! itself ends a phase: the kernel that finds an iteration without movers notes that, and the threads of further
//! dispatches have nothing to do. The next batch has as many iterations as the moves so far foretell ([`foretold`]).
//! The growth is queued in the same way, in batches that double.
//!
//! A batch before the last is not known to be the last, and queueing the next one ahead of its statistics would leave
//! that idle after every phase. The pause of a round trip between batches costs less.

use std::mem::take;
use std::time::{Duration, Instant};

use super::FaultPoint;
use super::buffers::BATCH;
use super::kernels::{self, Items, Kernel, Part};
use super::layout::IterationStats;
use super::memory::{BETWEEN, Numbers};
use super::readback::Along;
use super::state::{Change, GpuSteps, History};
use crate::device::{Cancel, Ending, FLOOD_FROM};
use crate::energy::{LatticeEnergy, Words};
use crate::error::Result;

/// What an iteration does.
pub(super) struct Phase {
    /// Name of its passes in profiles.
    name: &'static str,
    fault_point: FaultPoint,
    kernels: &'static [&'static Kernel],
    /// The same, for few movers and clusters.
    of_few: [&'static Kernel; 2],
    /// The first iteration that is a flood: it takes several passes, each with a number of its own, until one in which
    /// nothing moves.
    flood_from: u32,
    /// Whether an iteration without moves found nothing left to do.
    is_over: fn(&IterationStats) -> bool,
    /// Whether clusters are ready for another phase after it.
    leaves_fitted: bool,
}

pub(super) const BOUNDARY: Phase = Phase {
    name: "boundary",
    fault_point: FaultPoint::Boundary,
    kernels: &[kernels::BOUNDARY_PROPOSE, kernels::BOUNDARY_APPLY, kernels::PROXIES_FIT],
    of_few: [kernels::BOUNDARY_PROPOSE, kernels::BOUNDARY_CHAIN],
    flood_from: FLOOD_FROM,
    is_over: |_| true,
    leaves_fitted: true,
};

pub(super) const REFINEMENT: Phase = Phase {
    name: "refine",
    fault_point: FaultPoint::Refine,
    kernels: &[
        kernels::FACE_BID,
        kernels::SELECT_BIDS,
        kernels::JOIN_MOVES,
        kernels::EVALUATE_MOVES,
        kernels::COMMIT_MOVES,
    ],
    of_few: [kernels::FACE_BID, kernels::REFINEMENT_CHAIN],
    flood_from: u32::MAX,
    is_over: |stats| stats.movers == 0,
    leaves_fitted: false,
};

impl<E: Words> GpuSteps<'_, E> {
    /// Runs iterations until one has nothing left to do or `limit` of them moved something. Calls `on_iteration` with
    /// each that did and the number of moves, in order; it returns the energy then.
    pub(super) fn run(
        &mut self,
        phase: &Phase,
        limit: u32,
        cancel: &Cancel,
        mut on_iteration: impl FnMut(&IterationStats, u64) -> LatticeEnergy,
    ) -> Result<Ending> {
        let tuning = self.connection.tuning;
        // iterations that may still move something
        let mut left = limit;
        if !take(&mut self.is_resumed) {
            self.phase_from = self.next;
        }
        // moves of a flood that goes on
        let mut flooded = 0;
        let is_repaired = self.known.is_repaired;
        let mut size = if is_repaired { tuning.batch_after_repair } else { tuning.first_batch };
        let mut all_moves = Vec::new();
        // rounds of a hierarchy have about as many as the round before
        let mut movers = if is_repaired { 0 } else { self.known.movers.min(self.memory.listed) };
        loop {
            cancel.check()?;
            let iterations = size.min(left).min(BATCH);
            if iterations == 0 {
                return Ok(Ending::IterationLimit);
            }
            let started = Instant::now();
            for stats in self.run_batch(phase, iterations, movers)? {
                let is_flood = self.next - self.phase_from >= phase.flood_from - 1;
                self.next += 1;
                all_moves.push(stats.moves);
                movers = stats.movers;
                if all_moves.len() == 1 {
                    self.known.movers = movers;
                }
                if stats.moves > 0 {
                    self.known.invalidate(Change::Moves);
                    if is_flood {
                        flooded += u64::from(stats.moves);
                        continue;
                    }
                }
                let moves = take(&mut flooded) + u64::from(stats.moves);
                if moves > 0 {
                    left -= 1;
                    self.known.energy = Some(on_iteration(&stats, moves));
                } else if (phase.is_over)(&stats) {
                    cancel.check()?;
                    return Ok(Ending::Converged);
                }
            }
            let affordable = Duration::from_millis(tuning.batch_ms.into()).as_nanos() * u128::from(iterations)
                / started.elapsed().as_nanos().max(1);
            let most = tuning.largest_batch.min(affordable.try_into().unwrap_or(u32::MAX)).max(1);
            size = foretold(&all_moves).max(tuning.least_batch).min(most);
        }
    }

    /// Queues a batch and waits for its statistics. `movers` is how many there may be.
    fn run_batch(&mut self, phase: &Phase, iterations: u32, movers: u32) -> Result<Vec<IterationStats>> {
        self.connection.reach(phase.fault_point);
        // after a merge the list is made anew before searches
        let is_listed_anew = self.known.history == History::Unmerged
            && self.known.listed.is_some_and(|listed| {
                self.memory.listed.saturating_sub(listed) > listed / self.connection.tuning.compact_part
            });
        let is_fitted = self.next == self.phase_from && !self.known.is_fitted;
        let (first, phase_from) = (self.next, self.phase_from);
        let numbers = Numbers { first, phase_from, iterations, ..Numbers::NONE };
        let mut encoder = self.begin(numbers, is_listed_anew, is_fitted);
        let clusters = self.living.len() as u32;
        let items = |part: &Part| if part.items == Items::Clusters { clusters } else { movers };
        let [_, chain] = phase.of_few;
        let is_few = self.connection.has_chains
            && chain.parts.iter().all(|part| items(part) <= self.connection.tuning.chain_items);
        let kernels = if is_few { &phase.of_few } else { phase.kernels };
        self.encode_slots(&mut encoder, phase.name, kernels, 0..iterations);
        self.known.is_fitted = phase.leaves_fitted;
        let batch = self.fetch(encoder, Along { iterations, ..Along::default() })?.batch;
        self.known.listed.get_or_insert(batch[0].listed);
        // the phase has ended where no face was listed
        batch.iter().filter(|stats| stats.listed > 0).for_each(|stats| self.count(kernels, stats));
        Ok(batch)
    }

    /// Counts what kernels did in an iteration.
    fn count(&self, kernels: &[&Kernel], stats: &IterationStats) {
        kernels.iter().for_each(|kernel| self.connection.count(kernel.name, self.memory.work(kernel, stats)));
    }

    /// Grows the clusters over the free faces, all of which are listed. With each batch of passes comes the energy that
    /// holds if it was the last.
    pub(super) fn grow_listed(&mut self, cancel: &Cancel) -> Result<()> {
        let mut iterations = self.connection.tuning.first_batch;
        let mut is_growing = true;
        while is_growing {
            cancel.check()?;
            self.connection.reach(FaultPoint::Grow);
            self.known.invalidate(Change::Moves);
            let numbers = Numbers { iterations, ..Numbers::NONE };
            let mut encoder = self.begin(numbers, false, !self.known.is_fitted);
            let pass = [kernels::GROWTH_PROPOSE, kernels::GROWTH_APPLY];
            self.encode_slots(&mut encoder, "grow", &pass, 0..iterations);
            self.encode(&mut encoder, "fit", &[kernels::PROXIES_FIT], BETWEEN);
            let read = self.fetch(encoder, Along { iterations, moves: true, ..Along::default() })?;
            self.known.energy = Some(read.between.energy());
            read.batch.iter().for_each(|stats| self.count(&pass, stats));
            is_growing = read.batch.iter().all(|pass| pass.moves > 0);
            iterations = (2 * iterations).min(BATCH);
        }
        self.known.has_free = false;
        cancel.check()
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
