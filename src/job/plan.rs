//! How a job goes about what it clusters: a [`Clustering`] and what the items decide.

use super::{Clustering, CoarseSpec, Method};
use crate::cluster::coarse::CoarseStart;
use crate::cluster::seeds::{self, SeedFaces};
use crate::cluster::{flat, hierarchy};
use crate::energy::{Energy, Functional};
use crate::error::Result;
use crate::surface::Items;

/// A [`Clustering`] with what the items decide: where clusters start, and where a hierarchy ends.
#[derive(Debug)]
pub enum Plan<E: Functional = Energy> {
    /// Boundary-based clustering, coarse to fine.
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

/// A boundary-based clustering, coarse to fine.
#[derive(Debug)]
pub struct Coarse<E: Functional = Energy> {
    /// Where it starts.
    pub start: CoarseStart<E>,
    /// What follows.
    pub spec: CoarseSpec,
}

impl<E: Functional> Coarse<E> {
    /// Builds the start.
    pub(super) fn new(items: &Items<E>, spec: CoarseSpec) -> Result<Self> {
        let start = CoarseStart::new(items, spec.clusters, spec.seed, spec.quality.start())?;
        Ok(Self { start, spec })
    }
}

impl<E: Functional> Plan<E> {
    /// Chooses seeds or builds a coarse start. Refuses numbers of clusters that the items cannot have.
    pub(super) fn new(items: &Items<E>, clustering: &Clustering) -> Result<Self> {
        Ok(match clustering {
            Clustering::Coarse(spec) => {
                let quality = spec.quality.on(items.faces());
                Self::Coarse(Coarse::new(items, CoarseSpec { quality, ..*spec })?)
            }
            Clustering::Seeded { method, clusters, seeds, seed, listed, options } => {
                Self::Seeded(*method, seeds::choose(items, *clusters, seeds, *seed, listed.as_deref())?, *options)
            }
            Clustering::Hierarchy(options) => {
                let target = hierarchy::check(items, options)?;
                Self::Hierarchy { options: options.clone(), target }
            }
        })
    }
}
