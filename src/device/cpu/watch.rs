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
//! instructions of such a phase are for entering faces, a third for asking them.

use super::clusters::Clusters;
use super::frontier::Frontier;
use super::labels::Labels;
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

/// Boundary phases of fewer iterations do not let faces rest: entering them costs more than asking again.
const FEW: u32 = 8;

/// So many faces that are due are sorted, so that those beside each other in memory are asked one after the other.
const MANY: usize = 4096;

/// The faces that rest, and those that are due.
#[derive(Debug)]
pub struct Watch {
    /// Whether faces rest; if not, all faces of clusters that gained or lost one are due, and those beside them.
    lets_rest: bool,
    at_cluster: Vec<Vec<Entry>>,
    /// How often each face came up.
    looks: Vec<u32>,
    is_due: Vec<bool>,
    due: Vec<u32>,
}

impl Watch {
    /// For the faces of `frontier`, in a phase of so many iterations. All of them are due, or will be with the clusters that
    /// have changed.
    pub fn new(frontier: &Frontier, faces: usize, clusters: usize, iterations: u32) -> Self {
        let lets_rest = iterations >= FEW;
        let mut watch = Self {
            lets_rest,
            at_cluster: if lets_rest { vec![Vec::new(); clusters] } else { Vec::new() },
            looks: vec![0; faces],
            is_due: vec![false; faces],
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
        if !std::mem::replace(&mut self.is_due[face as usize], true) {
            self.looks[face as usize] = self.looks[face as usize].wrapping_add(1);
            self.due.push(face);
        }
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
        for &cluster in changed {
            let drift = clusters.drift(cluster);
            let mut entries = std::mem::take(&mut self.at_cluster[cluster as usize]);
            entries.retain(|entry| {
                let rests = drift <= entry.until;
                if !rests && self.looks[entry.face as usize] == entry.look {
                    self.add(entry.face);
                }
                rests
            });
            self.at_cluster[cluster as usize] = entries;
        }
    }

    /// All faces are due that can have changed their minds because these clusters gained or lost a face: their boundary faces
    /// and those beside them.
    fn add_all(&mut self, graph: &DualGraph, labels: &Labels, frontier: &Frontier, changed: &[u32]) {
        for &cluster in changed {
            for face in frontier.boundary_of(cluster) {
                self.add(face);
                for &near in graph.neighbours_of(face) {
                    if labels.near_boundary(near) != cluster {
                        self.add(near);
                    }
                }
            }
        }
    }

    /// The faces that are due, each once; they no longer are.
    pub fn take_due(&mut self) -> Vec<u32> {
        for &face in &self.due {
            self.is_due[face as usize] = false;
        }
        let mut due = std::mem::take(&mut self.due);
        if due.len() > MANY {
            due.sort_unstable();
        }
        due
    }

    /// Lets a face rest that has looked. One that sees no cluster but its own rests until it is [`add`](Self::add)ed.
    pub fn rest(&mut self, graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32, slack: Slack) {
        if !self.lets_rest {
            return;
        }
        let own = labels.near_boundary(face);
        let mut last = own;
        for &near in graph.neighbours_of(face) {
            let other = labels.near_boundary(near);
            if other != own && other != last {
                self.enter(clusters, other, face, slack);
                last = other;
            }
        }
        if last != own {
            self.enter(clusters, own, face, slack);
        }
    }

    /// Enters a face at a cluster.
    fn enter(&mut self, clusters: &Clusters, cluster: u32, face: u32, slack: Slack) {
        let entries = &mut self.at_cluster[cluster as usize];
        if entries.len() == entries.capacity() {
            // void ones go before more memory is taken
            entries.retain(|entry| self.looks[entry.face as usize] == entry.look);
            if 2 * entries.len() >= entries.capacity() {
                let expected = 2 * clusters.sums(cluster).faces as usize;
                entries.reserve_exact(entries.len().max(expected.clamp(4, 64)));
            }
        }
        let until = slack.map_or(0, |slack| clusters.drift(cluster) + slack);
        entries.push(Entry { until, face, look: self.looks[face as usize] });
    }

    /// A cluster has become part of another: nobody sees it any more.
    pub fn forget(&mut self, cluster: u32) {
        if self.lets_rest {
            self.at_cluster[cluster as usize] = Vec::new();
        }
    }
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
