//! Which faces need another look.
//!
//! A face decides by the distances to the proxies of its own cluster and of those beside it. When they lie apart by more than
//! the proxies have moved since it last looked, it would decide as it did before, so it is not asked (the triangle
//! inequality, as Elkan 2003 and Hamerly 2010 use it for k-means). What it can bear, its *slack*, is how far the proxies of
//! all clusters that it sees may drift, added up. Skipping is exact: labels equal those of a plain sweep after every iteration.
//!
//! Faces that were moved are always due, and so are the faces beside them that see a cluster which they did not see before, or
//! several. What a face said that rests stands until it is asked again, though it may come to lie inside its cluster meanwhile:
//! who keeps that, as refinement keeps bids, [adds](Watch::add) such faces when their clusters change.
//!
//! Where many clusters have changed, all faces that may lie on a boundary are gone through in the order of memory; where few
//! have, their boundary faces and those beside them. Clustering the bunny into 1,000, coarse graphs included, goes through
//! 22,500 faces in each of 46 iterations, and through 1,600 and those beside them in 105; it asks 317,000 in all, at
//! some 240 instructions each. A sum of drifts wakes a quarter fewer than a bound for each cluster did, and needs no lists of who
//! rests at which cluster.

use std::hint::select_unpredictable;
use std::iter;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicU32, AtomicU64};

use rayon::prelude::*;

use super::CHUNK;
use super::clusters::{Clusters, Place, STEP};
use super::frontier::Frontier;
use super::labels::Labels;
use super::sieve::Sieve;
use crate::prefetch::{Ahead, prefetch, with_lookahead};
use crate::surface::DualGraph;

/// Faces that one thread asks, or looks whether they are due; more are for all.
const FEW_FACES: usize = 2048;

/// Changed clusters around which a thread looks at a time, where there are many.
const FEW_CLUSTERS: usize = 16;

/// Words of [`Watch::near`] that a thread takes at a time.
const WORDS: usize = 64;

/// Going to the boundary of a changed cluster costs so many times what going through as many faces in order does.
const DETOUR: usize = 4;

/// The faces that rest, and those that are due.
#[derive(Debug)]
pub struct Watch {
    /// One bit a face: whether it may lie on a boundary. All others rest until they are [`added`](Self::add).
    near: Vec<AtomicU64>,
    /// Number of bits that are set, or were when all were last gone through.
    boundary: usize,
    rest_of_face: Vec<Kept>,
    /// Faces that are due, each once; all that are marked [`LISTED`] are here. Others may be due, too, until those are looked for.
    due: Vec<u32>,
}

/// How long a face rests: until the proxies of the clusters that it sees have together drifted further than `until`, in
/// [steps](STEP).
#[derive(Debug, Clone, Copy)]
pub struct Resting {
    until: u32,
    /// The number after that of the cluster that it was in, which may have ended since.
    own: u32,
    /// Those after the others' numbers: [`NOBODY`] where there is no further one. Where there are more than two, [`SEVERAL`] and
    /// the upper bits of `until`: thousands may meet at one face.
    others: [u32; 2],
}

/// What is kept of a face: as long as faces are asked, each is written by the thread that asked it. Sixteen bytes, so that none
/// lies in two cache lines: on large meshes memory is what the time goes to.
#[derive(Debug)]
#[repr(align(16))]
struct Kept {
    until: AtomicU32,
    own: AtomicU32,
    others: [AtomicU32; 2],
}

/// Less than any drift: due, and on the list of those that are.
const LISTED: u32 = 0;

/// Less than any drift: due.
const DUE: u32 = 1;

/// Lower bits of `until` where a face sees several; the one above them is set, so that it is neither [`LISTED`] nor [`DUE`].
const LOWER_BITS: u32 = 31;

/// After the number of no cluster.
const NOBODY: u32 = 0;
/// After the number of none, either: clusters are fewer.
const SEVERAL: u32 = u32::MAX;

