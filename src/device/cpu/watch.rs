//! Which faces need another look.
//!
//! A face decides by the distances to the proxies of its own cluster and of those beside it. When they lie apart by more than
//! the proxies have moved since it last looked, it would decide as it did before, so it is not asked (the triangle
//! inequality, as Elkan 2003 and Hamerly 2010 use it for k-means). What it can bear, its *slack*, is a length that each of its
//! clusters may drift; the face is entered at each of them, and comes up when one of them has drifted further. Skipping is
//! exact: labels equal those of a plain sweep after every iteration.
//!
//! Faces that were moved are always due, and so are the faces beside them that see a cluster which they did not see before.
//!
//! In refinement of the bunny in 1,000 clusters, 24,000 faces on boundaries are asked 94,000 times in 121 iterations: 24,000 of
//! them at first, 8,000 because they or faces beside them moved, the others because a proxy had drifted. A third of the
//! instructions of such a phase are for entering faces, a third for asking them; all threads do both where faces are many.
//! Which thread finds first that a face is due decides nothing but the order in which faces are asked.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use rayon::current_num_threads;
use rayon::prelude::*;

use super::clusters::Clusters;
use super::frontier::Frontier;
use super::labels::Labels;
use super::{CHUNK, batch};
use crate::surface::DualGraph;

/// How far each cluster that a face sees may drift before the face must look again; None: any change wakes it.
pub type Slack = Option<u64>;

/// A face at one of the clusters that it sees.
#[derive(Debug, Clone, Copy)]
struct Entry {
    /// The drift of the cluster up to which the face may rest.
    until: u64,
    face: u32,
    /// The look that it stems from; entries of earlier looks are void.
    look: u32,
}

impl Entry {
    /// Whether the face has not come up since it was entered.
    fn is_current(&self, looks: &[AtomicU32]) -> bool {
        looks[self.face as usize].load(Relaxed) == self.look
    }
}

/// The cluster at which an entry belongs, and the entry.
type Placed = (u32, Entry);

/// Boundary phases of fewer iterations do not let faces rest: entering them costs more than asking again.
const FEW: u32 = 8;

/// Faces that are asked, and clusters that are gone through, by one thread; more by all.
const FEW_FACES: usize = 2048;
const FEW_CLUSTERS: usize = 128;

/// Parts of the clusters at which faces are entered at the same time, a thread.
const PARTS: usize = 2;

/// The faces that rest, and those that are due.
#[derive(Debug)]
pub struct Watch {
    /// Whether faces rest; if not, all faces of clusters that gained or lost one are due, and those beside them.
    lets_rest: bool,
    at_cluster: Vec<Vec<Entry>>,
    /// How often each face came up.
    looks: Vec<AtomicU32>,
    is_due: Vec<AtomicBool>,
    due: Vec<u32>,
}

/// What a face says that is asked.
#[derive(Debug)]
pub struct Answer<T> {
    /// What it wants, if that is news.
    pub wish: Option<T>,
    /// Whether it rests.
    pub rest: Rest,
}

/// Whether a face rests.
#[derive(Debug, Clone, Copy)]
pub enum Rest {
    /// It moves, and is due with that.
    No,
    /// Until a cluster that it sees has drifted so far.
    For(Slack),
}

impl Watch {
    /// For the faces of `frontier`, in a phase of so many iterations. All of them are due, or will be with the clusters that
    /// have changed.
    pub fn new(frontier: &Frontier, faces: usize, clusters: usize, iterations: u32) -> Self {
        let lets_rest = iterations >= FEW;
        let mut watch = Self {
            lets_rest,
            at_cluster: if lets_rest { vec![Vec::new(); clusters] } else { Vec::new() },
            looks: (0..faces).map(|_| AtomicU32::new(0)).collect(),
            is_due: (0..faces).map(|_| AtomicBool::new(false)).collect(),
            due: Vec::new(),
        };
        if lets_rest {
            frontier.all().for_each(|face| watch.add(face));
        }
        watch
    }

