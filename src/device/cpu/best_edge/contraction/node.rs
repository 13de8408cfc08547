//! Nodes of the contraction, their edges and rough costs.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use crate::energy::{End, Functional};

/// No node.
pub const NO_NODE: u32 = u32::MAX;

/// What searches read of a neighbour, in half a cache line.
#[derive(Debug)]
#[repr(align(32))]
pub struct Node<E: Functional> {
    pub end: End<E::Point, f32>,
    pub status: Status,
    /// Its best edge, packed. Written by the node's own search. Before that search, the search of a neighbour that grew
    /// may reset it to [`Edge::LOST`]; offers are applied between the two.
    pub best: AtomicU64,
}

/// The edges of a node as of its last search, which wrote them.
#[derive(Debug)]
pub struct NodeEdges {
    /// Index of its first edge.
    pub start: usize,
    /// Number of its edges.
    pub len: AtomicU32,
    /// The round of that search; [`super::NEVER`] if all costs have to be computed.
    pub searched: AtomicU32,
}

/// Whether and how a node has changed.
#[derive(Debug, Clone, Copy)]
pub struct Status {
    /// The node that it was merged into; itself while it lives.
    pub into: u32,
    /// The round in which it last grew.
    pub grown: u32,
}

/// A node that grew.
#[derive(Debug)]
pub struct Grown {
    pub node: u32,
    /// The rows of the two nodes that merged.
    pub rows: [Range<usize>; 2],
}

/// A neighbour, or [`NO_NODE`], and the rough cost of merging with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    pub other: u32,
    pub cost: f32,
}

/// The living node that a node is part of. Of two clusters that merge, the one with more faces lives on, so that no way
/// there is longer than the logarithm of the faces.
pub fn resolve<E: Functional>(nodes: &[Node<E>], mut node: u32) -> u32 {
    loop {
        let into = nodes[node as usize].status.into;
        if into == node {
            return node;
        }
        node = into;
    }
}

impl<E: Functional> Node<E> {
    pub fn best(&self) -> Edge {
        Edge::unpacked(self.best.load(Relaxed))
    }

    pub fn set_best(&self, edge: Edge) {
        self.best.store(edge.packed(), Relaxed);
    }

    /// Resets the best edge. Returns whether this is the first time in the round.
    pub fn lose_best(&self) -> bool {
        self.best.swap(Edge::LOST.packed(), Relaxed) != Edge::LOST.packed()
    }
}

impl NodeEdges {
    pub fn new(start: usize, len: u32, searched: u32) -> Self {
        Self { start, len: len.into(), searched: searched.into() }
    }

    pub fn edges(&self) -> Range<usize> {
        self.start..self.start + self.len.load(Relaxed) as usize
    }

    pub fn searched(&self) -> u32 {
        self.searched.load(Relaxed)
    }

    /// Stores the length of the row after the search of a round.
    pub fn renew(&self, len: usize, round: u32) {
        self.len.store(len as u32, Relaxed);
        self.searched.store(round, Relaxed);
    }
}

impl Status {
    /// Whether the node of this status is what it was at the end of a round.
    pub fn is_unchanged_since(self, node: u32, round: u32) -> bool {
        self.into == node && self.grown <= round
    }
}

impl Edge {
    pub const NONE: Self = Self { other: NO_NODE, cost: f32::INFINITY };

    /// In place of the best edge of a node that has to search.
    pub const LOST: Self = Self { other: NO_NODE, cost: -1.0 };

    /// Packed so that the order is that of the costs, which are not negative.
    pub fn packed(self) -> u64 {
        u64::from(self.cost.to_bits()) << 32 | u64::from(self.other)
    }

    pub fn unpacked(packed: u64) -> Self {
        Self { other: packed as u32, cost: f32::from_bits((packed >> 32) as u32) }
    }
}
