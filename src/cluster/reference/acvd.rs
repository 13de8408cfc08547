//! Approximated centroidal Voronoi diagrams: energy minimisation by local queries over a queue of boundary edges
//! (Valette & Chassery, "Approximated Centroidal Voronoi Diagrams for Uniform Polygonal Mesh Coarsening", 2004; the
//! paper's ACVD).
//!
//! # Definition
//!
//! The clusters grow from their seeds as in [`crate::cluster::flat`]. The queue then holds every boundary edge: two
//! faces that share an edge and belong to different clusters, in the order of the face with the smaller internal
//! number, then of its neighbours. A pass takes them one after the other. For faces m in cluster a and n in cluster b
//! there are three configurations: as it is, m in b, n in a. The one with the lowest F is taken at once, m's move
//! before n's where both lower it equally, and never one that leaves a cluster empty. An edge that still lies between
//! clusters goes back to the end of the queue, and a face that moved adds its other edges that have come to lie between
//! clusters.
//!
//! *Flood.* From pass 256 on ([`FLOOD_FROM`]), the edges that a face adds when it moves are taken next, in the same
//! pass: a border then goes where it wants to in one pass, not by a face a pass.
//!
//! An edge need not be tested while neither of its clusters has changed since its last test. The phase ends with a pass
//! in which nothing moves: then no face at a boundary can lower F by going across.
//!
//! F is compared exactly, before and after, with respect to the lattice proxies. It falls with every move, so there are
//! finitely many.
//!
//! # Connectivity
//!
//! As in [`crate::cluster::connected`]: one repair, then connected refinement.

use std::collections::VecDeque;

use crate::cluster::connected::Clusters;
use crate::cluster::flat::{Clustering, Options, grown};
use crate::cluster::record::Record;
use crate::cluster::run::{Phase, Row};
use crate::cluster::seeds::SeedFaces;
use crate::device::{Cancel, Ending, FLOOD_FROM, OnStep, Step, Steps};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::Items;

/// Clusters a surface from the given seeds, and keeps the labels that `record` wants. Growth and repairs are the
/// device's; `options.refine` has no meaning here.
pub fn acvd<E: Functional>(
    items: &Items<E>,
    seeds: &SeedFaces,
    options: Options,
    steps: &mut dyn Steps,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
    record: &mut Record,
) -> Result<Clustering> {
    let (mut run, initial) = grown(&seeds.labels(items.faces()), options, steps, cancel, on_row, record)?;
    let ending = run.complete(items, options.allow_disconnected, |run| {
        let labels = run.steps.labels()?;
        let mut queries = LocalQueries::new(items, Clusters::new(items, labels));
        run.phase(Phase::Refine, |steps, left, cancel, on_step| {
            let ending = queries.minimise(left, cancel, on_step)?;
            steps.set_labels(queries.clusters.labels())?;
            Ok(ending)
        })
    })?;
    Ok(Clustering { initial, labels: run.steps.labels()?, ending })
}

/// The state of a minimisation.
struct LocalQueries<'a, E: Functional> {
    items: &'a Items<E>,
    clusters: Clusters<'a, E>,
    /// The boundary edges, and maybe some that no longer are.
    queue: VecDeque<Edge>,
    /// In a flood, the edges that are taken before those of the queue.
    ahead: VecDeque<Edge>,
    /// Passes begun.
    passes: u32,
    /// For each face the places of its neighbours, in the order of their numbers.
    places: Vec<u32>,
    /// Whether an edge is queued, by its place among the neighbours of its lower face.
    is_queued: Vec<bool>,
    /// When each edge was last tested, by the same place; 0 for never.
    tested_at: Vec<u64>,
    /// When each cluster last gained or lost a face.
    changed_at: Vec<u64>,
    /// Counts tests and moves.
    now: u64,
}

/// Two faces that share an edge.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// The face with the smaller number.
    low: u32,
    /// The other one's place in the rows of neighbours.
    place: u32,
}

