//! Hubs: faces with very many neighbours, such as a polygon with a triangle at each edge.
//!
//! A merge of the cluster of a hub changes the costs of as many dual edges as the hub has neighbours, and optimisation
//! after a merge beside a hub looks at the hub. Where one pair merges at a time, such merges count these neighbours,
//! and there is a bound in proportion to the faces. Another one is of the faces that move after such merges: of
//! triangles at random they are a thousand times as many as there are.

use crate::energy::Functional;
use crate::surface::DualGraph;

/// A face with more neighbours is a hub.
const NEIGHBOURS: usize = 64;

/// Neighbours that merges count at most, for each face of the graph, and in any case.
const COUNTED: u64 = 256;
const LEAST_COUNTED: u64 = 1 << 22;

/// An optimised merge beside a hub counts such a part of the hub's neighbours.
const BESIDE: u64 = 16;

/// Faces that move after merges of one pair, at most: for each face of the graph and each halving of their number,
/// since merges of larger clusters move more, and in any case.
const MOVED: u64 = 2;
const LEAST_MOVED: u64 = 1 << 16;

/// The hubs of the clusters of a hierarchy.
pub(super) struct Hubs {
    /// How many neighbours the hubs of each cluster have; empty where there are no hubs.
    neighbours: Vec<u64>,
    /// How many the largest hub beside a face of each cluster has had.
    beside: Vec<u64>,
    /// Neighbours that merges may still count.
    left: u64,
    /// Faces that may still move.
    moves: u64,
}

impl Hubs {
    /// Each face is a cluster.
    pub fn new<E: Functional>(graph: &DualGraph<E>) -> Self {
        let neighbours: Vec<u64> = (0..graph.faces() as u32).map(|face| neighbours_of_hub(graph, face)).collect();
        let faces = neighbours.len() as u64;
        let left = LEAST_COUNTED.max(COUNTED * faces);
        let moves = LEAST_MOVED.max(MOVED * faces * u64::from(faces.max(1).ilog2()));
        if neighbours.iter().all(|&neighbours| neighbours == 0) {
            return Self { neighbours: Vec::new(), beside: Vec::new(), left, moves };
        }
        let beside = (0..graph.faces() as u32).map(|face| neighbours_beside(graph, face)).collect();
        Self { neighbours, beside, left, moves }
    }

    /// Whether merges have reached the bound.
    pub fn are_bounded(&self) -> bool {
        self.left == 0 || self.moves == 0
    }

    /// Counts a merge of one pair, which is optimised or not.
    pub fn count(&mut self, into: u32, is_optimised: bool) {
        let [own, beside] = [&self.neighbours, &self.beside].map(|of| of.get(into as usize).copied().unwrap_or(0));
        self.left = self.left.saturating_sub(own + if is_optimised { beside / BESIDE } else { 0 });
    }

    /// A cluster has become part of another.
    pub fn merged(&mut self, from: u32, into: u32) {
        if !self.neighbours.is_empty() {
            self.neighbours[into as usize] += std::mem::take(&mut self.neighbours[from as usize]);
            self.beside[into as usize] = self.beside[into as usize].max(self.beside[from as usize]);
        }
    }

    /// Faces have moved: (face, from, to); with `counts`, after a merge of one pair.
    pub fn moved<E: Functional>(&mut self, graph: &DualGraph<E>, moves: &[(u32, u32, u32)], counts: bool) {
        self.moves = self.moves.saturating_sub(if counts { moves.len() as u64 } else { 0 });
        if self.neighbours.is_empty() {
            return;
        }
        for &(face, from, to) in moves {
            let neighbours = neighbours_of_hub(graph, face);
            self.neighbours[from as usize] -= neighbours;
            self.neighbours[to as usize] += neighbours;
            self.beside[to as usize] = self.beside[to as usize].max(neighbours_beside(graph, face));
        }
    }
}

/// The number of neighbours of a face, 0 of one that is no hub.
fn neighbours_of_hub<E: Functional>(graph: &DualGraph<E>, face: u32) -> u64 {
    let neighbours = graph.neighbours_of(face).len();
    if neighbours > NEIGHBOURS { neighbours as u64 } else { 0 }
}

/// Those of the largest hub beside a face.
fn neighbours_beside<E: Functional>(graph: &DualGraph<E>, face: u32) -> u64 {
    graph.neighbours_of(face).iter().map(|&near| neighbours_of_hub(graph, near)).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::hard::cone;
    use crate::surface::Surface;

    #[test]
    fn moves_count_after_merges_of_one_pair() {
        let surface = Surface::build(&cone(3200)).expect("a surface");
        let moves_until_bounded = |counts: bool| {
            let mut hubs = Hubs::new(&surface.items.graph);
            (0u64..1000).find(|_| {
                hubs.moved(&surface.items.graph, &[(5, 5, 5); 1000], counts);
                hubs.are_bounded()
            })
        };
        // 2·3,201·11 are more than 2¹⁶
        assert_eq!(moves_until_bounded(true), Some(70));
        assert_eq!(moves_until_bounded(false), None);
    }

    #[test]
    fn merges_beside_a_hub_count_if_they_are_optimised() {
        let surface = Surface::build(&cone(3200)).expect("a surface");
        let hub = (0..3201).find(|&face| surface.neighbours_of(face).len() == 3200).expect("the base");
        let merges_until_bounded = |into: u32, is_optimised: bool| {
            let mut hubs = Hubs::new(&surface.items.graph);
            (0u64..100_000).find(|_| {
                hubs.count(into, is_optimised);
                hubs.are_bounded()
            })
        };
        assert_eq!(merges_until_bounded(hub, false), Some((1 << 22) / 3200));
        let side = if hub > 1 { 0 } else { 2 };
        assert_eq!(merges_until_bounded(side, true), Some((1 << 22) / 200));
        assert_eq!(merges_until_bounded(side, false), None);
    }
}
