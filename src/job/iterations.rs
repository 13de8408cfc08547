//! The rows of iterations in a report: each of the first, and enough of the later ones.
//!
//! A run of a hundred thousand iterations would make a report of megabytes. From the 10,000th row on, the iterations of
//! a phase share a row while they are less than a thousandth of all so far: it has the number, the energy and the time
//! of the last of them, and the moves of all. So there are some 7,000 more rows up to ten million iterations, the last
//! iteration of every phase has its own numbers, and moves add up. The event stream has every iteration.

use crate::report::Iteration;

/// Rows that are iterations of their own.
const EVERY_ITERATION_UP_TO: usize = 10_000;

/// From then on, a row has iterations that are less than this part of all so far.
const PART: u32 = 1000;

/// The rows of a report.
#[derive(Debug, Default)]
pub(super) struct Iterations {
    /// In order.
    pub(super) rows: Vec<Iteration>,
    /// The first iteration that does not share the last row.
    next: u32,
}

impl Iterations {
    /// Adds an iteration.
    pub(super) fn add(&mut self, row: Iteration) {
        let may_share = self.rows.len() > EVERY_ITERATION_UP_TO && row.iteration < self.next;
        match self.rows.last_mut().filter(|last| may_share && (last.phase, last.round) == (row.phase, row.round)) {
            Some(last) => *last = Iteration { moves: last.moves + row.moves, ..row },
            None => {
                self.next = row.iteration.saturating_add(row.iteration / PART);
                self.rows.push(row);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Phase;

    fn row(iteration: u32, phase: Phase) -> Iteration {
        let (energy, elapsed_us) = (Some(f64::from(iteration)), u64::from(iteration));
        Iteration { iteration, phase, round: None, energy, moves: 2, elapsed_us }
    }

    #[test]
    fn few_rows_tell_of_many_iterations_and_no_move_is_lost() {
        let mut iterations = Iterations::default();
        let last = 1_000_000;
        for iteration in 0..=last {
            let phase = if iteration < 500_000 { Phase::Boundary } else { Phase::Refine };
            iterations.add(row(iteration, phase));
        }
        let rows = &iterations.rows;
        assert!((10_100..15_000).contains(&rows.len()), "{} rows", rows.len());
        assert!((0..10_000).all(|at| rows[at] == row(at as u32, Phase::Boundary)), "the first share no row");
        assert!(rows.is_sorted_by(|a, b| a.iteration < b.iteration));
        let boundary = rows.iter().rfind(|row| row.phase == Phase::Boundary).expect("there are some");
        let ends = [boundary, rows.last().expect("there are some")].map(|row| (row.iteration, row.energy));
        assert_eq!(ends, [(499_999, Some(499_999.0)), (last, Some(f64::from(last)))]);
        assert_eq!(rows.iter().map(|row| row.moves).sum::<u64>(), 2 * (u64::from(last) + 1));
    }
}
