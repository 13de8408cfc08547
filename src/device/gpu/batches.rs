//! Phases as batches of iterations, queued ahead of the host.
//!
//! Batches of iterations (or passes of the growth) are queued without waiting for each other's results: while the
//! device works on one, the host reads the statistics of the one before. The device itself ends a phase: the kernel
//! that finds an iteration without moves writes zeros into the arguments of the indirect dispatches that follow, also
//! those in the next batch.

use std::time::{Duration, Instant};

use super::FaultPoint;
use super::buffers::{BATCH, Buffer};
use super::kernels::{self, Kernel};
use super::layout::IterationStats;
use super::readback::Batch;
use super::steps::{GpuSteps, History};
use crate::device::{Cancel, Ending};
use crate::error::Result;

/// Iterations in the first batch.
const FIRST_BATCH: u32 = 8;

/// Passes in the first batch of a growth over detached pieces, which few passes fill.
const FIRST_REGROWTH: u32 = 2;

/// A batch that takes less makes the next one larger: queueing should not cost more than the work.
const SHORT_BATCH: Duration = Duration::from_millis(25);

/// A batch that takes longer makes the next one smaller: a job that is cancelled ends after the batches that are
/// queued.
const LONG_BATCH: Duration = Duration::from_millis(100);

/// What an iteration does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    Growth,
    Regrowth,
    Boundary,
    Refinement,
}

impl Phase {
    /// Whether an iteration found nothing left to do.
    fn is_over(self, stats: &IterationStats) -> bool {
        match self {
            Phase::Growth | Phase::Regrowth | Phase::Boundary => stats.moves == 0,
            Phase::Refinement => stats.bids == 0,
        }
    }

    /// The kernels of an iteration.
    fn kernels(self) -> &'static [&'static Kernel] {
        match self {
            Phase::Growth | Phase::Regrowth => {
                &[kernels::GROWTH_PROPOSE, kernels::GROWTH_APPLY, kernels::GROWTH_CHECK_DONE]
            }
            Phase::Boundary => &[kernels::BOUNDARY_PROPOSE, kernels::BOUNDARY_APPLY, kernels::PROXIES_FIT],
            Phase::Refinement => &[
                kernels::FACE_BID,
                kernels::SELECT_BIDS,
                kernels::JOIN_MOVES,
                kernels::EVALUATE_MOVES,
                kernels::COMMIT_MOVES,
            ],
        }
    }

    /// Name of its passes in profiles.
    fn name(self) -> &'static str {
        match self {
            Phase::Growth | Phase::Regrowth => "grow",
            Phase::Boundary => "boundary",
            Phase::Refinement => "refine",
        }
    }

    fn fault_point(self) -> FaultPoint {
        match self {
            Phase::Growth | Phase::Regrowth => FaultPoint::Grow,
            Phase::Boundary => FaultPoint::Boundary,
            Phase::Refinement => FaultPoint::Refine,
        }
    }
}

impl GpuSteps<'_> {
    /// Runs iterations, numbered from `first`, until one has nothing left to do or `limit` of them moved something.
    /// Calls `on_iteration` with each that did, in order. Also returns the number of the next iteration.
    pub(super) fn run(
        &mut self,
        phase: Phase,
        (first, limit): (u32, u32),
        cancel: &Cancel,
        mut on_iteration: impl FnMut(&IterationStats),
    ) -> Result<(Ending, u32)> {
        // iterations that may still move something, those in flight taken off
        let mut left = limit;
        let mut number = first;
        let mut size = if phase == Phase::Regrowth { FIRST_REGROWTH } else { FIRST_BATCH };
        let mut staging = 0;
        let mut before: Option<Batch> = None;
        loop {
            let started = Instant::now();
            let iterations = size.min(left);
            let next = if iterations > 0 && !cancel.is_cancelled() {
                let batch = self.submit(phase, number, iterations, staging)?;
                left -= iterations;
                number = number.wrapping_add(iterations);
                Some(batch)
            } else {
                None
            };
            let Some(batch) = before.take() else {
                if next.is_none() {
                    cancel.check()?;
                    return Ok((Ending::IterationLimit, number));
                }
                before = next;
                staging = 1 - staging;
                continue;
            };
            for stats in self.collect(batch)? {
                if phase.is_over(&stats) {
                    if let Some(idle) = next {
                        self.collect(idle)?;
                    }
                    cancel.check()?;
                    return Ok((Ending::Converged, number));
                }
                if stats.moves == 0 {
                    left += 1;
                } else {
                    self.note_moves();
                    on_iteration(&stats);
                }
            }
            let took = started.elapsed();
            if took < SHORT_BATCH {
                size = (size * 2).min(BATCH);
            } else if took > LONG_BATCH {
                size = (size / 2).max(2);
            }
            before = next;
            staging = 1 - staging;
        }
    }

    /// Queues a batch, and the reading of its statistics.
    fn submit(&self, phase: Phase, number: u32, iterations: u32, staging: usize) -> Result<Batch> {
        self.connection.reach(phase.fault_point());
        self.memory.number(&self.connection.queue, number);
        let mut encoder = self.encoder();
        encoder.clear_buffer(self.memory.get(Buffer::Stats), 0, None);
        {
            let mut pass = self.connection.pass(&mut encoder, phase.name());
            let mut dispatch = |kernel: &Kernel, slot| self.memory.dispatch(&self.connection, &mut pass, kernel, slot);
            // after a merge the host may ask for moves, so faces that moved stay listed
            if self.history == History::Unmerged {
                dispatch(kernels::BOUNDARY_COMPACT, 0);
                dispatch(kernels::BOUNDARY_PUBLISH, 0);
            }
            for slot in 0..iterations {
                for kernel in phase.kernels() {
                    dispatch(kernel, slot);
                }
            }
        }
        self.queue_reading(encoder, iterations, staging)
    }
}
