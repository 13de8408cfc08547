//! What a person sees while a mesh is clustered: a bar on standard error, drawn on a terminal only.

use std::borrow::Cow;
use std::ops::Range;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use tesserae_mesh::report::{Iteration, Level, Phase, Row};

use super::summary::number;

/// Length of the bar in steps.
const STEPS: u64 = 1000;

/// A bar that goes from the first byte of a mesh to its last output.
pub struct Progress {
    bar: ProgressBar,
    /// Before each message.
    prefix: String,
    /// The part of the bar that the stage has.
    part: Range<f64>,
    max_iterations: Option<u32>,
    most_moves: u64,
    /// Hierarchies: clusters at the start and at the end.
    clusters: Option<(u64, u64)>,
}

impl Progress {
    /// An empty bar, which is not drawn at all if it is `quiet`.
    pub fn new(max_iterations: Option<u32>, quiet: bool) -> Self {
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} [{bar:32}] {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.enable_steady_tick(Duration::from_millis(100));
        Self { bar, prefix: String::new(), part: 0.0..1.0, max_iterations, most_moves: 0, clusters: None }
    }

    /// Begins the bar anew for the mesh of this name; an empty one is not shown.
    pub fn mesh(&mut self, name: &str) {
        self.bar.set_position(0);
        self.prefix = if name.is_empty() { String::new() } else { format!("{name}: ") };
    }

    /// Says what is being done, and which part of the bar that has.
    pub fn stage(&mut self, name: impl Into<Cow<'static, str>>, part: Range<f64>) {
        (self.part, self.most_moves, self.clusters) = (part, 0, None);
        self.advance(0.0);
        self.say(name);
    }

    /// Shows which part of the stage is done. The bar does not go back.
    pub fn advance(&self, fraction: f64) {
        let Range { start, end } = self.part;
        let position = (STEPS as f64 * (start + (end - start) * fraction.clamp(0.0, 1.0))) as u64;
        self.bar.set_position(position.max(self.bar.position()));
    }

    fn say(&self, message: impl Into<Cow<'static, str>>) {
        let message = message.into();
        self.bar.set_message(if self.prefix.is_empty() { message } else { format!("{}{message}", self.prefix).into() });
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
        let energy = energy.map_or_else(String::new, |energy| format!(", energy {}", number(energy)));
        self.say(format!("round {round}, {clusters} clusters{energy}, {moves} moves"));
        let (faces, target) = self.clusters.unwrap_or((1, 1));
        let logarithm = |clusters: u64| (clusters.max(1) as f64).ln();
        let whole = logarithm(faces) - logarithm(target);
        let part = if whole > 0.0 { (logarithm(faces) - logarithm(*clusters)) / whole } else { 1.0 };
        self.advance(part);
    }

    /// Shows an iteration.
    fn iteration(&mut self, row: &Iteration) {
        let phase = match row.phase {
            Phase::Boundary => "boundary",
            Phase::Refine => "refine",
            Phase::Refit => "refit",
            Phase::Merge => "merge",
            Phase::Repair => "repair",
            Phase::Regrow => "regrow",
            Phase::Swap => "swap",
            Phase::MergedStart => "merged start",
            Phase::FastStart => "start of fast",
            Phase::SettledStart => "settled start",
            Phase::OtherJob => "other job",
            Phase::Trial => "trial",
            Phase::Breathe => "breathe",
        };
        let energy = row.energy.map_or_else(String::new, |energy| format!(", energy {}", number(energy)));
        self.say(format!("{phase}, iteration {}{energy}, {} moves", row.iteration, row.moves));
        let fraction = self.fraction(row);
        self.advance(fraction);
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

    /// Takes the bar away while `write` writes to the terminal.
    pub fn pause(&self, write: impl FnOnce()) {
        self.bar.suspend(write);
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
        let mut progress = Progress::new(None, true);
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
    fn each_stage_has_its_part_of_the_bar() {
        let mut progress = Progress::new(None, true);
        progress.mesh("");
        for (part, fraction, position) in
            [(0.0..0.1, 0.5, STEPS / 20), (0.1..0.3, 0.0, STEPS / 10), (0.1..0.3, 1.0, 3 * STEPS / 10)]
        {
            progress.stage("", part);
            progress.advance(fraction);
            assert!(progress.bar.position().abs_diff(position) <= 1, "{fraction}");
        }
        progress.advance(0.0);
        assert!(progress.bar.position() >= 3 * STEPS / 10 - 1);
        progress.mesh("the next");
        assert_eq!(progress.bar.position(), 0);
    }

    #[test]
    fn rounds_go_from_the_faces_to_the_target() {
        let mut progress = Progress::new(None, true);
        progress.hierarchy(1000, 10);
        for (clusters, position) in [(1000, 0), (100, STEPS / 2), (10, STEPS)] {
            let row = Level { round: 1, clusters, energy: Some(1.0), merges: 1, moves: 0 };
            progress.row(&Row::Round(row));
            assert!(progress.bar.position().abs_diff(position) <= 1, "{clusters}");
        }
    }
}
