//! How a job goes about what it clusters: a [`Clustering`] and what the items decide.

use std::sync::{Mutex, PoisonError};

use super::{Clustering, CoarseSpec, InputFile, Method, Refusal};
use crate::cluster::coarse::{CoarseStart, Start};
use crate::cluster::quality::Quality;
use crate::cluster::seeds::{self, SeedFaces};
use crate::cluster::{flat, hierarchy};
use crate::device::{Cancel, Device};
use crate::energy::{Energy, Functional};
use crate::error::{Error, Result};
use crate::surface::Items;

/// A [`Clustering`] with what the items decide: where clusters start, and where a hierarchy ends.
#[derive(Debug)]
pub enum Plan<E: Functional = Energy> {
    /// Boundary-based clustering from many clusters that merge.
    Coarse(Coarse<E>),
    /// A flat clustering from these seeds.
    Seeded(Method, SeedFaces, flat::Options),
    /// A hierarchy.
    Hierarchy {
        /// What to build.
        options: hierarchy::Options,
        /// Number of clusters that it ends with.
        target: u64,
    },
}

/// A boundary-based clustering from many clusters that merge.
#[derive(Debug)]
pub struct Coarse<E: Functional = Energy> {
    /// The coarse start, until a run has taken it; none where single faces or groups of them merge.
    start: Mutex<Option<CoarseStart<E>>>,
    /// What follows.
    pub spec: CoarseSpec,
}

impl<E: Functional> Coarse<E> {
    /// Builds a coarse start. Refuses numbers of clusters that the items cannot have.
    pub(super) fn new(items: &Items<E>, spec: CoarseSpec) -> Result<Self> {
        let start = match spec.is_merged {
            true => seeds::shares(items, spec.clusters).map(|_| None)?,
            false => Some(Self::coarse_start(items, &spec)?),
        };
        Ok(Self { start: Mutex::new(start), spec })
    }

    fn coarse_start(items: &Items<E>, spec: &CoarseSpec) -> Result<CoarseStart<E>> {
        CoarseStart::new(items, spec.clusters, spec.seed, spec.quality.start(items.moves))
    }

    /// Makes the start on a device. The first run takes the coarse start and so frees its graphs; another run, as on
    /// the cpu after an error of the gpu, builds it again.
    pub(super) fn start(&self, items: &Items<E>, device: &mut dyn Device<E>, cancel: &Cancel) -> Result<Start> {
        let prepared = self.start.lock().unwrap_or_else(PoisonError::into_inner).take();
        match prepared {
            Some(start) => start.labels(items, device, cancel),
            None if !self.spec.is_merged => Self::coarse_start(items, &self.spec)?.labels(items, device, cancel),
            None if self.spec.merges_groups(items.faces()) => {
                let improve = self.spec.quality == Quality::Default && self.spec.relocation(items.faces()).is_some();
                Start::from_groups(items, self.spec.clusters, self.spec.pairs(), improve, device, cancel)
            }
            None => Start::merged(items, self.spec.clusters, self.spec.pairs(), device, cancel),
        }
    }
}

impl<E: Functional> Plan<E> {
    /// Number of clusters that a hierarchy ends with.
    pub fn target(&self) -> Option<u64> {
        match self {
            Plan::Hierarchy { target, .. } => Some(*target),
            Plan::Coarse(_) | Plan::Seeded(..) => None,
        }
    }

    /// Chooses seeds or builds a coarse start. Refuses numbers of clusters that the items cannot have.
    pub(super) fn new(items: &Items<E>, clustering: &Clustering) -> Result<Self> {
        Ok(match clustering {
            Clustering::Coarse(spec) => {
                let quality = spec.quality.on(items.faces());
                Self::Coarse(Coarse::new(items, CoarseSpec { quality, ..*spec })?)
            }
            Clustering::Seeded { method, seeds, listed, spec } => {
                let seeds = seeds::choose(items, spec.clusters, seeds, spec.seed, listed.as_deref())?;
                Self::Seeded(*method, seeds, spec.options(items.moves))
            }
            Clustering::Hierarchy(options) => {
                let target = hierarchy::check(items, options)?;
                Self::Hierarchy { options: options.clone(), target }
            }
            Clustering::Shapes(_) => return Err(Error::internal("shapes have no plan")),
        })
    }
}

/// Plans a job, from within the pool, as in [`where_it_works`](super::where_it_works).
pub(super) fn plan<E: Functional>(items: &Items<E>, clustering: &Clustering) -> Result<Plan<E>, Refusal> {
    let file = if clustering.has_listed_seeds() { InputFile::Seeds } else { InputFile::Mesh };
    rayon::scope(|_| Plan::new(items, clustering)).map_err(Refusal::of(file))
}
