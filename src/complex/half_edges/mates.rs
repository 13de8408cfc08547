//! Which half-edges share an edge.

use std::ops::Range;

use super::{NONE, origin};
use crate::parallel;

/// Half-edges that share an edge.
#[derive(Default)]
pub(super) struct Mates {
    /// The other half-edge of each edge that has two.
    pub mates: Vec<u32>,
    /// Edges of more than two half-edges.
    pub crowded_edges: u64,
    /// Pairs of triangles at them; enough to connect all of them.
    pub across_crowded: Vec<[u32; 2]>,
    /// Whether the two half-edges of some edge run in one direction.
    pub run_alike: bool,
}

impl Mates {
    /// Ranges of vertices whose edges are found at the same time: each looks at all triangles.
    const MOST_RANGES: usize = 4;

    /// Of triangles whose corners are below `vertices`.
    pub fn new(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let ranges = rayon::current_num_threads().min(Self::MOST_RANGES).min(vertices.div_ceil(1 << 14)).max(1);
        let bound = |range: usize| (vertices * range / ranges) as u32;
        let found: Vec<(Vec<[u32; 2]>, Self)> =
            parallel::map(ranges, 1, |range| Self::of_edges(triangles, bound(range)..bound(range + 1)));
        let mut all = Self { mates: vec![NONE; 3 * triangles.len()], ..Self::default() };
        for (pairs, found) in found {
            for [one, other] in pairs {
                all.mates[one as usize] = other;
                all.mates[other as usize] = one;
            }
            all.crowded_edges += found.crowded_edges;
            all.across_crowded.extend(found.across_crowded);
            all.run_alike |= found.run_alike;
        }
        all
    }

    /// The edges whose lower ends are in a range: puts half-edges into one bucket for each lower end, and sorts each
    /// bucket by upper ends. Gives the two half-edges of each edge that has two.
    fn of_edges(triangles: &[[u32; 3]], lower_ends: Range<u32>) -> (Vec<[u32; 2]>, Self) {
        let (first, count) = (lower_ends.start, lower_ends.len());
        let sides = |triangle: usize| {
            let [a, b, c] = triangles[triangle];
            let ends = [(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b)));
            let halves = (0..3).map(move |side| (ends[side].0.wrapping_sub(first) as usize, ends[side].1, side));
            halves.filter(move |&(lower, ..)| lower < count)
        };
        let mut begin = vec![0u32; count + 1];
        (0..triangles.len()).flat_map(&sides).for_each(|(lower, ..)| begin[lower] += 1);
        let mut sum = 0;
        for begin in &mut begin {
            sum += *begin;
            *begin = sum;
        }
        let mut buckets = vec![(0, 0); sum as usize];
        for triangle in 0..triangles.len() {
            for (lower, upper, side) in sides(triangle) {
                let end = &mut begin[lower];
                *end -= 1;
                buckets[*end as usize] = (upper, (3 * triangle + side) as u32);
            }
        }
        let (mut pairs, mut found) = (Vec::with_capacity(buckets.len() / 2), Self::default());
        for range in begin.windows(2) {
            let bucket = &mut buckets[range[0] as usize..range[1] as usize];
            bucket.sort_unstable();
            for edge in bucket.chunk_by(|a, b| a.0 == b.0) {
                match edge {
                    [_] => {}
                    [(_, one), (_, other)] => {
                        found.run_alike |= origin(triangles, *one) == origin(triangles, *other);
                        pairs.push([*one, *other]);
                    }
                    _ => {
                        found.crowded_edges += 1;
                        found.across_crowded.extend(edge.windows(2).map(|pair| [pair[0].1 / 3, pair[1].1 / 3]));
                    }
                }
            }
        }
        (pairs, found)
    }
}