impl<'a, E: Functional> LocalQueries<'a, E> {
    /// Queues all boundary edges.
    fn new(items: &'a Items<E>, clusters: Clusters<'a, E>) -> Self {
        let edges = items.neighbours.items.len();
        let mut places: Vec<u32> = (0..edges as u32).collect();
        for row in items.neighbours.offsets.windows(2) {
            places[row[0] as usize..row[1] as usize].sort_by_key(|&place| items.neighbours.items[place as usize]);
        }
        let changed_at = vec![1; clusters.numbers().len()];
        let mut queries = Self {
            items,
            clusters,
            queue: VecDeque::new(),
            ahead: VecDeque::new(),
            passes: 0,
            places,
            is_queued: vec![false; edges],
            tested_at: vec![0; edges],
            changed_at,
            now: 1,
        };
        for face in 0..items.faces() as u32 {
            queries.queue_edges(face);
        }
        queries
    }

    /// Makes passes through the queue until one moves nothing.
    fn minimise(&mut self, max_passes: u32, cancel: &Cancel, on_pass: OnStep<'_>) -> Result<Ending> {
        for _ in 0..max_passes {
            cancel.check()?;
            let moves = self.pass();
            if moves == 0 {
                return Ok(Ending::Converged);
            }
            on_pass(Step { energy: self.clusters.energy(), moves });
        }
        Ok(Ending::IterationLimit)
    }

    /// Takes every edge that is in the queue now; returns how many faces moved.
    fn pass(&mut self) -> u64 {
        self.passes = self.passes.saturating_add(1);
        let mut moves = 0;
        for _ in 0..self.queue.len() {
            let mut next = self.queue.pop_front();
            while let Some(edge) = next {
                self.is_queued[edge.place as usize] = false;
                moves += u64::from(self.query(edge));
                self.push_boundary(edge, false);
                next = self.ahead.pop_front();
            }
        }
        moves
    }

    /// Takes the best of the three configurations of an edge. Returns whether a face moved.
    fn query(&mut self, Edge { low, place }: Edge) -> bool {
        let high = self.items.neighbours.items[place as usize];
        let [a, b] = [low, high].map(|face| self.clusters.label(face));
        let changed_at = self.changed_at[a as usize].max(self.changed_at[b as usize]);
        if a == b || changed_at < self.tested_at[place as usize] {
            return false;
        }
        self.now += 1;
        self.tested_at[place as usize] = self.now;
        let low_moves = self.clusters.fall(low, b).unwrap_or(0);
        let high_moves = self.clusters.fall(high, a).unwrap_or(0);
        if low_moves.max(high_moves) <= 0 {
            return false;
        }
        let (face, to) = if low_moves >= high_moves { (low, b) } else { (high, a) };
        self.clusters.relabel(std::iter::once((face, to)));
        self.now += 1;
        self.changed_at[a as usize] = self.now;
        self.changed_at[b as usize] = self.now;
        self.queue_edges(face);
        true
    }

    /// Queues the boundary edges of a face.
    fn queue_edges(&mut self, face: u32) {
        let items = self.items;
        let first = items.neighbours.offsets[face as usize];
        for (at, &near) in items.neighbours_of(face).iter().enumerate() {
            let edge = match face < near {
                true => Some(Edge { low: face, place: first + at as u32 }),
                // the same edge, seen from the other face
                false => self.place_of(near, face).map(|place| Edge { low: near, place }),
            };
            if let Some(edge) = edge {
                self.push_boundary(edge, self.passes >= FLOOD_FROM);
            }
        }
    }

    /// The first place of a neighbour among those of a face.
    fn place_of(&self, face: u32, neighbour: u32) -> Option<u32> {
        let [start, end] = [face, face + 1].map(|face| self.items.neighbours.offsets[face as usize] as usize);
        let row = &self.places[start..end];
        let found = row.partition_point(|&place| self.items.neighbours.items[place as usize] < neighbour);
        row.get(found).copied().filter(|&place| self.items.neighbours.items[place as usize] == neighbour)
    }

    /// Puts an edge at the end of the queue, or of those that are taken before it, if it lies between clusters and is
    /// not queued.
    fn push_boundary(&mut self, edge: Edge, is_ahead: bool) {
        let [low, high] = [edge.low, self.items.neighbours.items[edge.place as usize]];
        let is_queued = &mut self.is_queued[edge.place as usize];
        if self.clusters.label(low) != self.clusters.label(high) && !*is_queued {
            *is_queued = true;
            if is_ahead { self.ahead.push_back(edge) } else { self.queue.push_back(edge) }
        }
    }
}
