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
//! # Work
//!
//! The costs of a face fall with its moves, so that it is in each cluster once at most between two fits. Passes end
//! after [`LOOKS`] looks at all faces and their neighbours; scans take 10 to 60.

use super::faces::Faces;
use super::fitted::Fitted;
use super::proxy::Proxy;
use super::shape::Shape;
use super::tolerance::Tolerance;
use crate::cluster::relocation::Connection;
use crate::surface::Moves;

/// Looks at a face or a neighbour of one, over all passes, on average.
const LOOKS: u64 = 1024;

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
    /// Moves as they were made, if they are kept: (face, from, to).
    pub log: Option<Vec<(u32, u32, u32)>>,
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
        let looks_left = LOOKS * faces.all_looks() as u64;
        Self {
            faces,
            labels,
            shapes: fits.iter().map(|fit| fit.shape).collect(),
            proxies: fits.iter().map(|fit| fit.proxy).collect(),
            costs: fits.iter().map(|fit| fit.cost).collect(),
            has_changed: vec![true; fits.len()],
            log: None,
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

    /// Makes a pass over faces, ascending. Returns how many moved, and the faces for the next pass.
    pub fn pass(&mut self, faces: &[u32]) -> (u64, Vec<u32>) {
        self.look(self.faces.looks(faces));
        if self.looks_left == 0 {
            return (0, Vec::new());
        }
        let (mut moves, mut next) = (0, Vec::new());
        for &face in faces {
            let Some(Move { to, own, other }) = self.best_move(face) else { continue };
            next.push(face);
            if self.stays_connected_without(face) {
                self.move_face(face, to, [own, other]);
                next.extend_from_slice(self.faces.graph.neighbours_of(face));
                moves += 1;
            }
        }
        if moves == 0 {
            return (0, Vec::new());
        }
        next.sort_unstable();
        next.dedup();
        (moves, next)
    }

    fn best_move(&self, face: u32) -> Option<Move> {
        let (other, to) = self.best_beside(face, &self.labels)?;
        let from = self.labels[face as usize];
        let own = self.proxies[from as usize].cost(self.faces.samples(face));
        (other < own && self.sizes[from as usize] > 1).then_some(Move { to, own, other })
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
        if let Some(log) = &mut self.log {
            log.push((face, from, to));
        }
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
