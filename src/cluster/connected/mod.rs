//! How a run ends with connected clusters: free phases, repairs, connected refinement.
//!
//! Moves at the same time can cut a cluster in two. When the phases have converged, a repair frees all but the largest
//! piece of each cluster, and growth hands the freed faces to their neighbours: what grew from connected pieces is
//! connected. A repair may raise F, and is its own row in the report. Then the phases begin anew, unless one of them
//! has flooded (`docs/constants.md` has what one repair costs).
//!
//! Where a piece lowers F in the cluster that it was cut from, phases and repairs would repeat without end. So after
//! [`REPAIRS`] of them faces move one after the other, each only where F falls and its cluster stays connected
//! ([`mod@settle`] has the definition). That includes the moves of the boundary phase: a face that is nearer to another
//! proxy has a positive gain.
//!
//! Where [`Moves`] are connected, that is all there is, from the start: no free phase. Labels that come in pieces, as
//! teleports and references make them, are repaired before or after.

mod clusters;
mod connection;
mod lists;
pub mod settle;
mod totals;

pub use self::clusters::Clusters;
pub use self::connection::Connection;
use super::run::{Phase, Run};
use crate::device::{Ending, FLOOD_FROM, Step};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::{DualGraph, Moves};

/// Repairs at most.
const REPAIRS: u32 = 3;

impl Run<'_> {
    /// Optimises; then makes clusters connected and keeps them so, unless they may be disconnected. `graph` is the one
    /// that the steps were opened with.
    pub fn complete<E: Functional>(
        &mut self,
        graph: &DualGraph<E>,
        allow_disconnected: bool,
        mut optimise: impl FnMut(&mut Self) -> Result<Ending>,
    ) -> Result<Ending> {
        if graph.moves == Moves::Connected {
            self.repair()?;
            let ending = optimise(self)?;
            return if self.repair()? { self.settle(graph) } else { Ok(ending) };
        }
        for _ in 0..REPAIRS {
            let before = self.iteration;
            let ending = optimise(self)?;
            let has_flooded = self.iteration - before >= FLOOD_FROM;
            if allow_disconnected || !self.repair()? || ending == Ending::IterationLimit {
                return Ok(ending);
            }
            if has_flooded {
                break;
            }
        }
        self.settle(graph)
    }

    /// Moves faces one after the other, and keeps clusters connected, until none moves.
    pub(super) fn settle<E: Functional>(&mut self, graph: &DualGraph<E>) -> Result<Ending> {
        let mut clusters = Clusters::new(graph, self.steps.labels()?);
        let mut changed: Vec<u32> = clusters.numbers().collect();
        self.phase(Phase::Refine, |steps, left, cancel, on_step| {
            let mut left = left;
            while left > 0 && !changed.is_empty() {
                cancel.check()?;
                changed = settle::pass(&mut clusters, &changed);
                let moves = clusters.take_moves();
                if moves > 0 {
                    left -= 1;
                    on_step(Step { energy: clusters.energy(), moves });
                }
            }
            steps.relabel(clusters.labels())?;
            Ok(if changed.is_empty() { clusters.ending() } else { Ending::IterationLimit })
        })
    }
}
