//! Half-edges in one bucket for each lower end vertex, and the links of the faces of each edge.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

use super::{CHAINED, Edges, NONE};

/// The half-edges whose lower end is in a range of positions, a bucket for each.
///
/// A bucket is a list through `linked`: until an edge's links are known, each half-edge has the one before it there.
pub struct Buckets<'a> {
    edges: &'a Edges<'a>,
    linked: &'a [AtomicU32],
    /// First position of the range.
    first: u32,
    /// The last half-edge of each bucket.
    last: Vec<u32>,
}

/// Largest bucket that is not sorted.
const MOST_UNSORTED: usize = 32;

/// The half-edges of an edge: its lower end, how many there are (at most 3), and their corners, combined by exclusive
/// or. Lower ends have 30 bits ([`super::MOST_POSITIONS`]). An entry with another lower end than the current bucket's
/// is stale.
#[derive(Clone, Copy, Default)]
struct Edge(u64);

impl Edge {
    /// Without half-edges, unless it is of the bucket of `low`.
    #[inline]
    fn in_bucket(self, low: u32) -> Self {
        let is_stale = self.0 >> 34 != u64::from(low);
        if is_stale { Self(u64::from(low) << 34) } else { self }
    }

    #[inline]
    fn uses(self) -> u64 {
        self.0 >> 32 & 3
    }

    /// All corners but `corner`, combined.
    #[inline]
    fn others(self, corner: u32) -> u32 {
        self.0 as u32 ^ corner
    }

    /// With one more half-edge; no more than three times.
    #[inline]
    fn with(self, corner: u32) -> Self {
        Self((self.0 + (1 << 32)) ^ u64::from(corner))
    }
}

/// What is found in a range of positions besides plain links.
#[derive(Default)]
pub struct Found {
    pub chained: Vec<(u32, [u32; 2])>,
    pub crowded: Vec<u32>,
    pub features: Vec<[u32; 2]>,
    pub boundary_edges: u64,
    pub non_manifold_edges: u64,
}

impl<'a> Buckets<'a> {
    pub fn new(edges: &'a Edges<'_>, linked: &'a [AtomicU32], range: Range<u32>) -> Self {
        let (first, length) = (range.start, range.end - range.start);
        let mut last = vec![NONE; length as usize];
        edges.each(|low, _, corner| {
            let bucket = low.wrapping_sub(first);
            if bucket < length {
                let before = std::mem::replace(&mut last[bucket as usize], corner);
                linked[corner as usize].store(before, Ordering::Relaxed);
            }
        });
        Self { edges, linked, first, last }
    }

    /// Puts the links of the half-edges in place of the lists.
    pub fn link(&self, positions: usize) -> Found {
        match (self.edges.faces.are_triangles(), self.edges.features.is_some()) {
            (true, false) => self.link_all::<true, false>(positions),
            (true, true) => self.link_all::<true, true>(positions),
            (false, false) => self.link_all::<false, false>(positions),
            (false, true) => self.link_all::<false, true>(positions),
        }
    }

    fn link_all<const TRIANGLES: bool, const FEATURES: bool>(&self, positions: usize) -> Found {
        let edges = self.edges;
        let face = |corner: u32| if TRIANGLES { corner / 3 } else { edges.face(corner) };
        let mut found = Found::default();
        let mut edge_at = vec![Edge::default(); positions];
        let (mut ends, mut corners) = ([0; MOST_UNSORTED], [0; MOST_UNSORTED]);
        for (low, &last) in (self.first..).zip(&self.last) {
            let mut count = 0;
            let mut is_plain = true;
            let mut corner = last;
            while corner != NONE && is_plain && count < MOST_UNSORTED {
                let end = edges.other_end::<TRIANGLES>(corner, low);
                (ends[count], corners[count]) = (end, corner);
                let known = &mut edge_at[end as usize];
                let edge = known.in_bucket(low);
                *known = edge.with(corner);
                is_plain = edge.uses() < 2;
                if edges.has_degenerate && edge.uses() == 1 {
                    is_plain &= face(edge.others(0)) != face(corner);
                }
                corner = self.linked[corner as usize].load(Ordering::Relaxed);
                count += 1;
            }
            if !is_plain || corner != NONE {
                ends[..count].iter().for_each(|&end| edge_at[end as usize] = Edge::default());
                self.sort(low, last, &mut found);
                continue;
            }
            for (&end, &corner) in ends[..count].iter().zip(&corners) {
                let edge = edge_at[end as usize];
                let is_pair = edge.uses() == 2;
                let other = edge.others(corner);
                let mut link = if is_pair { face(other) } else { NONE };
                if FEATURES && is_pair && edges.is_feature([corner, other], low) {
                    if corner < other {
                        found.features.push([face(corner), link]);
                    }
                    link = NONE;
                }
                self.linked[corner as usize].store(link, Ordering::Relaxed);
                found.boundary_edges += u64::from(!is_pair);
            }
        }
        found
    }

