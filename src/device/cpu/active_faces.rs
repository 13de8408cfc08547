//! Active faces: those whose decision may have changed since they were last evaluated.
//!
//! A phase evaluates only active faces; every other face would decide as it did before ([`super::nearby`] has the bound
//! and why it is exact). So labels equal those of an iteration over all faces. A face becomes active when its bound is
//! exceeded, when it moves, and when a neighbour moves to a cluster that its bound does not cover. A face that sees
//! many clusters becomes active when one of those that have changed may attract it.
//!
//! The last result of an inactive face stays valid. A caller that keeps results, as refinement keeps bids, must [`add`]
//! faces again when their clusters change, because a face that has come to lie inside its cluster has no bound to
//! exceed.
//!
//! [`add`]: ActiveFaces::add

use super::Partition;
use super::clusters::{DRIFT_STEP, slot};
use super::labels::Labels;
use super::nearby::{Bound, Rival};
use super::tuning::chunks::{CLUSTERS, ITEMS};
use super::tuning::face_set::FaceSet;
use super::tuning::stored_bound::StoredBound;
use crate::energy::{Functional, Sums};
use crate::parallel;
use crate::prefetch::{Ahead, prefetch, with_lookahead};
use crate::surface::DualGraph;

/// Cost of a face that is reached through the boundary of a changed cluster, in faces that are reached in the order of
/// memory.
const SCATTERED: usize = 4;

/// The active faces of a phase.
#[derive(Debug)]
pub struct ActiveFaces {
    /// Faces that may lie on a boundary. Others are inactive until they are [added](Self::add).
    candidates: FaceSet,
    /// Number of candidates when they were last counted.
    candidate_count: usize,
    bounds: Vec<StoredBound>,
    /// Active faces, each once.
    queue: Vec<u32>,
    /// Faces that see many clusters, each with a cluster that one of its neighbours has moved to.
    arrivals: Vec<(u32, u32)>,
}

impl ActiveFaces {
    /// All boundary faces are active.
    pub fn new<E: Functional>(Partition { graph, boundary, .. }: &Partition<'_, E>) -> Self {
        let faces = graph.faces();
        let mut candidates = FaceSet::new(faces);
        boundary.all().for_each(|face| candidates.insert(face));
        let bounds = std::iter::repeat_with(StoredBound::active).take(faces).collect();
        Self { candidates, candidate_count: 0, bounds, queue: Vec::new(), arrivals: Vec::new() }
    }

    /// Requests the bound of a face.
    #[inline]
    pub fn prefetch(&self, face: u32) {
        prefetch(&self.bounds, face as usize);
    }

    /// Makes a face active.
    pub fn add(&mut self, face: u32) {
        if self.bounds[face as usize].queue() {
            self.candidates.insert(face);
            self.queue.push(face);
        }
    }

    /// A face has moved, or its cluster was merged into another; `labels` already have its new cluster. Active are the
    /// face, and the neighbours whose bound does not cover that cluster. A bound that covers the cluster that ended is
    /// exceeded: its drift is [far](super::clusters::Clusters::merge).
    pub fn moved<E: Functional>(&mut self, graph: &DualGraph<E>, labels: &Labels, face: u32) {
        self.add(face);
        let cluster = labels.near_boundary(face);
        for &near in graph.neighbours_of(face) {
            let bound = self.bounds[near as usize].near();
            if bound.are_many() {
                self.arrived(near, cluster);
            } else if !(bound.lists(cluster) | (labels.near_boundary(near) == cluster)) {
                self.add(near);
            }
        }
    }

    /// Notes that a cluster lies beside a face that sees many.
    fn arrived(&mut self, face: u32, cluster: u32) {
        self.arrivals.push((face, cluster));
        // a phase that is not used does not collect them
        if self.arrivals.len() > self.bounds.len() {
            std::mem::take(&mut self.arrivals).into_iter().for_each(|(face, _)| self.add(face));
        }
    }