    /// Whether it is made for a phase of so many iterations.
    pub fn suits(&self, iterations: u32) -> bool {
        self.lets_rest == (iterations >= FEW)
    }

    /// A face must look again.
    pub fn add(&mut self, face: u32) {
        if self.claim(face) {
            self.due.push(face);
        }
    }

    /// Makes a face due. Whether it was not: then whoever asks has to put it on the list.
    fn claim(&self, face: u32) -> bool {
        let is_due = &self.is_due[face as usize];
        if is_due.load(Relaxed) || is_due.swap(true, Relaxed) {
            return false;
        }
        let looks = &self.looks[face as usize];
        looks.store(looks.load(Relaxed).wrapping_add(1), Relaxed);
        true
    }

    /// A face was kept back by the last-face rule: its cluster has lost all others.
    pub fn kept_back(&mut self, face: u32) {
        // where nobody rests it is due with its cluster
        if self.lets_rest {
            self.add(face);
        }
    }

    /// A face has come to a cluster, as `labels` say: it must look again, and so must those beside it that see a cluster which
    /// they did not see before.
    pub fn moved(&mut self, graph: &DualGraph, labels: &Labels, face: u32) {
        if !self.lets_rest {
            return;
        }
        self.add(face);
        let cluster = labels.near_boundary(face);
        for &near in graph.neighbours_of(face) {
            let is_of = |other: &u32| *other != face && labels.near_boundary(*other) == cluster;
            if labels.near_boundary(near) != cluster && !graph.neighbours_of(near).iter().any(is_of) {
                self.add(near);
            }
        }
    }

    /// A boundary face has become part of another cluster, together with those around it.
    pub fn merged(&mut self, graph: &DualGraph, labels: &Labels, face: u32) {
        if !self.lets_rest {
            return;
        }
        self.add(face);
        let cluster = labels.near_boundary(face);
        for &near in graph.neighbours_of(face) {
            if labels.of(near) != cluster {
                self.add(near);
            }
        }
    }

    /// Lets the faces be due that can have changed their minds because these clusters gained or lost a face. The labels of
    /// all that are due are up to date then, and those around them.
    pub fn wake(
        &mut self,
        graph: &DualGraph,
        labels: &mut Labels,
        frontier: &Frontier,
        changed: &[u32],
        clusters: &Clusters,
    ) {
        if self.lets_rest {
            self.wake_drifted(changed, clusters);
            // one that rests no longer need be on a boundary, where labels are kept up to date
            labels.refresh_around(graph, &self.due);
        } else {
            self.add_all(graph, labels, frontier, changed);
        }
    }

    /// The faces are due for which these clusters have drifted too far.
    fn wake_drifted(&mut self, changed: &[u32], clusters: &Clusters) {
        let mut at_cluster = std::mem::take(&mut self.at_cluster);
        let woken = self.drifted(changed, 0, &mut at_cluster, clusters);
        self.at_cluster = at_cluster;
        self.due.extend(woken);
    }

    /// The faces that were not due, for which some of the clusters from `first` on have drifted too far; they are now.
    fn drifted(&self, changed: &[u32], first: u32, at_cluster: &mut [Vec<Entry>], clusters: &Clusters) -> Vec<u32> {
        if changed.len() > FEW_CLUSTERS {
            let (lower, upper) = changed.split_at(changed.len() / 2);
            let (at_lower, at_upper) = at_cluster.split_at_mut((upper[0] - first) as usize);
            let (mut woken, others) = rayon::join(
                || self.drifted(lower, first, at_lower, clusters),
                || self.drifted(upper, upper[0], at_upper, clusters),
            );
            woken.extend(others);
            return woken;
        }
        let mut woken = Vec::new();
        for &cluster in changed {
            let drift = clusters.drift(cluster);
            at_cluster[(cluster - first) as usize].retain(|entry| {
                let rests = drift <= entry.until;
                if !rests && entry.is_current(&self.looks) && self.claim(entry.face) {
                    woken.push(entry.face);
                }
                rests
            });
        }
        woken
    }

