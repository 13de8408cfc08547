//! Phases as batches of iterations, queued ahead of the host.
//!
//! Batches of iterations (or passes of the growth) are queued without waiting for each other's results: while the
//! device works on one, the host reads the statistics of the one before. The device itself ends a phase: the kernel
//! that finds an iteration without moves writes zeros into the arguments of the indirect dispatches that follow, also
//! those in the next batch.

use std::mem::{replace, take};
use std::time::{Duration, Instant};

use super::FaultPoint;
use super::buffers::{BATCH, Buffer};
use super::kernels::{self, Kernel};
use super::layout::IterationStats;
use super::readback::Reading;
use super::steps::{GpuSteps, History};
use crate::device::{Cancel, Ending, FLOOD_FROM};
use crate::error::Result;

/// Iterations in the first batch.
const FIRST_BATCH: u32 = 8;

/// A batch that takes less makes the next one larger: queueing should not cost more than the work.
const SHORT_BATCH: Duration = Duration::from_millis(25);

/// A batch that takes longer makes the next one smaller: a job that is cancelled ends after the batches that are
/// queued.
const LONG_BATCH: Duration = Duration::from_millis(100);

/// What an iteration does.
pub(super) struct Phase {
    /// Name of its passes in profiles.
    name: &'static str,
    fault_point: FaultPoint,
    kernels: &'static [&'static Kernel],
    /// The first iteration that is a flood: it takes several passes, each with a number of its own, until one in which
    /// nothing moves.
    flood_from: u32,
    /// Whether an iteration without moves found nothing left to do.
    is_over: fn(&IterationStats) -> bool,
}

pub(super) const GROWTH: Phase = Phase {
    name: "grow",
    fault_point: FaultPoint::Grow,
    kernels: &[kernels::GROWTH_PROPOSE, kernels::GROWTH_APPLY, kernels::GROWTH_CHECK_DONE],
    flood_from: u32::MAX,
    is_over: |_| true,
};

pub(super) const BOUNDARY: Phase = Phase {
    name: "boundary",
    fault_point: FaultPoint::Boundary,
    kernels: &[kernels::BOUNDARY_PROPOSE, kernels::BOUNDARY_APPLY, kernels::PROXIES_FIT],
    flood_from: FLOOD_FROM,
    is_over: |_| true,
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
    flood_from: u32::MAX,
    is_over: |stats| stats.bids == 0,
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
        // iterations that may still move something, those in flight taken off
        let mut left = limit;
        let mut number = first;
        let mut read = first;
        // moves of a flood that goes on
        let mut flooded = 0;
        let mut size = FIRST_BATCH;
        let mut queued: Option<Reading> = None;
        loop {
            let started = Instant::now();
            let iterations = size.min(left);
            let mut next = None;
            if iterations > 0 && !cancel.is_cancelled() {
                next = Some(self.submit(phase, number, iterations)?);
                left -= iterations;
                number = number.wrapping_add(iterations);
            }
            let Some(batch) = replace(&mut queued, next) else {
                if queued.is_none() {
                    cancel.check()?;
                    return Ok((Ending::IterationLimit, number));
                }
                continue;
            };
            for stats in self.read_stats(batch)? {
                let is_flood = read >= phase.flood_from;
                read = read.wrapping_add(1);
                if is_flood && stats.moves > 0 {
                    self.note_moves();
                    flooded += u64::from(stats.moves);
                    left += 1;
                    continue;
                }
                let moves = take(&mut flooded) + u64::from(stats.moves);
                if moves == 0 && (phase.is_over)(&stats) {
                    if let Some(idle) = queued {
                        self.read_stats(idle)?;
                    }
                    cancel.check()?;
                    return Ok((Ending::Converged, number));
                }
                if moves == 0 {
                    left += 1;
                } else {
                    self.note_moves();
                    on_iteration(&stats, moves);
                }
            }
            let took = started.elapsed();
            if took < SHORT_BATCH {
                size = (size * 2).min(BATCH);
            } else if took > LONG_BATCH {
                size = (size / 2).max(2);
            }
        }
    }

    /// Queues a batch, and the reading of its statistics.
    fn submit(&self, phase: &Phase, number: u32, iterations: u32) -> Result<Reading> {
        self.connection.reach(phase.fault_point);
        self.memory.number(&self.connection.queue, number);
        let mut encoder = self.encoder();
        encoder.clear_buffer(self.memory.get(Buffer::Stats), 0, None);
        {
            let mut pass = self.connection.pass(&mut encoder, phase.name);
            let mut dispatch = |kernel: &Kernel, slot| self.memory.dispatch(&self.connection, &mut pass, kernel, slot);
            // after a merge the host may ask for moves, so faces that moved stay listed
            if self.history == History::Unmerged {
                dispatch(kernels::BOUNDARY_COMPACT, 0);
                dispatch(kernels::BOUNDARY_PUBLISH, 0);
            }
            for slot in 0..iterations {
                phase.kernels.iter().for_each(|kernel| dispatch(kernel, slot));
            }
        }
        self.request_stats(encoder, 0..iterations)
    }
}
