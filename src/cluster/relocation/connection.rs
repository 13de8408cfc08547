//! Whether a cluster stays connected without one of its faces.
//!
//! A search starts at each neighbour of the face inside the cluster. The searches take turns, one dual edge each, and
//! unite where they meet. The cluster stays connected if all unite; it falls apart if those that have united have
//! nothing left to search. Where a face cuts off a small piece, the effort is that of the piece; a face with very many
//! neighbours holds up only its own search.

use crate::surface::DualGraph;
use crate::union_find;

/// Searches, with memory that is kept between them.
#[derive(Debug, Clone)]
pub struct Connection {
    /// The search that has reached each face, plus `first`; smaller numbers are of earlier calls.
    reached_by: Vec<u32>,
    first: u32,
}

/// A search.
struct Search {
    reached: Vec<u32>,
    /// The face whose neighbours it looks at, as a place in `reached`.
    at: usize,
    /// The next of these neighbours.
    next: usize,
}

impl Connection {
    /// For a graph of this many faces.
    pub fn new(faces: usize) -> Self {
        Self { reached_by: vec![0; faces], first: 1 }
    }

    /// Whether the faces that are inside, which are connected, stay so without `face`, which is one of them.
    pub fn stays_without(&mut self, graph: &DualGraph, face: u32, is_inside: impl Fn(u32) -> bool) -> bool {
        let beside = graph.neighbours_of(face);
        if self.first > u32::MAX - beside.len() as u32 {
            self.reached_by.fill(0);
            self.first = 1;
        }
        let first = self.first;
        let mut searches = Vec::new();
        for &near in beside {
            if is_inside(near) && self.reached_by[near as usize] < first {
                self.reached_by[near as usize] = first + searches.len() as u32;
                searches.push(Search { reached: vec![near], at: 0, next: 0 });
            }
        }
        let count = searches.len();
        self.first += count as u32;
        let mut sets = union_find::singletons(count);
        let mut unfinished = vec![1u32; count];
        let mut left = count;
        // searches that are not finished
        let mut turns: Vec<u32> = (0..count as u32).collect();
        while left > 1 {
            let mut is_apart = false;
            turns.retain(|&number| {
                if left <= 1 || is_apart {
                    return true;
                }
                let search = &mut searches[number as usize];
                let root = union_find::root(&mut sets, number);
                let Some(near) = search.next_face(graph) else {
                    unfinished[root as usize] -= 1;
                    is_apart = unfinished[root as usize] == 0;
                    return false;
                };
                if near == face || !is_inside(near) {
                    return true;
                }
                let reached_by = &mut self.reached_by[near as usize];
                if *reached_by < first {
                    *reached_by = first + number;
                    search.reached.push(near);
                    return true;
                }
                let other = union_find::root(&mut sets, *reached_by - first);
                if union_find::join(&mut sets, root, other) {
                    let (low, high) = (root.min(other) as usize, root.max(other) as usize);
                    unfinished[low] += unfinished[high];
                    left -= 1;
                }
                true
            });
            if is_apart {
                return false;
            }
        }
        true
    }
}

impl Search {
    /// The next neighbour of a face that was reached.
    fn next_face(&mut self, graph: &DualGraph) -> Option<u32> {
        loop {
            let beside = graph.neighbours_of(*self.reached.get(self.at)?);
            if let Some(&near) = beside.get(self.next) {
                self.next += 1;
                return Some(near);
            }
            self.at += 1;
            self.next = 0;
        }
    }
}
