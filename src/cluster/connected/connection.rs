//! Whether a cluster stays connected without one of its faces.
//!
//! A short [detour](surely_stays_connected) around the face shows it at once. Without one, a search starts at each
//! neighbour of the face inside the cluster. The searches take turns, one face each, and unite where they meet. The
//! cluster stays connected if all unite; it falls apart if one has nothing left to search. Where a face cuts off a
//! small piece, the effort is that of the piece.
//!
//! # Work
//!
//! Where detours lead round holes, or clusters are ragged, searches are long, and most fail. So their steps are
//! counted. After [`HOLD_FROM`] for each face, a face whose search failed is held: it needs a detour until it or a face
//! beside it has moved. Where [`Moves`] are connected, that is so from the first search on: clusters of an image are
//! ragged all along, and energies end no higher. After [`STEPS`] for each face there are no more searches. A move may
//! be missed; the cluster stays connected. Where faces are held at once, searches also fail after [`STEPS_A_SEARCH`]
//! for each of them: most that unite take fewer, and one that fails would take as many as the piece that the face cuts
//! off has dual edges.

use std::collections::VecDeque;

use crate::energy::Functional;
use crate::surface::detour::surely_stays_connected;
use crate::surface::{DualGraph, Moves};
use crate::union_find;

/// Steps of searches, for each face of the graph, before faces are held. A step looks at a dual edge.
const HOLD_FROM: u64 = 128;

/// Steps, for each face, after which there are no more searches.
const STEPS: u64 = 1024;

/// Steps of each search after which they fail, where faces are held at once.
const STEPS_A_SEARCH: u64 = 1024;

/// Searches, with memory that is kept between them.
#[derive(Debug, Clone)]
pub struct Connection {
    /// Steps so far.
    pub(super) steps: u64,
    /// Whether faces are held from the first failed search on.
    holds_at_once: bool,
    /// Faces whose last search failed while faces are held, and beside which nothing has moved since.
    is_held: Vec<bool>,
    /// The search that has reached each face, plus `first`; smaller numbers are of earlier calls.
    reached_by: Vec<u32>,
    first: u32,
}

impl Connection {
    /// For a graph of this many faces, which move so.
    pub fn new(faces: usize, moves: Moves) -> Self {
        let holds_at_once = moves == Moves::Connected;
        Self { steps: 0, holds_at_once, is_held: vec![false; faces], reached_by: vec![0; faces], first: 1 }
    }

    /// Whether moves may be missed from now on that earlier searches would have allowed.
    pub fn is_bounded(&self) -> bool {
        self.has_made(if self.holds_at_once { STEPS } else { HOLD_FROM })
    }

    fn has_made(&self, steps_a_face: u64) -> bool {
        self.steps >= steps_a_face * self.is_held.len() as u64
    }

    /// Notes that a face has moved.
    pub fn moved<E: Functional>(&mut self, graph: &DualGraph<E>, face: u32) {
        self.is_held[face as usize] = false;
        graph.neighbours_of(face).iter().for_each(|&near| self.is_held[near as usize] = false);
    }

    /// Whether the faces that are inside, which are connected, are seen to stay so without `face`, one of them.
    pub fn stays_without<E: Functional>(
        &mut self,
        graph: &DualGraph<E>,
        face: u32,
        is_inside: impl Fn(u32) -> bool,
    ) -> bool {
        let is_left = |near: u32| near != face && is_inside(near);
        if surely_stays_connected(graph, face, is_left) {
            return true;
        }
        if self.is_held[face as usize] || self.has_made(STEPS) {
            return false;
        }
        let unite = self.searches_unite(graph, face, is_left);
        self.is_held[face as usize] = !unite && (self.holds_at_once || self.is_bounded());
        unite
    }

