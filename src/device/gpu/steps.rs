//! The steps on one surface: each is a list of kernels.

use super::FaultPoint;
use super::batches::{BOUNDARY, REFINEMENT};
use super::buffers::Buffer;
use super::kernels;
use super::layout::{IterationStats, UNLISTED};
use super::memory::{BETWEEN, Numbers};
use super::readback::Along;
use super::state::{Change, GpuSteps, History};
use super::upload::upload;
use super::verify::verify;
use crate::device::{Cancel, Ending, FREE, OnStep, Step, Steps};
use crate::energy::{LatticeEnergy, Words};
use crate::error::{Error, Result};

impl<E: Words> GpuSteps<'_, E> {
    /// Replaces the places of the clusters of all faces; the history stays.
    fn replace_labels(&mut self, labels: &[u32]) -> Result<()> {
        let (from, to) = (self.memory.get(Buffer::Labels), self.memory.get(Buffer::LabelAtMerge));
        upload(&self.connection, from, labels);
        let mut encoder = self.connection.encoder();
        from.copy_to(to, &mut encoder);
        self.connection.submit(Some(encoder));
        self.known.invalidate(Change::Labels);
        self.known.has_free = labels.contains(&FREE);
        self.memory.listed = labels.len() as u32;
        self.is_resumed = false;
        self.connection.check()
    }

    /// Refuses other numbers of labels than of faces.
    fn check_count(&self, labels: &[u32]) -> Result<()> {
        let faces = self.graph.faces();
        if labels.len() == faces {
            return Ok(());
        }
        Err(Error::internal(format_args!("{faces} faces need as many labels: {}", labels.len())))
    }

    /// The place of the cluster of each face. Fails with `DeviceWrong` where the energy of the labels is not the one
    /// that the device gave.
    fn places(&mut self) -> Result<Vec<u32>> {
        if !self.known.has_sums {
            // they are the host's
            return match self.known.labels.take() {
                Some(labels) => Ok(labels),
                None => {
                    self.connection.reach(FaultPoint::Labels);
                    self.download(Buffer::Labels, self.graph.faces())
                }
            };
        }
        if self.known.labels.is_none() || self.known.energy.is_none() {
            let encoder = self.begin(Numbers::NONE, false, self.known.energy.is_none());
            let stats = self.fetch(encoder, Along { labels: true, ..Along::default() })?;
            self.known.energy.get_or_insert(stats.before.energy());
        }
        let labels = self.known.labels.take().unwrap_or_default();
        if let Some(energy) = self.known.energy {
            verify(&self.connection.name, (self.graph, &self.component_of_place), &labels, energy)?;
        }
        Ok(labels)
    }
}

impl<E: Words> Steps for GpuSteps<'_, E> {
    fn set_labels(&mut self, labels: &[u32]) -> Result<()> {
        self.check_count(labels)?;
        self.number_clusters(labels)?;
        let places = self.numbering.to_places(labels)?;
        self.replace_labels(&places)
    }

    fn relabel(&mut self, labels: &[u32]) -> Result<()> {
        self.check_count(labels)?;
        let places = self.numbering.to_places(labels)?;
        let mut at_merge = Vec::new();
        if self.known.history != History::Unmerged {
            let labels = self.places()?;
            at_merge = self.download(Buffer::LabelAtMerge, labels.len())?;
            // a face that is not listed has not moved since
            let unlisted = at_merge.iter_mut().zip(labels).filter(|(before, _)| **before == UNLISTED);
            unlisted.for_each(|(before, label)| *before = label);
        }
        self.replace_labels(&places)?;
        upload(&self.connection, self.memory.get(Buffer::LabelAtMerge), &at_merge);
        self.known.labels = Some(places.into_owned());
        Ok(())
    }

    fn grow(&mut self, cancel: &Cancel) -> Result<()> {
        if self.known.has_free { self.grow_listed(cancel) } else { Ok(()) }
    }

    fn energy(&mut self) -> Result<LatticeEnergy> {
        if let Some(energy) = self.known.energy {
            return Ok(energy);
        }
        // of a round without optimisation: the next round begins with this search
        let search = self.last_search.filter(|_| self.known.history == History::Merged);
        let encoder = self.begin(self.numbers_of(search), search.is_some(), true);
        let energy = self.fetch(encoder, Along { search, ..Along::default() })?.before.energy();
        self.known.energy = Some(energy);
        Ok(energy)
    }

    fn optimise_boundary(&mut self, max_iterations: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        self.run(&BOUNDARY, max_iterations, cancel, |stats, moves| {
            on_step(Step { energy: stats.energy(), moves });
            stats.energy()
        })
    }

    fn refine(&mut self, max_iterations: u32, cancel: &Cancel, on_step: OnStep<'_>) -> Result<Ending> {
        // iterations only report the rise
        let mut energy = self.energy()?;
        self.run(&REFINEMENT, max_iterations, cancel, |stats, moves| {
            energy.explained += stats.explained();
            on_step(Step { energy, moves });
            energy
        })
    }

    fn resume(&mut self) {
        self.is_resumed = true;
    }

    fn repair(&mut self, cancel: &Cancel) -> Result<u64> {
        if !self.known.may_have_pieces {
            return Ok(0);
        }
        self.connection.reach(FaultPoint::Pieces);
        // bids share memory with the sizes of pieces
        self.is_resumed = false;
        // a run without merges is likely to end here, a round of merges is followed by a search
        let is_flat = self.known.history == History::Unmerged;
        let labels = is_flat && self.graph.faces() <= self.connection.tuning.labels_along as usize;
        let search = self.last_search.filter(|_| !is_flat);
        let mut encoder = self.begin(self.numbers_of(search), search.is_some(), false);
        self.memory.get(Buffer::LargestPieces).clear(&mut encoder);
        let pieces = [
            kernels::PIECE_LINK,
            kernels::PIECE_UNION,
            kernels::PIECE_SIZE,
            kernels::PIECE_SELECT_LARGEST,
            kernels::PIECE_DETACH,
        ];
        self.encode(&mut encoder, "pieces", &pieces, BETWEEN);
        self.encode(&mut encoder, "grow", &[kernels::REGROWTH_CHAIN, kernels::PROXIES_FIT], BETWEEN);
        self.known.invalidate(Change::Moves);
        let stats = self.fetch(encoder, Along { moves: true, labels, search, ..Along::default() })?.between;
        let IterationStats { movers: freed, moves: grown, .. } = stats;
        self.known.energy = Some(stats.energy());
        self.known.is_fitted = true;
        self.known.is_repaired |= freed > 0;
        if grown < freed {
            self.known.has_free = true;
            self.grow_listed(cancel)?;
        }
        self.known.may_have_pieces = false;
        Ok(freed.into())
    }

    fn labels(&mut self) -> Result<Vec<u32>> {
        let places = self.places()?;
        Ok(self.numbering.to_labels(places))
    }
}