    /// Makes the faces active whose bound is exceeded, given the clusters whose proxies have changed since the last
    /// call. `rival` is how a face sees a cluster. Then brings the labels of all active faces and of their neighbours
    /// up to date.
    pub fn collect<E: Functional>(
        &mut self,
        partition: &mut Partition<'_, E>,
        changed: &[u32],
        rival: impl Fn(&Partition<'_, E>, u32, u32) -> Rival + Sync,
    ) {
        let view = &*partition;
        let rival = |face: u32, cluster: u32| rival(view, face, cluster);
        for (face, cluster) in std::mem::take(&mut self.arrivals) {
            // a face that was moved is in the queue, and its label may be that of a cluster that has ended
            if !self.bounds[face as usize].is_queued() && may_be_attracted(view, &self.bounds, rival, face, cluster) {
                self.add(face);
            }
        }
        let Self { candidates, candidate_count, bounds, queue, .. } = self;
        let listed: usize = changed.iter().map(|&cluster| view.boundary.listed(cluster)).sum();
        if SCATTERED * (listed + queue.len()) < *candidate_count {
            let around = |range| exceeded_around(view, &changed[range], bounds, rival);
            let exceeded = parallel::ranges(changed.len(), CLUSTERS, &around);
            for face in exceeded.into_iter().flatten() {
                if bounds[face as usize].queue() {
                    queue.push(face);
                }
            }
        } else {
            // faces in the queue are candidates, and their bounds are exceeded
            (*queue, *candidate_count) = candidates.filter(bounds, |face, bound| {
                if bound.near().are_many() && bound.own_limit() > 0 {
                    bound.is_queued() || may_be_attracted_by_any(view, bounds, rival, face, changed)
                } else {
                    is_exceeded(view, face, bound)
                }
            });
        }
        partition.labels.refresh_around(partition.graph, &self.queue);
    }

    /// Evaluates all active faces: what each decides, if the phase needs that, and its bound. Returns the decisions.
    /// Faces whose bound allows it become inactive.
    pub fn evaluate<T: Send, E: Functional>(
        &mut self,
        partition: &Partition<'_, E>,
        decide: impl Fn(u32) -> (Option<T>, Bound) + Sync,
    ) -> Vec<T> {
        let Self { candidates, bounds, queue, .. } = self;
        let outgrows_caches = partition.graph.outgrows_caches();
        let decisions = parallel::list(queue.len(), ITEMS, &|range, decisions| {
            for (&face, ahead) in with_lookahead(&queue[range]) {
                if outgrows_caches {
                    prefetch_ahead(partition, bounds, ahead);
                }
                let (decision, bound) = decide(face);
                bounds[face as usize].store(bound);
                if bound.near.is_interior() {
                    candidates.remove(face);
                }
                decisions.extend(decision);
            }
        });
        queue.clear();
        decisions
    }
}

/// Whether the clusters near a face have drifted beyond its bound.
#[inline]
fn is_exceeded<E: Functional>(partition: &Partition<'_, E>, face: u32, bound: &StoredBound) -> bool {
    bound.limit() < bound.near().drift(partition, face)
}

/// Requests what the evaluation of later faces reads.
#[inline]
fn prefetch_ahead<E: Functional>(
    Partition { graph, labels, .. }: &Partition<'_, E>,
    bounds: &[StoredBound],
    ahead: Ahead<'_, u32>,
) {
    if let Some(&later) = ahead.stage(4) {
        graph.prefetch(later);
        prefetch(bounds, later as usize);
    }
    if let Some(&later) = ahead.stage(2) {
        graph.prefetch_neighbours(later);
    }
    if let Some(&later) = ahead.stage(1) {
        graph.neighbours_of(later).iter().for_each(|&near| labels.prefetch(near));
    }
}

/// Whether a face that sees many clusters may want to go to one of them that has changed or has come to lie beside it,
/// or its own proxy has drifted too far. If not, its bound covers that cluster.
fn may_be_attracted<E: Functional>(
    Partition { labels, clusters, .. }: &Partition<'_, E>,
    bounds: &[StoredBound],
    rival: impl Fn(u32, u32) -> Rival,
    face: u32,
    cluster: u32,
) -> bool {
    // a face that lies inside its cluster now may have the label of one that has ended
    let (bound, own) = (&bounds[face as usize], labels.of(face));
    let drift = clusters.cached(own).drift;
    if bound.near().own != slot(own) || bound.own_limit() < drift {
        return true;
    }
    if own != cluster {
        match rival(face, cluster) {
            Some(slack) => bound.lower_own_limit(drift + slack / DRIFT_STEP),
            None => return true,
        }
    }
    false
}

/// The same for all clusters that have changed. The face has no bid and was not refused, so that an evaluation in vain
/// changes nothing. A face with no more neighbours than changed clusters is evaluated at once.
#[cold]
fn may_be_attracted_by_any<E: Functional>(
    partition: &Partition<'_, E>,
    bounds: &[StoredBound],
    rival: impl Fn(u32, u32) -> Rival,
    face: u32,
    changed: &[u32],
) -> bool {
    let Partition { graph, labels, clusters, .. } = partition;
    let living = changed.iter().copied().filter(|&cluster| clusters.sums(cluster).faces() > 0);
    graph.neighbours_of(face).len() <= changed.len()
        || living.chain([labels.of(face)]).any(|cluster| may_be_attracted(partition, bounds, &rival, face, cluster))
}

/// The boundary faces of some clusters, and their neighbours in others, whose bound is exceeded; some several times.
fn exceeded_around<E: Functional>(
    partition: &Partition<'_, E>,
    changed: &[u32],
    bounds: &[StoredBound],
    rival: impl Fn(u32, u32) -> Rival,
) -> Vec<u32> {
    let Partition { graph, labels, boundary, .. } = partition;
    let mut exceeded = Vec::new();
    let mut around: Vec<u32> = Vec::new();
    let outgrows_caches = graph.outgrows_caches();
    for (at, &cluster) in changed.iter().enumerate() {
        if outgrows_caches {
            changed.get(at + 1).into_iter().for_each(|&next| boundary.prefetch_list(graph, next));
            boundary.of_cluster(cluster).for_each(|face| graph.prefetch_neighbours(face));
        }
        around.clear();
        for face in boundary.of_cluster(cluster) {
            around.push(face);
            let near = graph.neighbours_of(face).iter().copied();
            around.extend(near.filter(|&near| labels.near_boundary(near) != cluster));
        }
        if outgrows_caches {
            around.iter().for_each(|&face| prefetch(bounds, face as usize));
        }
        around.retain(|&face| {
            let bound = &bounds[face as usize];
            if bound.near().are_many() {
                may_be_attracted(partition, bounds, &rival, face, cluster)
            } else {
                is_exceeded(partition, face, bound)
            }
        });
        exceeded.extend_from_slice(&around);
    }
    exceeded
}