    fn searches_unite<E: Functional>(
        &mut self,
        graph: &DualGraph<E>,
        face: u32,
        is_left: impl Fn(u32) -> bool,
    ) -> bool {
        let beside = graph.neighbours_of(face);
        if self.first > u32::MAX - beside.len() as u32 {
            self.reached_by.fill(0);
            self.first = 1;
        }
        let first = self.first;
        // the faces that each search has reached, and whose neighbours it has not looked at
        let mut reached: Vec<VecDeque<u32>> = Vec::new();
        for &near in beside {
            if is_left(near) && self.reached_by[near as usize] < first {
                self.reached_by[near as usize] = first + reached.len() as u32;
                reached.push(VecDeque::from([near]));
            }
        }
        self.first += reached.len() as u32;
        // a search that has united with another is no root, and ends
        let mut sets = union_find::singletons(reached.len());
        let mut turns: VecDeque<u32> = sets.iter().copied().collect();
        let mut left = reached.len();
        let most = if self.holds_at_once { STEPS_A_SEARCH * left as u64 } else { u64::MAX };
        let before = self.steps;
        while left > 1 && self.steps - before < most {
            let Some(number) = turns.pop_front() else { break };
            if sets[number as usize] != number {
                continue;
            }
            let Some(at) = reached[number as usize].pop_front() else { break };
            for &near in graph.neighbours_of(at).iter().filter(|&&near| is_left(near)) {
                let reached_by = &mut self.reached_by[near as usize];
                if *reached_by < first {
                    *reached_by = first + number;
                    reached[number as usize].push_back(near);
                    continue;
                }
                let other = union_find::root(&mut sets, *reached_by - first);
                if other != number {
                    sets[other as usize] = number;
                    let united = std::mem::take(&mut reached[other as usize]);
                    self.steps += united.len() as u64;
                    reached[number as usize].extend(united);
                    left -= 1;
                }
            }
            self.steps += graph.neighbours_of(at).len() as u64;
            turns.push_back(number);
        }
        left <= 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::relocation::tests::{start, uneven};
    use crate::dev::sample::Sample;
    use crate::device::pieces::cut_off_faces;
    use crate::surface::{Component, Rows};

    #[test]
    fn searches_find_the_faces_that_hold_a_cluster_together() {
        let mut held = 0;
        for sample in [Sample::Strip, Sample::Parts, Sample::Plane] {
            let surface = uneven(sample, 300);
            let labels = start(&surface, 20);
            let mut connection = Connection::new(surface.faces(), Moves::Free);
            for face in 0..surface.faces() as u32 {
                let label = labels[face as usize];
                if labels.iter().filter(|&&other| other == label).count() == 1 {
                    continue;
                }
                let mut without = labels.clone();
                without[face as usize] = 20;
                let expected = cut_off_faces(&surface, 21, &without).is_empty();
                let found = connection.stays_without(&surface, face, |near| labels[near as usize] == label);
                assert_eq!(found, expected, "{} {face}", sample.name());
                held += u32::from(!expected);
            }
        }
        assert!(held > 0);
    }

    /// Faces in a ring: without one of them, the way between its neighbours is as long as the ring.
    fn ring(faces: u32) -> DualGraph {
        DualGraph {
            points: vec![[0; 3]; faces as usize],
            weights: vec![1; faces as usize],
            neighbours: Rows {
                offsets: (0..=faces).map(|face| 2 * face).collect(),
                items: (0..faces).flat_map(|face| [(face + 1) % faces, (face + faces - 1) % faces]).collect(),
            },
            components: vec![Component { first_face: 0, faces, weight: u64::from(faces), energy_shift: 0 }],
            moves: Moves::Free,
        }
    }

    #[test]
    fn after_many_steps_a_face_that_is_refused_is_held_until_a_face_beside_it_moves() {
        let ring = ring(100);
        let mut connection = Connection::new(100, Moves::Free);
        let has_gap = |near| near != 0;
        for _ in 0..1000 {
            assert!(!connection.stays_without(&ring, 50, has_gap), "0 is a gap, so that 50 holds two arcs together");
        }
        assert!(connection.is_bounded());
        assert!(connection.stays_without(&ring, 20, |_| true), "faces that were not refused since then are not held");
        assert!(!connection.stays_without(&ring, 50, has_gap));
        assert!(!connection.stays_without(&ring, 50, |_| true), "the gap is closed, far from 50");
        connection.moved(&ring, 0);
        assert!(!connection.stays_without(&ring, 50, |_| true));
        connection.moved(&ring, 49);
        assert!(connection.stays_without(&ring, 50, |_| true));
    }

    #[test]
    fn searches_end_at_a_bound_in_proportion_to_the_faces() {
        let ring = ring(400);
        let mut connection = Connection::new(400, Moves::Free);
        let unite = (0..10_000).take_while(|_| connection.stays_without(&ring, 7, |_| true)).count();
        // a search looks at two dual edges a face
        assert!((500..=520).contains(&unite), "{unite}");
        connection.moved(&ring, 7);
        assert!(!connection.stays_without(&ring, 7, |_| true), "there are no more searches");
        assert!(connection.stays_without(&ring, 7, |near| near != 8), "short ways are seen");
    }

    #[test]
    fn where_moves_are_connected_long_searches_fail() {
        for (faces, unite) in [(1000, true), (1100, false)] {
            let ring = ring(faces);
            let mut connection = Connection::new(faces as usize, Moves::Connected);
            assert_eq!(connection.stays_without(&ring, 7, |_| true), unite, "{faces}");
            assert!(connection.steps <= 2 * STEPS_A_SEARCH);
        }
    }
}
