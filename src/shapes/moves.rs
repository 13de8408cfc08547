//! The boundary phase: faces move to the neighbouring cluster whose shape is nearer.
//!
//! # Definition
//!
//! A pass looks at faces in their order. A face considers the clusters of its neighbours and takes the one where it
//! costs least (the smaller number of equal ones). It moves at once if it costs strictly less there than in its own,
//! and its cluster is seen to stay connected ([`Connection`]). The next pass looks at the faces that moved, those
//! beside them, and those whose cluster would not have stayed connected. Passes end with one in which nothing moves.
//!
//! Shapes are held, so that F falls by weight × difference of costs with every move, and by nothing else. Clusters stay
//! connected, and none gets empty: a face that is alone in its cluster does not move. With a tolerance, a face
//! considers only clusters of whose shape its corners are within the tolerance.
//!
//! # On a gpu
//!
//! Where a face would move depends on the labels of the faces beside it alone, since shapes are held. So a gpu first
//! looks at all faces of a long pass at once. The pass then goes on as defined: a face beside which one has moved is
//! looked at again.
//!
//! # Work
//!
//! The costs of a face fall with its moves, so that it is in each cluster once at most between two fits. Passes end
//! after [`LOOKS_A_FACE`] looks at all faces and their neighbours; scans take 10 to 60.

use super::faces::Faces;
use super::fitted::Fitted;
use super::proxy::Proxy;
use super::shape::Shape;
use super::tolerance::Tolerance;
use crate::cluster::connected::Connection;
use crate::device::{FREE, ShapeSteps};
use crate::error::{Error, Kind, Result};
use crate::surface::Moves;

/// Looks at a face or a neighbour of one, over all passes, on average.
const LOOKS_A_FACE: u64 = 1024;

/// Faces of a pass from which on a gpu looks at it: a dispatch and its wait take as long as the cpu for fewer.
const LONG: usize = 1024;

/// Of so many faces of the mesh, such a pass has one: the gpu takes the labels of all.
const LISTED_OF: usize = 64;

/// Of so many proposals of a gpu, the cpu compares one with its own. Of all that move a face it checks that the energy
/// falls.
const CHECKED: usize = 16;

/// A gpu that may take part in passes.
#[derive(Default)]
pub struct Gpu {
    /// What has the faces, if there is one.
    pub steps: Option<Box<dyn ShapeSteps>>,
    /// Whether a pass was long enough for it.
    pub has_taken_part: bool,
}

/// Clusters of faces, and what they cost.
#[derive(Debug)]
pub struct Clusters<'a> {
    /// The faces.
    pub faces: Faces<'a>,
    /// One a face.
    pub labels: Vec<u32>,
    /// The shape of each cluster, in units of moments.
    pub shapes: Vec<Shape>,
    /// The proxies of these.
    pub proxies: Vec<Proxy>,
    /// Σ w·cost over the faces of each cluster, below 2⁹¹·⁶.
    pub costs: Vec<i128>,
    /// Clusters that gained or lost a face since the last fit.
    pub has_changed: Vec<bool>,
    /// Moves as they were made since the last fits: (face, from, to).
    pub log: Vec<(u32, u32, u32)>,
    tolerance: Option<Tolerance<'a>>,
    sizes: Vec<u32>,
    connection: Connection,
    looks_left: u64,
}

impl<'a> Clusters<'a> {
    /// Of connected clusters, a fit for each.
    pub fn new(faces: Faces<'a>, tolerance: Option<Tolerance<'a>>, labels: Vec<u32>, fits: &[Fitted]) -> Self {
        let mut sizes = vec![0; fits.len()];
        labels.iter().for_each(|&label| sizes[label as usize] += 1);
        let connection = Connection::new(labels.len(), Moves::Connected);
        let looks_left = LOOKS_A_FACE * faces.all_looks() as u64;
        Self {
            faces,
            labels,
            shapes: fits.iter().map(|fit| fit.shape).collect(),
            proxies: fits.iter().map(|fit| fit.proxy).collect(),
            costs: fits.iter().map(|fit| fit.cost).collect(),
            has_changed: vec![true; fits.len()],
            log: Vec::new(),
            tolerance,
            sizes,
            connection,
            looks_left,
        }
    }