    /// Links a bucket of any kind.
    #[cold]
    fn sort(&self, low: u32, last: u32, found: &mut Found) {
        let mut half_edges: Vec<(u32, u32)> = Vec::new();
        let mut corner = last;
        while corner != NONE {
            half_edges.push((self.edges.other_end::<false>(corner, low), corner));
            // a half-edge that does not stand for an edge stays without a link
            corner = self.linked[corner as usize].swap(NONE, Ordering::Relaxed);
        }
        half_edges.sort_unstable();
        for edge in half_edges.chunk_by(|a, b| a.0 == b.0) {
            self.link_edge(low, edge, found);
        }
    }

    /// Links the faces of an edge, given its half-edges by corner, to the faces before and after them. The first
    /// half-edge of each face stands for the edge. Of more than two faces, those too thin to have a normal are left out
    /// where normals are compared: they would stand between the others.
    fn link_edge(&self, low: u32, edge: &[(u32, u32)], found: &mut Found) {
        let mut odd_faces = 0;
        let uses = edge.chunk_by(|a, b| self.edges.face(a.1) == self.edges.face(b.1));
        let mut firsts: Vec<(u32, u32)> = uses
            .map(|uses| {
                odd_faces += uses.len() % 2;
                (uses[0].1, self.edges.face(uses[0].1))
            })
            .collect();
        if firsts.len() > 2 {
            found.crowded.extend(firsts.iter().map(|&(_, face)| face));
            firsts.retain(|&(_, face)| self.edges.features.is_none_or(|features| features.can_compare(face)));
        }
        let mut before = NONE;
        for (at, &(corner, face)) in firsts.iter().enumerate() {
            let after = match firsts.get(at + 1) {
                Some(&(next, after)) if self.edges.is_feature([corner, next], low) => {
                    found.features.push([face, after]);
                    NONE
                }
                Some(&(_, after)) => after,
                None => NONE,
            };
            let link = match (before, after) {
                (NONE, other) | (other, NONE) => other,
                both => {
                    found.chained.push((corner, both.into()));
                    CHAINED
                }
            };
            self.linked[corner as usize].store(link, Ordering::Relaxed);
            before = if after == NONE { NONE } else { face };
        }
        found.boundary_edges += u64::from(odd_faces == 1);
        found.non_manifold_edges += u64::from(odd_faces > 2);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{MOST_CORNERS, MOST_POSITIONS};
    use super::*;

    #[test]
    fn an_edge_has_room_for_the_largest_numbers() {
        let (low, corners) = (MOST_POSITIONS as u32 - 1, [MOST_CORNERS as u32 - 1, 1 << 31, 0]);
        let one = Edge::default().in_bucket(low).with(corners[0]);
        assert_eq!((one.uses(), one.others(0)), (1, corners[0]));
        let two = one.in_bucket(low).with(corners[1]);
        assert_eq!((two.uses(), two.others(corners[0]), two.others(corners[1])), (2, corners[1], corners[0]));
        assert_eq!(two.with(corners[2]).uses(), 3);
        assert_eq!(two.with(corners[2]).in_bucket(low - 1).uses(), 0, "stale");
    }
}