/// What a face says that is asked.
#[derive(Debug)]
pub struct Answer<T> {
    /// What it wants, if that is news.
    pub wish: Option<T>,
    /// How long it rests.
    pub rest: Resting,
}

/// The clusters that a face sees, as [`Resting`] names them.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    own: u32,
    others: [u32; 2],
    /// How far their proxies have drifted, together; of several, as [`drift_of_several`] adds them up.
    drift: u64,
}

impl Watch {
    /// All faces of a frontier are due.
    pub fn new(frontier: &Frontier, faces: usize) -> Self {
        let words = faces.div_ceil(64);
        // whatever cluster there is, it has drifted further
        let due = Resting { until: DUE, own: 1, others: [NOBODY; 2] };
        let mut watch = Self {
            near: iter::repeat_with(AtomicU64::default).take(words).collect(),
            boundary: 0,
            rest_of_face: iter::repeat_with(|| due.into()).take(faces).collect(),
            due: Vec::new(),
        };
        frontier.all().for_each(|face| watch.mark(face));
        watch
    }

    /// A face may lie on a boundary.
    fn mark(&mut self, face: u32) {
        *self.near[face as usize / 64].get_mut() |= 1 << (face % 64);
    }

    /// Asks for how long a face rests.
    #[inline]
    pub fn prefetch(&self, face: u32) {
        prefetch(&self.rest_of_face, face as usize);
    }

    /// A face must look again.
    pub fn add(&mut self, face: u32) {
        if self.rest_of_face[face as usize].list() {
            self.mark(face);
            self.due.push(face);
        }
    }

    /// A face has come to a cluster, as `labels` say: it must look again, and so must those beside it that did not see this one
    /// when they last looked, or rest by the sum over several clusters, which must not become the sum over others.
    pub fn moved(&mut self, graph: &DualGraph, labels: &Labels, face: u32) {
        self.add(face);
        let cluster = labels.near_boundary(face);
        for &near in graph.neighbours_of(face) {
            let [one, two] = self.rest_of_face[near as usize].others();
            let saw = (one == cluster + 1) | (two == cluster + 1) | (labels.near_boundary(near) == cluster);
            if (one == SEVERAL) | !saw {
                self.add(near);
            }
        }
    }