    /// Makes one of two clusters, given its faces and their shape.
    pub fn join(&mut self, from: u32, into: u32, members: &[u32], fit: Fitted) {
        let Fitted { shape, proxy, cost } = fit;
        members.iter().for_each(|&face| self.labels[face as usize] = into);
        self.look(members.len());
        self.sizes[from as usize] = 0;
        self.sizes[into as usize] = members.len() as u32;
        (self.shapes[into as usize], self.proxies[into as usize], self.costs[into as usize]) = (shape, proxy, cost);
    }

    /// Counts looks at faces as if passes had made them.
    pub fn look(&mut self, looks: usize) {
        self.looks_left = self.looks_left.saturating_sub(looks as u64);
    }

    /// Ends passes after so many looks at a face or a neighbour of one, on average.
    pub fn limit_looks(&mut self, looks: u64) {
        self.looks_left = looks * self.faces.all_looks() as u64;
    }

    /// Whether a bound on work has ended passes, or searches of the connection.
    pub fn is_bounded(&self) -> bool {
        self.looks_left == 0 || self.connection.is_bounded()
    }

    /// The faces at boundaries of some clusters.
    pub fn at_boundaries(&self, of: &[bool]) -> Vec<u32> {
        let is_at = |&face: &u32| {
            let own = self.labels[face as usize];
            let others = self.faces.graph.neighbours_of(face).iter().map(|&near| self.labels[near as usize]);
            others.filter(|&other| other != own).any(|other| of[own as usize] || of[other as usize])
        };
        (0..self.labels.len() as u32).filter(is_at).collect()
    }

    /// What a gpu says of each face of a long pass, as [`proposal`](Self::proposal); empty of other passes.
    ///
    /// # Errors
    /// Those of the gpu; [`Kind::DeviceWrong`] where it says something else than the cpu does.
    pub fn proposals(&self, faces: &[u32], gpu: &mut Gpu) -> Result<Vec<u32>> {
        let least = LONG.max(self.faces.count() / LISTED_OF);
        let Gpu { steps, has_taken_part } = gpu;
        let Some(steps) = steps.as_mut().filter(|_| faces.len() >= least) else { return Ok(Vec::new()) };
        *has_taken_part = true;
        let shapes: Vec<_> = self.proxies.iter().map(Proxy::words).collect();
        let proposals = steps.propose(&self.labels, &shapes, faces)?;
        let mut checked = faces.iter().zip(&proposals).step_by(CHECKED);
        match checked.find(|&(&face, &to)| to != self.proposal(face)) {
            Some((&face, &to)) => Err(wrong(face, to)),
            None => Ok(proposals),
        }
    }

    /// The cluster that a face would move to, [`FREE`] if to none.
    pub fn proposal(&self, face: u32) -> u32 {
        self.nearer(face).map_or(FREE, |best| best.to)
    }

    /// Makes a pass over faces, ascending, with the [`proposals`](Self::proposals) for them. Returns how many moved,
    /// and the faces for the next pass.
    ///
    /// # Errors
    /// [`Kind::DeviceWrong`] for a proposal that does not lower the energy.
    pub fn pass(&mut self, faces: &[u32], proposals: &[u32]) -> Result<(u64, Vec<u32>)> {
        self.look(self.faces.looks(faces));
        if self.looks_left == 0 {
            return Ok((0, Vec::new()));
        }
        let (mut moves, mut next) = (0, Vec::new());
        // faces beside which one has moved since the proposals
        let mut is_stale = vec![false; if proposals.is_empty() { 0 } else { self.labels.len() }];
        for (at, &face) in faces.iter().enumerate() {
            let best = match proposals.get(at) {
                Some(&FREE) if !is_stale[face as usize] => None,
                Some(&to) if !is_stale[face as usize] => Some(self.proposed(face, to)?),
                _ => self.nearer(face),
            };
            let is_not_alone = |_: &Move| self.sizes[self.labels[face as usize] as usize] > 1;
            let Some(Move { to, own, other }) = best.filter(is_not_alone) else { continue };
            next.push(face);
            if self.stays_connected_without(face) {
                self.move_face(face, to, [own, other]);
                let beside = self.faces.graph.neighbours_of(face);
                next.extend_from_slice(beside);
                if !is_stale.is_empty() {
                    beside.iter().for_each(|&near| is_stale[near as usize] = true);
                }
                moves += 1;
            }
        }
        if moves == 0 {
            return Ok((0, Vec::new()));
        }
        next.sort_unstable();
        next.dedup();
        Ok((moves, next))
    }