    /// All faces are due that can have changed their minds because these clusters gained or lost a face: their boundary faces
    /// and those beside them.
    fn add_all(&mut self, graph: &DualGraph, labels: &Labels, frontier: &Frontier, changed: &[u32]) {
        let wake = |clusters: &[u32]| {
            let mut woken = Vec::new();
            for &cluster in clusters {
                for face in frontier.boundary_of(cluster) {
                    if self.claim(face) {
                        woken.push(face);
                    }
                    for &near in graph.neighbours_of(face) {
                        if labels.near_boundary(near) != cluster && self.claim(near) {
                            woken.push(near);
                        }
                    }
                }
            }
            woken
        };
        let woken: Vec<Vec<u32>> = if changed.len() <= FEW_CLUSTERS {
            vec![wake(changed)]
        } else {
            changed.par_chunks(FEW_CLUSTERS).map(wake).collect()
        };
        woken.into_iter().for_each(|woken| self.due.extend(woken));
    }

    /// Asks all faces that are due what they want, and lets them rest that say so.
    pub fn ask<T: Send + Sync>(
        &mut self,
        graph: &DualGraph,
        labels: &Labels,
        clusters: &Clusters,
        decide: impl Fn(u32) -> Answer<T> + Sync,
    ) -> Vec<T> {
        let Self { lets_rest, at_cluster, looks, is_due, due } = self;
        due.iter().for_each(|&face| *is_due[face as usize].get_mut() = false);
        let looks: &[AtomicU32] = looks;
        let ask = |face: u32, wishes: &mut Vec<T>, entries: &mut Vec<Placed>| {
            let Answer { wish, rest } = decide(face);
            wishes.extend(wish);
            if let (true, Rest::For(slack)) = (*lets_rest, rest) {
                let look = looks[face as usize].load(Relaxed);
                for_each_cluster(graph, labels, face, |cluster| {
                    let until = slack.map_or(0, |slack| clusters.drift(cluster) + slack);
                    entries.push((cluster, Entry { until, face, look }));
                });
            }
        };
        let mut wishes = Vec::new();
        if due.len() <= FEW_FACES {
            let mut entries = Vec::new();
            for &face in &*due {
                ask(face, &mut wishes, &mut entries);
                for (cluster, entry) in entries.drain(..) {
                    enter(clusters, looks, cluster, &mut at_cluster[cluster as usize], entry);
                }
            }
        } else {
            // those beside each other in memory are asked one after the other
            due.par_sort_unstable();
            for due in due.chunks(batch()) {
                let asked = due.par_chunks(CHUNK).map(|faces| {
                    let mut asked = (Vec::new(), Vec::new());
                    faces.iter().for_each(|&face| ask(face, &mut asked.0, &mut asked.1));
                    asked
                });
                let (said, entries): (Vec<Vec<T>>, Vec<Vec<Placed>>) = asked.unzip();
                wishes.extend(said.into_iter().flatten());
                enter_all(clusters, looks, at_cluster, &entries);
            }
        }
        due.clear();
        wishes
    }

    /// A cluster has become part of another: nobody sees it any more.
    pub fn forget(&mut self, cluster: u32) {
        if self.lets_rest {
            self.at_cluster[cluster as usize] = Vec::new();
        }
    }
}

/// Calls `visit` with each cluster that a face sees: those beside it, some of them maybe twice, and its own. One that sees no
/// cluster but its own rests until it is [`Watch::add`]ed.
fn for_each_cluster(graph: &DualGraph, labels: &Labels, face: u32, mut visit: impl FnMut(u32)) {
    let own = labels.near_boundary(face);
    let mut last = own;
    for &near in graph.neighbours_of(face) {
        let other = labels.near_boundary(near);
        if other != own && other != last {
            visit(other);
            last = other;
        }
    }
    if last != own {
        visit(own);
    }
}

