//! How a job goes about its mesh: a [`Clustering`] and what the mesh decides.

use super::{Clustering, CoarseSpec, Method};
use crate::cluster::coarse::CoarseStart;
use crate::cluster::seeds::{self, SeedFaces};
use crate::cluster::{flat, hierarchy};
use crate::error::Result;
use crate::surface::Surface;

/// A [`Clustering`] with what the mesh decides: where clusters start, and where a hierarchy ends.
#[derive(Debug)]
pub enum Plan {
    /// Boundary-based clustering, coarse to fine.
    Coarse(Coarse),
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
pub struct Coarse {
    /// Where it starts.
    pub start: CoarseStart,
    /// What follows.
    pub spec: CoarseSpec,
}

impl Coarse {
    /// Builds the start.
    pub(super) fn new(surface: &Surface, spec: CoarseSpec) -> Result<Self> {
        let start = CoarseStart::new(surface, spec.clusters, spec.seed, spec.quality.start())?;
        Ok(Self { start, spec })
    }
}

impl Plan {
    /// Chooses seeds or builds a coarse start. Refuses numbers of clusters that the surface cannot have.
    pub(super) fn new(surface: &Surface, clustering: &Clustering) -> Result<Self> {
        Ok(match clustering {
            Clustering::Coarse(spec) => {
                let quality = spec.quality.on(surface.faces());
                Self::Coarse(Coarse::new(surface, CoarseSpec { quality, ..*spec })?)
            }
            Clustering::Seeded { method, clusters, seeds, seed, listed, options } => {
                Self::Seeded(*method, seeds::choose(surface, *clusters, seeds, *seed, listed.as_deref())?, *options)
            }
            Clustering::Hierarchy(options) => {
                let target = hierarchy::check(surface, options)?;
                Self::Hierarchy { options: options.clone(), target }
            }
        })
    }

    /// Whether the job has labels of its own. A whole hierarchy has some at every number of clusters instead.
    pub fn has_labels(&self) -> bool {
        !matches!(self, Self::Hierarchy { options, .. } if options.clusters.is_none())
    }

    /// Whether each step waits for the one before, so that a gpu is slow at it or cannot do it.
    pub fn is_sequential(&self) -> bool {
        match self {
            Self::Coarse(..) => false,
            Self::Seeded(method, ..) => *method != Method::BoundaryBased,
            Self::Hierarchy { options, .. } => options.sequential_at == u64::MAX,
        }
    }
}