    /// A boundary face has become part of another cluster, together with those around it.
    pub fn merged(&mut self, graph: &DualGraph, labels: &Labels, face: u32) {
        self.add(face);
        let cluster = labels.near_boundary(face);
        for &near in graph.neighbours_of(face) {
            if self.rest_of_face[near as usize].others()[0] == SEVERAL || labels.of(near) != cluster {
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
        let listed: usize = changed.iter().map(|&cluster| frontier.listed(cluster)).sum();
        if DETOUR * (listed + self.due.len()) < self.boundary {
            let rests = &self.rest_of_face;
            let over_around = |changed: &[u32]| over_around(graph, labels, frontier, changed, clusters, rests);
            let found: Vec<Vec<u32>> = match listed <= FEW_FACES {
                true => vec![over_around(changed)],
                false => changed.par_chunks(FEW_CLUSTERS).map(over_around).collect(),
            };
            for face in found.into_iter().flatten() {
                if self.rest_of_face[face as usize].list() {
                    self.due.push(face);
                }
            }
        } else {
            let Self { near, rest_of_face, .. } = self;
            let rests = rest_of_face.par_chunks(64 * WORDS);
            let found = near.par_chunks(WORDS).zip(rests).enumerate().map(|(part, (words, rests))| {
                let mut boundary = 0;
                let mut due = Sieve::default();
                for (word, (bits, rests)) in words.iter().zip(rests.chunks(64)).enumerate() {
                    let bits = bits.load(Relaxed);
                    let first = (64 * (WORDS * part + word)) as u32;
                    let is_over = |face: u32| rests[face as usize % 64].is_over(graph, labels, clusters, face);
                    boundary += bits.count_ones() as usize;
                    due.add(64, ones(bits).map(|bit| first + bit), is_over);
                }
                (boundary, due)
            });
            let found: Vec<(usize, Sieve)> = found.collect();
            self.boundary = found.iter().map(|(boundary, _)| boundary).sum();
            self.due.clear();
            found.iter().for_each(|(_, due)| self.due.extend_from_slice(due.kept()));
        }
        // one that rests no longer need be on a boundary, where labels are kept up to date
        labels.refresh_around(graph, &self.due);
    }

    /// Asks all faces that are due what they want, and lets them rest that say so.
    pub fn ask<T: Send>(
        &mut self,
        graph: &DualGraph,
        labels: &Labels,
        decide: impl Fn(u32) -> Answer<T> + Sync,
    ) -> Vec<T> {
        let Self { near, rest_of_face, due, .. } = self;
        let ask = |&face: &u32| {
            let Answer { wish, rest } = decide(face);
            rest_of_face[face as usize].keep(rest);
            if rest.others[0] == NOBODY {
                near[face as usize / 64].fetch_and(!(1 << (face % 64)), Relaxed);
            }
            wish
        };
        let outgrows_caches = graph.outgrows_caches();
        let wishes = match due.len() <= FEW_FACES {
            true => due.iter().filter_map(ask).collect(),
            false => {
                let wishes = due.par_chunks(CHUNK).map(|faces| {
                    let ask_in_turn = |(face, ahead)| {
                        if outgrows_caches {
                            prefetch_next(graph, labels, rest_of_face, ahead);
                        }
                        ask(face)
                    };
                    with_lookahead(faces).filter_map(ask_in_turn).collect()
                });
                wishes.collect::<Vec<Vec<T>>>().into_iter().flatten().collect()
            }
        };
        due.clear();
        wishes
    }
}

/// Prefetches what later faces decide by.
#[inline]
fn prefetch_next(graph: &DualGraph, labels: &Labels, rests: &[Kept], ahead: Ahead<'_, u32>) {
    if let Some(&later) = ahead.stage(4) {
        graph.prefetch(later);
        prefetch(rests, later as usize);
    }
    if let Some(&later) = ahead.stage(2) {
        graph.prefetch_neighbours(later);
    }
    if let Some(&later) = ahead.stage(1) {
        graph.neighbours_of(later).iter().for_each(|&near| labels.prefetch(near));
    }
}

impl From<Resting> for Kept {
    fn from(Resting { until, own, others }: Resting) -> Self {
        Self { until: until.into(), own: own.into(), others: others.map(AtomicU32::from) }
    }
}

impl Kept {
    /// Keeps how long the face rests.
    #[inline]
    fn keep(&self, Resting { until, own, others: [one, two] }: Resting) {
        self.until.store(until, Relaxed);
        self.own.store(own, Relaxed);
        self.others[0].store(one, Relaxed);
        self.others[1].store(two, Relaxed);
    }

    /// Says that the face is on the list of those that are due. Returns whether that is news.
    #[inline]
    fn list(&mut self) -> bool {
        std::mem::replace(self.until.get_mut(), LISTED) != LISTED
    }

    /// As [`Resting::others`].
    #[inline]
    fn others(&self) -> [u32; 2] {
        let [one, two] = &self.others;
        [one.load(Relaxed), two.load(Relaxed)]
    }

    /// How far the proxies may drift; less than any drift for a face that is due.
    #[inline]
    fn until(&self) -> u64 {
        let until = self.until.load(Relaxed);
        match self.others() {
            [SEVERAL, upper] if until > DUE => u64::from(upper) << LOWER_BITS | u64::from(until & !(1 << LOWER_BITS)),
            _ => until.into(),
        }
    }

    /// Whether it is over. A face that sees nobody rests as good as without end.
    #[inline]
    fn is_over(&self, graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32) -> bool {
        let own = self.own.load(Relaxed);
        let drift = match self.others() {
            [SEVERAL, _] => drift_of_several(graph, labels, clusters, face, own - 1),
            [one, two] => [own, one, two].map(|next| clusters.place_before(next).drift).iter().sum(),
        };
        self.until() < drift
    }
}

impl Seen {
    /// Looks at what is around a face of some cluster. Calls `visit` with each other cluster that it sees; where there are more than
    /// two, with some maybe several times.
    #[inline]
    pub fn around(
        graph: &DualGraph,
        labels: &Labels,
        clusters: &Clusters,
        face: u32,
        own: u32,
        mut visit: impl FnMut(u32, &Place),
    ) -> Self {
        let mut others = [NOBODY; 2];
        let mut are_more = false;
        // which neighbours are in other clusters follows no pattern: nothing here branches on it
        for &near in graph.neighbours_of(face) {
            let next = labels.near_boundary(near) + 1;
            let is_new = (next != own + 1) & (next != others[0]) & (next != others[1]);
            are_more |= is_new & (others[1] != NOBODY);
            others =
                [select_unpredictable(is_new, next, others[0]), select_unpredictable(is_new, others[0], others[1])];
        }
        if are_more {
            others_beside(graph, labels, face, own).for_each(|other| visit(other, clusters.place(other)));
            others[0] = SEVERAL;
            return Self { own: own + 1, others, drift: drift_of_several(graph, labels, clusters, face, own) };
        }
        let mut drift = clusters.place(own).drift;
        for next in others.into_iter().take_while(|&next| next != NOBODY) {
            let place = clusters.place(next - 1);
            visit(next - 1, place);
            drift += place.drift;
        }
        Self { own: own + 1, others, drift }
    }

    /// The face rests until the proxies of all these clusters have together drifted further than `slack`, in lattice units. With
    /// 0, any change to one of them wakes it.
    #[inline]
    pub fn rest(self, slack: u64) -> Resting {
        let Self { own, others, drift } = self;
        let until = drift + slack / STEP;
        match others {
            // it rests until one beside it moves
            [NOBODY, _] => Resting { until: u32::MAX, own, others },
            [SEVERAL, _] => {
                let (upper, lower) = ((until >> LOWER_BITS) as u32, until as u32 | 1 << LOWER_BITS);
                Resting { until: lower, own, others: [SEVERAL, upper] }
            }
            _ => {
                // three clusters would have to become lighter by an eighth some three hundred times each
                debug_assert!(until < u32::MAX.into(), "{until} steps");
                Resting { until: until.try_into().unwrap_or(u32::MAX), own, others }
            }
        }
    }

    /// The face does not rest.
    pub fn due(self) -> Resting {
        Resting { until: DUE, ..self.rest(0) }
    }
}

/// The faces on the boundaries of some clusters, and of those beside them, that rest no longer; some several times. One with many
/// neighbours, which comes up for each of them, is rather asked once.
fn over_around(
    graph: &DualGraph,
    labels: &Labels,
    frontier: &Frontier,
    changed: &[u32],
    clusters: &Clusters,
    rests: &[Kept],
) -> Vec<u32> {
    let mut over = Vec::new();
    let mut around = Sieve::default();
    for &cluster in changed {
        around.clear();
        for face in frontier.boundary_of(cluster) {
            let beside = graph.neighbours_of(face);
            around.extend(&[face]);
            around.add(beside.len(), beside.iter().copied(), |near| labels.near_boundary(near) != cluster);
        }
        around.retain(|face| {
            let kept = &rests[face as usize];
            kept.others()[0] == SEVERAL || kept.is_over(graph, labels, clusters, face)
        });
        over.extend_from_slice(around.kept());
    }
    over
}

/// The clusters that a face sees beside its own, those that it shares several edges with maybe several times.
pub fn others_beside<'a>(
    graph: &'a DualGraph,
    labels: &'a Labels,
    face: u32,
    own: u32,
) -> impl Iterator<Item = u32> + 'a {
    let mut last = own;
    // nobody may have kept their labels up to date, if the face lies on no boundary any more
    graph.neighbours_of(face).iter().map(|&near| labels.of(near)).filter(move |&other| {
        let is_other = other != own && other != last;
        if is_other {
            last = other;
        }
        is_other
    })
}