/// Enters faces at clusters, some of those at a time.
fn enter_all(clusters: &Clusters, looks: &[AtomicU32], at_cluster: &mut [Vec<Entry>], entries: &[Vec<Placed>]) {
    let numbers = || entries.iter().flatten().map(|&(cluster, _)| cluster as usize);
    // faces that are asked together see clusters whose numbers are close to each other
    let (Some(first), Some(last)) = (numbers().min(), numbers().max()) else { return };
    let part = (last + 1 - first).div_ceil(PARTS * current_num_threads());
    at_cluster[first..=last].par_chunks_mut(part).enumerate().for_each(|(number, at_cluster)| {
        let first = first + number * part;
        for &(cluster, entry) in entries.iter().flatten() {
            if let Some(entries) = (cluster as usize).checked_sub(first).and_then(|at| at_cluster.get_mut(at)) {
                enter(clusters, looks, cluster, entries, entry);
            }
        }
    });
}

/// Puts an entry to those at a cluster.
fn enter(clusters: &Clusters, looks: &[AtomicU32], cluster: u32, entries: &mut Vec<Entry>, entry: Entry) {
    if entries.len() == entries.capacity() {
        // void ones go before more memory is taken
        entries.retain(|entry| entry.is_current(looks));
        if 2 * entries.len() >= entries.capacity() {
            let expected = 2 * clusters.sums(cluster).faces as usize;
            entries.reserve_exact(entries.len().max(expected.clamp(4, 64)));
        }
    }
    entries.push(entry);
}

/// What a face can bear that stays because the proxy of its cluster is no further than any other: half of what they lie
/// apart. Takes squared distances.
pub fn boundary_slack(own: u64, nearest_other: u64) -> Slack {
    // distances are below 2²⁹, so that roots of rounded squares are off by far less than one
    let apart = (nearest_other as f64).sqrt() - (own as f64).sqrt();
    Some((apart / 2.0 - 1.0).max(0.0) as u64)
}

/// What a face can bear that bids for nothing: its gain stays below zero while
/// `√α·(d_a + slack) ≤ √β·(d_b − slack)` with `α = M_a/(M_a − w)` and `β = M_b/(M_b + w)`, both of which only change
/// for the worse when a cluster gets lighter; so they are taken for the least weights that the clusters may have before all
/// that see them are woken ([`Clusters::least_weight`]).
#[derive(Debug, Clone, Copy)]
pub struct RefinementSlack {
    weight: f64,
    /// √α, and √α·d_a.
    root: f64,
    own: f64,
    slack: f64,
}

impl RefinementSlack {
    /// For a face of some weight, and the squared distance and least weight of its own cluster.
    pub fn new(weight: u32, squared_distance: u64, least_weight: u64) -> Self {
        let weight = f64::from(weight);
        let least = least_weight as f64;
        if least <= weight {
            return Self { weight, root: 1.0, own: 0.0, slack: f64::NEG_INFINITY };
        }
        let root = (least / (least - weight)).sqrt();
        Self { weight, root, own: root * (squared_distance as f64).sqrt(), slack: f64::INFINITY }
    }

    /// Takes another cluster into account.
    pub fn beside(&mut self, squared_distance: u64, least_weight: u64) {
        let least = least_weight as f64;
        let other = (squared_distance as f64 * (least / (least + self.weight))).sqrt();
        self.slack = self.slack.min((other - self.own) / (1.0 + self.root));
    }

    /// What is left; none where the own cluster may become too light for a bound, and where the distances are too close.
    pub fn get(self) -> Slack {
        (self.slack >= 1.0).then_some((self.slack - 1.0) as u64)
    }
}
