//! The steps on one surface, as sequences of kernels.

use super::batches::{BOUNDARY, GROWTH, REFINEMENT};
use super::buffers::Buffer;
use super::state::{GpuSteps, History, Sums};
use super::upload::upload;
use crate::device::{Cancel, Ending, FREE, Step, Steps};
use crate::energy::LatticeEnergy;
use crate::error::{Error, Kind, Result};

impl GpuSteps<'_> {
    /// Replaces all labels; the history stays.
    fn replace_labels(&mut self, labels: &[u32]) -> Result<()> {
        let faces = self.graph.faces();
        if labels.len() != faces {
            let message = format_args!("{faces} faces need as many labels: {}", labels.len());
            return Err(Error::new(Kind::Internal, message));
        }
        self.check_clusters(labels.iter().copied().filter(|&label| label != FREE))?;
        let (from, to) = (self.memory.get(Buffer::Labels), self.memory.get(Buffer::LabelAtMerge));
        upload(&self.connection.queue, from, 0, labels);
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(from, 0, to, 0, None);
        self.connection.queue.submit([encoder.finish()]);
        self.sums = Sums::Stale;
        self.has_free = labels.contains(&FREE);
        self.is_repaired = false;
        self.forget();
        self.note_moves();
        self.connection.check()
    }

    /// Makes clusters ready for a phase: leavers and bids are counted from none.
    fn begin_phase(&mut self) {
        if !self.is_fitted {
            let encoder = self.encode_fit();
            self.connection.queue.submit([encoder.finish()]);
        }
    }

    /// Grows the clusters over the free faces, all of which are listed once `encoder` has run.
    fn grow_listed(&mut self, encoder: wgpu::CommandEncoder, cancel: &Cancel) -> Result<()> {
        self.connection.queue.submit([encoder.finish()]);
        self.run(&GROWTH, (1, u32::MAX), cancel, |_, _| {})?;
        self.has_free = false;
        Ok(())
    }
}

/// Whether a limit is none: that of a run falls from the largest number with each iteration.
fn is_unlimited(max_iterations: u32) -> bool {
    max_iterations > u32::MAX / 2
}

impl Steps for GpuSteps<'_> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        if self.history != History::Unmerged {
            self.history = History::Unmerged;
            self.living = (0..self.clusters()).collect();
            self.memory.list_clusters(&self.connection.queue, &self.living);
        }
        (self.stopped, self.resumed) = (None, None);
        self.replace_labels(labels)
    }

    fn relabel(&mut self, labels: &[u32]) -> Result<()> {
        let mut at_merge = Vec::new();
        if self.history != History::Unmerged {
            let before = self.labels()?;
            at_merge = self.labels_at_merge(&before)?;
        }
        self.replace_labels(labels)?;
        upload(&self.connection.queue, self.memory.get(Buffer::LabelAtMerge), 0, &at_merge);
        self.known_labels = Some(labels.to_vec());
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        if !self.has_free {
            return Ok(());
        }
        let encoder = self.encode_fit();
        self.grow_listed(encoder, cancel)
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        if let Sums::Current(Some(energy)) = self.sums {
            return Ok(energy);
        }
        if let Some(search) = self.last_search.filter(|_| self.history == History::Merged) {
            // of a round without optimisation: the next round begins with this search
            let energy;
            (energy, self.found_ahead) = self.search(search)?;
            return Ok(energy);
        }
        let encoder = self.encode_fit();
        let energy = self.read_between(encoder)?.energy();
        self.set_energy(Some(energy));
        Ok(energy)
    }

    fn optimise_boundary(
        &mut self,
        max_iterations: u32,
        cancel: &Cancel,
        on_iteration: &mut dyn FnMut(Step),
    ) -> Result<Ending> {
        let first = self.resumed.take().unwrap_or(1);
        self.begin_phase();
        self.was_unlimited = is_unlimited(max_iterations);
        let mut last = if let Sums::Current(energy) = self.sums { energy } else { None };
        let outcome = self.run(&BOUNDARY, (first, max_iterations), cancel, |stats, moves| {
            last = Some(stats.energy());
            on_iteration(Step { energy: stats.energy(), moves });
        });
        self.set_energy(last);
        self.is_after_boundary = true;
        let (ending, next) = outcome?;
        self.stopped = (ending == Ending::IterationLimit).then_some(next);
        Ok(ending)
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_iteration: &mut dyn FnMut(Step)) -> Result<Ending> {
        // iterations only report the rise
        let mut explained = self.energy()?.explained;
        let first = self.resumed.take().unwrap_or_else(|| {
            self.begin_phase();
            1
        });
        self.was_unlimited = is_unlimited(max_iterations);
        let outcome = self.run(&REFINEMENT, (first, max_iterations), cancel, |stats, moves| {
            explained += stats.explained();
            on_iteration(Step { energy: LatticeEnergy { explained }, moves });
        });
        self.set_energy(Some(LatticeEnergy { explained }));
        let (ending, next) = outcome?;
        self.stopped = (ending == Ending::IterationLimit).then_some(next);
        Ok(ending)
    }

    fn resume(&mut self) {
        self.resumed = self.stopped.take();
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        if !self.may_have_pieces {
            return Ok(0);
        }
        let freed = self.detach_pieces()?;
        if freed != 0 {
            self.grow_listed(self.encoder(), cancel)?;
        }
        self.may_have_pieces = false;
        Ok(freed)
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        self.read_labels()
    }
}