/// How far the proxies of its own and of the [`others_beside`] that a face sees have drifted, added up.
#[cold]
fn drift_of_several(graph: &DualGraph, labels: &Labels, clusters: &Clusters, face: u32, own: u32) -> u64 {
    let others = others_beside(graph, labels, face, own).map(|other| clusters.place(other).drift);
    clusters.place(own).drift + others.sum::<u64>()
}

/// The places of the ones of a number.
#[inline]
fn ones(mut bits: u64) -> impl Iterator<Item = u32> {
    iter::from_fn(move || {
        let one = bits.trailing_zeros();
        bits &= bits.wrapping_sub(1);
        (one < 64).then_some(one)
    })
}

/// What a face can bear that stays because the proxy of its cluster is no further than any other: what they lie apart. Takes
/// squared distances.
pub fn boundary_slack(own: u64, nearest_other: u64) -> u64 {
    // distances are below 2²⁹, so that roots of rounded squares are off by far less than one
    let apart = root(nearest_other) - root(own);
    (apart - 1.0).max(0.0) as u64
}

/// The root of a squared distance, which is below 2⁶³: signed numbers are converted faster.
#[inline]
fn root(squared_distance: u64) -> f64 {
    (squared_distance.cast_signed() as f64).sqrt()
}

/// What a face can bear that bids for nothing: its gain stays below zero while `√α·(d_a + x) ≤ √β·(d_b − y)` where its own
/// cluster drifts by x and another by y, with `α = M_a/(M_a − w)` and `β = M_b/(M_b + w)`, both of which only change for the
/// worse when a cluster gets lighter; so they are taken for the least weights that the clusters may have before all that see
/// them are woken ([`Place::least_weight`]). As √β ≤ 1 ≤ √α, that is so while `√α·(x + y) ≤ √β·d_b − √α·d_a`.
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
        let least = least_weight.cast_signed() as f64;
        if least <= weight {
            return Self { weight, root: 1.0, own: 0.0, slack: f64::NEG_INFINITY };
        }
        let root = (least / (least - weight)).sqrt();
        Self { weight, root, own: root * self::root(squared_distance), slack: f64::INFINITY }
    }

    /// Takes another cluster into account.
    pub fn beside(&mut self, squared_distance: u64, least_weight: u64) {
        let least = least_weight.cast_signed() as f64;
        let other = (squared_distance.cast_signed() as f64 * (least / (least + self.weight))).sqrt();
        self.slack = self.slack.min((other - self.own) / self.root);
    }

    /// What is left; 0 where the own cluster may become too light for a bound, and where the distances are too close.
    pub fn get(self) -> u64 {
        (self.slack - 1.0).max(0.0) as u64
    }

    /// Whether the face surely bids for nothing.
    pub fn is_clear(self) -> bool {
        self.slack >= 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn how_long_faces_rest_is_kept_exactly() {
        let seen = |others, drift| Seen { own: 3, others, drift };
        for drift in [2, 3, (1 << 31) - 1, 1 << 31, (1 << 31) + 1, (1 << 32) - 2, 1 << 32, (1 << 40) + 7] {
            for slack in [0, STEP - 1, STEP, 1_000_000 * STEP + 1] {
                let until = drift + slack / STEP;
                assert_eq!(Kept::from(seen([SEVERAL, 9], drift).rest(slack)).until(), until);
                if until < u32::MAX.into() {
                    assert_eq!(Kept::from(seen([5, 9], drift).rest(slack)).until(), until);
                    assert_eq!(Kept::from(seen([5, NOBODY], drift).rest(slack)).until(), until);
                }
            }
            for others in [[SEVERAL, 9], [5, 9], [5, NOBODY]] {
                let due = seen(others, drift.min(1 << 31)).due();
                assert_eq!(Kept::from(due).until(), u64::from(DUE));
                let mut kept = Kept::from(due);
                assert!(kept.list() && !kept.list());
                assert_eq!(kept.until(), u64::from(LISTED));
            }
        }
    }
}