    /// The move that was proposed for a face.
    fn proposed(&self, face: u32, to: u32) -> Result<Move> {
        let from = self.labels[face as usize];
        let beside = self.faces.graph.neighbours_of(face);
        let is_beside = to != from && beside.iter().any(|&near| self.labels[near as usize] == to);
        let cost = |cluster: u32| self.proxies[cluster as usize].cost(self.faces.samples(face));
        let best = is_beside.then(|| Move { to, own: cost(from), other: cost(to) });
        best.filter(|best| best.other < best.own).ok_or_else(|| wrong(face, to))
    }

    /// The best move of a face, as if it were not alone in its cluster.
    #[inline]
    fn nearer(&self, face: u32) -> Option<Move> {
        let (other, to) = self.best_beside(face, &self.labels)?;
        let from = self.labels[face as usize];
        let own = self.proxies[from as usize].cost(self.faces.samples(face));
        (other < own).then_some(Move { to, own, other })
    }

    /// The other cluster beside a face where it costs least, and how much that is; with a tolerance, of those that it
    /// is within.
    #[inline]
    pub fn best_beside(&self, face: u32, labels: &[u32]) -> Option<(u64, u32)> {
        let samples = self.faces.samples(face);
        let cost = |cluster: u32| self.proxies[cluster as usize].cost(samples);
        let from = labels[face as usize];
        let mut last = from;
        let mut best: Option<(u64, u32)> = None;
        for &near in self.faces.graph.neighbours_of(face) {
            let to = labels[near as usize];
            if to != from && to != last {
                let other = (cost(to), to);
                if best.is_none_or(|best| other < best) && self.may_move(face, near, to) {
                    best = Some(other);
                }
                last = to;
            }
        }
        best
    }

    /// Whether a face is within the tolerance of the cluster of another, and that, if it is alone there, too.
    fn may_move(&self, face: u32, beside: u32, to: u32) -> bool {
        let admits = |tolerance: Tolerance<'_>| {
            let other = (self.sizes[to as usize] == 1).then_some(beside);
            tolerance.admits(&self.shapes[to as usize], other.into_iter().chain([face]))
        };
        self.tolerance.is_none_or(admits)
    }

    fn stays_connected_without(&mut self, face: u32) -> bool {
        let Self { faces, labels, connection, .. } = self;
        let from = labels[face as usize];
        connection.stays_without(faces.graph, face, |near| labels[near as usize] == from)
    }

    fn move_face(&mut self, face: u32, to: u32, costs: [u64; 2]) {
        let from = std::mem::replace(&mut self.labels[face as usize], to);
        let weight = i128::from(self.faces.weight(face));
        self.costs[from as usize] -= weight * i128::from(costs[0]);
        self.costs[to as usize] += weight * i128::from(costs[1]);
        self.sizes[from as usize] -= 1;
        self.sizes[to as usize] += 1;
        self.has_changed[from as usize] = true;
        self.has_changed[to as usize] = true;
        self.connection.moved(self.faces.graph, face);
        self.log.push((face, from, to));
    }
}

/// A move that lowers the energy.
struct Move {
    to: u32,
    /// The cost of the face where it is.
    own: u64,
    /// And where it would go.
    other: u64,
}

/// The error for a proposal of a gpu.
fn wrong(face: u32, to: u32) -> Error {
    let message = format_args!("the gpu computed wrongly: face {face} is not to move to cluster {to}");
    Error::new(Kind::DeviceWrong, message)
}
