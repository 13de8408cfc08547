//! Cells, arcs and junctions of a cut surface whose triangles are in cells; definitions in [`super`].

use std::ops::Range;

use super::half_edges::{HalfEdges, NONE, next, previous};

/// How cells meet.
#[derive(Debug)]
pub struct Complex<'a> {
    /// The surface.
    pub halves: &'a HalfEdges,
    /// The cell of each triangle.
    pub cells: &'a [u32],
    /// All arcs, by the cells on their left, those on their right (none last), and their first half-edges.
    pub arcs: Vec<Arc>,
    /// The half-edges of arcs, one after the other.
    chains: Vec<u32>,
    /// All junctions.
    pub junctions: Vec<Junction>,
    /// The half-edges that begin the sectors of junctions.
    sectors: Vec<u32>,
    /// The arc of each half-edge of a chain and of its twin.
    arc_of: Vec<u32>,
}

/// A maximal chain of edges between two cells, or of boundary edges of one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arc {
    /// The cell on its left, seen from outside.
    pub left: u32,
    /// The cell on its right, a higher number; none at a boundary.
    pub right: Option<u32>,
    /// The junctions where it starts and ends; none of a closed one.
    pub ends: Option<[u32; 2]>,
    chain: Range<usize>,
}

/// A vertex at which at least three sectors meet; on a boundary, at least two.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Junction {
    /// The vertex of the cut surface.
    pub umbrella: u32,
    /// On a boundary, the boundary half-edge that arrives.
    pub arriving: Option<u32>,
    sectors: Range<usize>,
}

impl Arc {
    /// Whether it ends at the junction where it starts.
    pub fn returns(&self) -> bool {
        self.ends.is_some_and(|[start, end]| start == end)
    }
}

impl<'a> Complex<'a> {
    /// Finds arcs and junctions. `crossing`: all half-edges with another cell, or none, on their right, ascending.
    pub fn new(halves: &'a HalfEdges, cells: &'a [u32], crossing: &[u32]) -> Self {
        let mut complex = Self {
            halves,
            cells,
            arcs: Vec::new(),
            chains: Vec::new(),
            junctions: Vec::new(),
            sectors: Vec::new(),
            arc_of: Vec::new(),
        };
        let junction_of = complex.find_junctions(crossing);
        complex.trace_arcs(crossing, &junction_of);
        complex
    }

    /// The half-edges of an arc, its left cell on their left.
    pub fn chain(&self, arc: &Arc) -> &[u32] {
        &self.chains[arc.chain.clone()]
    }

    /// The half-edges that leave a junction where its sectors begin, counter-clockwise. A sector is in the cell on the
    /// left of its half-edge. On a boundary, the first is the boundary half-edge.
    pub fn sectors(&self, junction: &Junction) -> &[u32] {
        &self.sectors[junction.sectors.clone()]
    }

    /// The cell on the left of a half-edge.
    #[inline]
    pub fn left(&self, half: u32) -> u32 {
        self.cells[half as usize / 3]
    }

    /// The arc of a half-edge that crosses, and whether the half-edge runs along it rather than against it.
    pub fn arc_at(&self, half: u32) -> (usize, bool) {
        (self.arc_of[half as usize] as usize, self.runs_along(half))
    }

    fn runs_along(&self, half: u32) -> bool {
        let twin = self.halves.twins[half as usize];
        twin == NONE || self.left(half) < self.left(twin)
    }

    /// Finds the junctions; gives that of each umbrella, or [`NONE`].
    fn find_junctions(&mut self, crossing: &[u32]) -> Vec<u32> {
        let halves = self.halves;
        let mut leaving = vec![0u8; halves.umbrellas.len()];
        for &half in crossing {
            let count = &mut leaving[halves.umbrella[half as usize] as usize];
            *count = count.saturating_add(1);
        }
        let mut junction_of = vec![NONE; halves.umbrellas.len()];
        for &half in crossing {
            let number = halves.umbrella[half as usize];
            let umbrella = halves.umbrellas[number as usize];
            let least = if umbrella.is_open { 2 } else { 3 };
            if leaving[number as usize] < least || junction_of[number as usize] != NONE {
                continue;
            }
            junction_of[number as usize] = self.junctions.len() as u32;
            let first = if umbrella.is_open { umbrella.first } else { half };
            let begin = self.sectors.len();
            let mut at = first;
            let arriving = loop {
                if halves.crosses(self.cells, at) {
                    self.sectors.push(at);
                }
                let arriving = previous(at);
                at = halves.twins[arriving as usize];
                if at == NONE {
                    break Some(arriving);
                }
                if at == first {
                    break None;
                }
            };
            let sectors = begin..self.sectors.len();
            self.junctions.push(Junction { umbrella: number, arriving, sectors });
        }
        junction_of
    }

    /// Follows all arcs: first those that start at a junction, then closed ones.
    fn trace_arcs(&mut self, crossing: &[u32], junction_of: &[u32]) {
        let halves = self.halves;
        self.arc_of = vec![NONE; halves.twins.len()];
        let junction_at = |half: u32| junction_of[halves.umbrella[half as usize] as usize];
        for closed in [false, true] {
            for &first in crossing {
                let is_new = self.arc_of[first as usize] == NONE && (closed || junction_at(first) != NONE);
                if !is_new || !self.runs_along(first) {
                    continue;
                }
                let begin = self.chains.len();
                let mut half = first;
                let end = loop {
                    self.chains.push(half);
                    self.arc_of[half as usize] = 0;
                    half = next(half);
                    if !closed && junction_at(half) != NONE {
                        break junction_at(half);
                    }
                    while !halves.crosses(self.cells, half) {
                        half = next(halves.twins[half as usize]);
                    }
                    if half == first {
                        break NONE;
                    }
                };
                let twin = halves.twins[first as usize];
                self.arcs.push(Arc {
                    left: self.left(first),
                    right: (twin != NONE).then(|| self.left(twin)),
                    ends: (!closed).then(|| [junction_at(first), end]),
                    chain: begin..self.chains.len(),
                });
            }
        }
        let chains = &self.chains;
        self.arcs.sort_by_key(|arc| (arc.left, arc.right.unwrap_or(NONE), chains[arc.chain.start]));
        for (number, arc) in (0..).zip(&self.arcs) {
            for &half in &self.chains[arc.chain.clone()] {
                self.arc_of[half as usize] = number;
                let twin = halves.twins[half as usize];
                if twin != NONE {
                    self.arc_of[twin as usize] = number;
                }
            }
        }
    }
}
