//! What a person sees while a mesh is clustered: a bar on standard error, drawn on a terminal only.

use std::borrow::Cow;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::report::{Iteration, Level, Phase, Row};

/// Length of the bar in steps.
const STEPS: u64 = 1000;

/// A bar that goes from the first iteration to the expected last.
pub struct Progress {
    bar: ProgressBar,
    max_iterations: Option<u32>,
    most_moves: u64,
    /// Hierarchies: clusters at the start and at the end.
    clusters: Option<(u64, u64)>,
}

impl Progress {
    /// An empty bar.
    pub fn new(max_iterations: Option<u32>) -> Self {
        let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} [{bar:32}] {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.enable_steady_tick(Duration::from_millis(100));
        Self { bar, max_iterations, most_moves: 0, clusters: None }
    }

    /// Says what is being done.
    pub fn stage(&self, name: impl Into<Cow<'static, str>>) {
        self.bar.set_message(name);
    }

    /// From here on it is about a hierarchy that ends at `target` clusters.
    pub fn hierarchy(&mut self, faces: u64, target: u64) {
        self.clusters = Some((faces, target));
    }

    /// Shows a row of the report.
    pub fn row(&mut self, row: &Row) {
        match row {
            // the rounds tell more
            Row::Iteration(_) if self.clusters.is_some() => {}
            Row::Iteration(row) => self.iteration(row),
            Row::Round(row) => self.round(row),
        }
    }

    /// Shows a round: every one leaves about the same part of the clusters.
    fn round(&mut self, row: &Level) {
        let Level { round, clusters, energy, moves, .. } = row;
        let energy = energy.map_or_else(String::new, |energy| format!(", energy {energy:.6e}"));
        self.bar.set_message(format!("round {round}, {clusters} clusters{energy}, {moves} moves"));
        let (faces, target) = self.clusters.unwrap_or((1, 1));
        let logarithm = |clusters: u64| (clusters.max(1) as f64).ln();
        let whole = logarithm(faces) - logarithm(target);
        let part = if whole > 0.0 { (logarithm(faces) - logarithm(*clusters)) / whole } else { 1.0 };
        self.bar.set_position((STEPS as f64 * part.clamp(0.0, 1.0)) as u64);
    }

    /// Shows an iteration.
    fn iteration(&mut self, row: &Iteration) {
        let phase = match row.phase {
            Phase::Boundary => "boundary",
            Phase::Refine => "refine",
            Phase::Repair => "repair",
            Phase::Regrow => "regrow",
            Phase::Swap => "swap",
            Phase::Restart => "restart",
            Phase::Trial => "trial",
            Phase::Breathe => "breathe",
        };
        let energy = row.energy.map_or_else(String::new, |energy| format!(", energy {energy:.6e}"));
        self.bar.set_message(format!("{phase}, iteration {}{energy}, {} moves", row.iteration, row.moves));
        let position = (STEPS as f64 * self.fraction(row)) as u64;
        self.bar.set_position(position.max(self.bar.position()));
    }

    /// How far the work is, as far as one can tell: moves die away about exponentially.
    fn fraction(&mut self, row: &Iteration) -> f64 {
        self.most_moves = self.most_moves.max(row.moves);
        if self.most_moves == 0 {
            return 0.0;
        }
        let logarithm = |moves: u64| ((moves + 1) as f64).ln();
        let settled = 1.0 - logarithm(row.moves) / logarithm(self.most_moves);
        let counted = self.max_iterations.map_or(0.0, |most| f64::from(row.iteration) / f64::from(most.max(1)));
        settled.max(counted).clamp(0.0, 1.0)
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_goes_forward_only_and_reaches_the_end() {
        let row = |iteration, moves| Iteration {
            iteration,
            phase: Phase::Boundary,
            round: None,
            energy: None,
            moves,
            elapsed_us: 0,
        };
        let mut progress = Progress::new(None);
        let mut last = 0;
        for (iteration, moves) in [(0, 0), (1, 1000), (2, 300), (3, 400), (4, 10), (5, 0)] {
            progress.iteration(&row(iteration, moves));
            assert!(progress.bar.position() >= last);
            last = progress.bar.position();
            if moves > 100 {
                assert!(last < STEPS / 2);
            }
        }
        assert_eq!(last, STEPS);
    }

    #[test]
    fn rounds_go_from_the_faces_to_the_target() {
        let mut progress = Progress::new(None);
        progress.hierarchy(1000, 10);
        for (clusters, position) in [(1000, 0), (100, STEPS / 2), (10, STEPS)] {
            let row = Level { round: 1, clusters, energy: Some(1.0), merges: 1, moves: 0 };
            progress.row(&Row::Round(row));
            assert!(progress.bar.position().abs_diff(position) <= 1, "{clusters}");
        }
    }
}
