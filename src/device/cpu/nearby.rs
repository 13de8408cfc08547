//! The clusters near a face, and the bound that skips its evaluation.
//!
//! A face decides by its distances to the proxies of its own cluster and of its neighbours' clusters. Its *slack* is by
//! how much those distances may change, together, before it could decide otherwise. By the triangle inequality they
//! change by no more than the proxies drift, so the decision holds until the drifts of all these clusters add up to
//! more than the slack, which [`crate::energy`] computes. Elkan 2003 and Hamerly 2010 skip distances of k-means in the
//! same way.
//!
//! # Faces that see many clusters
//!
//! A face with thousands of neighbours, as the base of a cone is one, must not be evaluated whenever one of them moves.
//! A cluster beside such a face that has changed is compared with the face's own alone ([`Rival`]), and the decision
//! holds if the face still prefers its own, and has its own limit for the drift of its own proxy: the other clusters
//! have not changed, so that their slacks hold. So all that have changed must be compared, also those that have drifted
//! by less than the slack.

use std::hint::select_unpredictable;

use super::Partition;
use super::clusters::{CachedProxy, DRIFT_STEP, slot};
use super::labels::Labels;
use crate::energy::Functional;
use crate::surface::DualGraph;

/// In place of the first other cluster: there are more than two. No slot has this number. In place of the second is
/// then how far the face's own proxy may have drifted, if those of the others have not; 0 if the decision does not hold
/// when any of these clusters changes.
pub const MANY: u32 = u32::MAX;

/// No cluster: the slot of a proxy that never drifts.
const NO_SLOT: u32 = 0;

/// The clusters that a face sees, by their slots ([`slot`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NearClusters {
    pub own: u32,
    /// Those of neighbours: none are [`NO_SLOT`], more than two begin with [`MANY`].
    pub others: [u32; 2],
}

/// Until when the decision of a face holds: until the proxies of the clusters near it have together drifted further
/// than `limit`, in steps of [`DRIFT_STEP`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bound {
    pub near: NearClusters,
    pub limit: u64,
}

/// How a face that stays in its cluster sees one other cluster: None where it may want to go there, else by how much
/// the distances to both may change before it could.
pub type Rival = Option<u64>;

impl NearClusters {
    /// Whether there is no other cluster: the face is not on a boundary.
    #[inline]
    pub fn is_interior(self) -> bool {
        self.others[0] == NO_SLOT
    }

    /// Whether the face sees more than two other clusters, which are not listed.
    #[inline]
    pub fn are_many(self) -> bool {
        self.others[0] == MANY
    }

    /// Whether a cluster is among the others that are listed.
    #[inline]
    pub fn lists(self, cluster: u32) -> bool {
        (self.others[0] == slot(cluster)) | (self.others[1] == slot(cluster))
    }

    /// How far the proxies of these clusters have drifted, added up.
    #[inline]
    pub fn drift<E: Functional>(self, partition: &Partition<'_, E>, face: u32) -> u64 {
        match self.others {
            [MANY, _] => drift_of_many(partition, face, self.own - 1),
            [first, second] => {
                [self.own, first, second].map(|slot| partition.clusters.at_slot(slot).drift).iter().sum()
            }
        }
    }
}

impl Bound {
    /// The limit of an active face, which has to be evaluated: less than any drift.
    pub const ACTIVE: u64 = 1;

    /// Looks at the neighbours of a face of cluster `own`. Calls `visit` with each other cluster among theirs; with
    /// some maybe several times where there are more than two. The limit is how far the proxies of all these clusters
    /// have drifted until now.
    #[inline]
    pub fn of<E: Functional>(
        partition: &Partition<'_, E>,
        face: u32,
        own: u32,
        mut visit: impl FnMut(u32, &CachedProxy<E>),
    ) -> Self {
        let Partition { graph, labels, clusters, .. } = partition;
        let mut others = [NO_SLOT; 2];
        let mut are_many = false;
        // which neighbours are in other clusters follows no pattern, so that a branch on it would be mispredicted
        for &near in graph.neighbours_of(face) {
            let next = slot(labels.near_boundary(near));
            let is_new = (next != slot(own)) & (next != others[0]) & (next != others[1]);
            are_many |= is_new & (others[1] != NO_SLOT);
            others =
                [select_unpredictable(is_new, next, others[0]), select_unpredictable(is_new, others[0], others[1])];
        }
        if are_many {
            other_clusters(graph, labels, face, own).for_each(|other| visit(other, clusters.cached(other)));
            let near = NearClusters { own: slot(own), others: [MANY, saturated(clusters.cached(own).drift)] };
            return Self { near, limit: drift_of_many(partition, face, own) };
        }
        let mut drift = clusters.cached(own).drift;
        for other in others.into_iter().take_while(|&other| other != NO_SLOT) {
            let cached = clusters.at_slot(other);
            visit(other - 1, cached);
            drift += cached.drift;
        }
        Self { near: NearClusters { own: slot(own), others }, limit: drift }
    }

    /// The bound of a decision to stay that holds while the distances change by no more than `slack`, in lattice units.
    /// With 0 it holds until one of the clusters changes.
    #[inline]
    pub fn with_slack(mut self, slack: u64) -> Self {
        self.limit = if self.near.is_interior() { u64::MAX } else { self.limit + slack / DRIFT_STEP };
        if let [MANY, own_limit] = &mut self.near.others {
            *own_limit = own_limit.saturating_add(saturated(slack / DRIFT_STEP));
        }
        self
    }

    /// The bound of any decision: it holds until one of the clusters changes.
    pub fn until_a_change(mut self) -> Self {
        if let [MANY, own_limit] = &mut self.near.others {
            *own_limit = 0;
        }
        self
    }
}

/// A drift in 32 bits; a larger one is lowered, so that a limit is exceeded too early and never too late.
pub fn saturated(drift: u64) -> u32 {
    u32::try_from(drift).unwrap_or(u32::MAX)
}

/// The clusters of a face's neighbours other than `own`; one maybe several times. The labels need not be up to date.
pub fn other_clusters<'a, E: Functional>(
    graph: &'a DualGraph<E>,
    labels: &'a Labels,
    face: u32,
    own: u32,
) -> impl Iterator<Item = u32> + 'a {
    let mut last = own;
    graph.neighbours_of(face).iter().map(|&near| labels.of(near)).filter(move |&other| {
        let is_other = other != own && other != last;
        if is_other {
            last = other;
        }
        is_other
    })
}

/// How far the proxies of `own` and of the [`other_clusters`] of a face have drifted, added up.
#[cold]
fn drift_of_many<E: Functional>(
    Partition { graph, labels, clusters, .. }: &Partition<'_, E>,
    face: u32,
    own: u32,
) -> u64 {
    let others = other_clusters(graph, labels, face, own).map(|other| clusters.cached(other).drift);
    clusters.cached(own).drift + others.sum::<u64>()
}
