//! Nearest neighbours, exactly: by the integer |x − y|², of equally near points by number.
//!
//! Points of up to [`TREE_DIMENSIONS`] coordinates are put in a k-d tree (Bentley 1975). A search leaves out a part of
//! the tree whose box is farther away than the points found so far, or as far where all its numbers are larger. So
//! points at one place cost no more than others: the part with the smallest numbers is searched first, and no other.
//! With more coordinates nearly all parts would be searched; there all pairs are compared, and no more of them than
//! [`MOST_PAIRS`].

use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::csr::check_neighbours;
use crate::error::{Error, Result};
use crate::surface::Rows;
use crate::surface::rows::symmetric;

/// Most neighbours that an item may have by this rule: more of them hardly change clusters.
pub const MOST_NEIGHBOURS: u32 = 64;

/// Coordinates up to which a tree is searched.
const TREE_DIMENSIONS: usize = 8;

/// Pairs of points that are compared at most.
const MOST_PAIRS: u64 = 1 << 34;

/// Points of a leaf at most.
const LEAF: usize = 16;

/// Points below which a part of the tree is built on one thread.
const SEQUENTIAL: usize = 1 << 13;

/// Points whose neighbours a thread finds at once.
const PIECE: usize = 1 << 8;

/// Both ends of every edge from a point to one of its `nearest` nearest, of points whose first `dimensions`
/// coordinates count.
///
/// # Errors
/// More pairs to compare than [`MOST_PAIRS`], where there is no tree; more edges than there may be.
pub fn knn<const D: usize>(points: &[[i32; D]], dimensions: usize, nearest: u32) -> Result<Rows> {
    let count = (nearest as usize).min(points.len().saturating_sub(1));
    check_neighbours(2 * points.len() as u64 * count as u64)?;
    let found: Vec<Vec<u32>> = if dimensions <= TREE_DIMENSIONS {
        let mut numbers: Vec<u32> = (0..points.len() as u32).collect();
        let root = Node::of(points, &mut numbers);
        let search = |queries: &[u32]| {
            let mut nearest = Nearest::new(count);
            queries.iter().flat_map(|&query| nearest.in_tree(points, &root, &numbers, query)).collect()
        };
        // in the order of the tree, so that searches after each other see the same parts
        let found: Vec<Vec<u32>> = numbers.par_chunks(PIECE).map(search).collect();
        let mut sorted = vec![0; points.len() * count];
        let lists = found.iter().flat_map(|piece| piece.chunks_exact(count.max(1)));
        for (&query, list) in numbers.iter().zip(lists) {
            sorted[query as usize * count..][..count].copy_from_slice(list);
        }
        vec![sorted]
    } else {
        let pairs = (points.len() as u64).saturating_mul(points.len() as u64);
        if pairs > MOST_PAIRS {
            return Err(Error::too_large(format_args!(
                "nearest neighbours of more than {TREE_DIMENSIONS} columns are found by comparing all pairs, at most \
                 {MOST_PAIRS}; bring a graph with so many items: {}",
                points.len()
            )));
        }
        let pieces: Vec<u32> = (0..points.len() as u32).step_by(PIECE).collect();
        let compare = |&first: &u32| {
            let mut nearest = Nearest::new(count);
            let queries = first..(first + PIECE as u32).min(points.len() as u32);
            queries.flat_map(|query| nearest.of_all(points, query)).collect()
        };
        pieces.par_iter().map(compare).collect()
    };
    let edges = || {
        let ends = found.iter().flat_map(|piece| piece.iter().copied());
        ends.enumerate().map(|(at, other)| ((at / count) as u32, other))
    };
    Ok(symmetric(points.len(), edges))
}

/// |x − y|², below 2⁶⁰.
#[inline]
pub fn squared_length<const D: usize>(a: &[i32; D], b: &[i32; D]) -> u64 {
    let difference = |(&a, &b): (&i32, &i32)| u64::from(a.abs_diff(b));
    a.iter().zip(b).map(difference).map(|difference| difference * difference).sum()
}

/// A part of a tree: points in a box.
struct Node<const D: usize> {
    low: [i32; D],
    high: [i32; D],
    /// The smallest number of a point.
    first: u32,
    content: Content<D>,
}

enum Content<const D: usize> {
    /// Few points.
    Leaf,
    /// Two parts, the points of the first before those of the second; how many the first has.
    Halves(Box<[Node<D>; 2]>, usize),
}

impl<const D: usize> Node<D> {
    /// The tree of points, whose numbers it sorts.
    fn of(points: &[[i32; D]], numbers: &mut [u32]) -> Self {
        let (mut low, mut high, mut first) = ([i32::MAX; D], [i32::MIN; D], u32::MAX);
        for &number in &*numbers {
            first = first.min(number);
            for (axis, &x) in points[number as usize].iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(x), high[axis].max(x));
            }
        }
        if numbers.len() <= LEAF {
            return Self { low, high, first, content: Content::Leaf };
        }
        let widest = (0..D).max_by_key(|&axis| high[axis].abs_diff(low[axis])).unwrap_or(0);
        let middle = numbers.len() / 2;
        numbers.select_nth_unstable_by_key(middle, |&number| (points[number as usize][widest], number));
        let (left, right) = numbers.split_at_mut(middle);
        let halves = match middle < SEQUENTIAL {
            true => (Self::of(points, left), Self::of(points, right)),
            false => rayon::join(|| Self::of(points, left), || Self::of(points, right)),
        };
        Self { low, high, first, content: Content::Halves(Box::new([halves.0, halves.1]), middle) }
    }

    /// The squared distance of a point to the box.
    #[inline]
    fn distance(&self, point: &[i32; D]) -> u64 {
        let beyond = |axis: usize| {
            let x = point[axis];
            let beyond = self.low[axis].saturating_sub(x).max(x.saturating_sub(self.high[axis])).max(0);
            beyond as u64
        };
        (0..D).map(beyond).map(|beyond| beyond * beyond).sum()
    }

    /// What a point of the box has at least: its squared distance, and then its number.
    fn least(&self, point: &[i32; D]) -> (u64, u32) {
        (self.distance(point), self.first)
    }
}

/// The nearest points found so far, the farthest on top.
struct Nearest {
    count: usize,
    found: BinaryHeap<(u64, u32)>,
}

impl Nearest {
    fn new(count: usize) -> Self {
        Self { count, found: BinaryHeap::with_capacity(count + 1) }
    }

    /// The neighbours of a point by way of a tree.
    fn in_tree<const D: usize>(
        &mut self,
        points: &[[i32; D]],
        root: &Node<D>,
        numbers: &[u32],
        query: u32,
    ) -> Vec<u32> {
        self.search(points, root, numbers, query);
        self.take()
    }

    fn search<const D: usize>(&mut self, points: &[[i32; D]], node: &Node<D>, numbers: &[u32], query: u32) {
        let point = &points[query as usize];
        match &node.content {
            Content::Leaf => numbers.iter().for_each(|&number| self.offer(points, query, number)),
            Content::Halves(halves, middle) => {
                let (left, right) = numbers.split_at(*middle);
                let mut parts =
                    [(halves[0].least(point), &halves[0], left), (halves[1].least(point), &halves[1], right)];
                if parts[1].0 < parts[0].0 {
                    parts.swap(0, 1);
                }
                for (least, node, numbers) in parts {
                    if self.takes(least) {
                        self.search(points, node, numbers, query);
                    }
                }
            }
        }
    }

    /// The neighbours of a point among all.
    fn of_all<const D: usize>(&mut self, points: &[[i32; D]], query: u32) -> Vec<u32> {
        (0..points.len() as u32).for_each(|number| self.offer(points, query, number));
        self.take()
    }

    fn offer<const D: usize>(&mut self, points: &[[i32; D]], query: u32, number: u32) {
        let key = (squared_length(&points[query as usize], &points[number as usize]), number);
        if number != query && self.takes(key) {
            self.found.push(key);
            if self.found.len() > self.count {
                self.found.pop();
            }
        }
    }

    /// Whether a point with this squared distance and number is among the nearest so far.
    fn takes(&self, key: (u64, u32)) -> bool {
        self.found.len() < self.count || self.found.peek().is_some_and(|farthest| key < *farthest)
    }

    fn take(&mut self) -> Vec<u32> {
        self.found.drain().map(|(_, number)| number).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same by definition.
    fn by_definition<const D: usize>(points: &[[i32; D]], nearest: usize) -> Vec<Vec<u32>> {
        let mut rows = vec![Vec::new(); points.len()];
        for a in 0..points.len() as u32 {
            let mut others: Vec<u32> = (0..points.len() as u32).filter(|&b| b != a).collect();
            others.sort_by_key(|&b| (squared_length(&points[a as usize], &points[b as usize]), b));
            for &b in others.iter().take(nearest) {
                rows[a as usize].push(b);
                rows[b as usize].push(a);
            }
        }
        rows.iter_mut().for_each(|row| {
            row.sort_unstable();
            row.dedup();
        });
        rows
    }

    /// Points on a lattice of so many places an axis: many are equal, and more are equally far from each other.
    fn points<const D: usize>(count: usize, dimensions: usize, places: u64) -> Vec<[i32; D]> {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % places) as i32 - places as i32 / 2
        };
        (0..count).map(|_| std::array::from_fn(|axis| if axis < dimensions { random() } else { 0 })).collect()
    }

    fn check<const D: usize>(dimensions: usize) {
        for (count, places) in [(1, 5), (2, 5), (150, 2), (150, 5), (150, 1 << 26), (90, 1)] {
            let points = points::<D>(count, dimensions, places);
            for nearest in [1, 3, 8, 64] {
                let rows = knn(&points, dimensions, nearest).expect("neighbours");
                let expected = by_definition(&points, nearest as usize);
                let found: Vec<Vec<u32>> = (0..count as u32).map(|item| rows.of(item).to_vec()).collect();
                assert_eq!(found, expected, "{dimensions} {count} {places} {nearest}");
            }
        }
    }

    #[test]
    fn the_nearest_are_those_of_the_definition_with_many_ties() {
        check::<3>(1);
        check::<3>(2);
        check::<3>(3);
        check::<8>(5);
        check::<8>(8);
        check::<16>(16);
        check::<64>(33);
    }

    #[test]
    fn points_at_one_place_take_no_more_work_than_others() {
        // all pairs of these would be 4·10¹⁰
        let rows = knn(&vec![[7, -3, 0]; 200_000], 3, 8).expect("neighbours");
        assert_eq!(rows.of(100_000), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(rows.of(3).len(), 199_999);
    }

    #[test]
    fn too_many_pairs_are_refused_before_they_are_compared() {
        let error = knn(&vec![[0; 16]; (1 << 17) + 1], 9, 8).expect_err("too many");
        assert!(error.message.contains("bring a graph"), "{error}");
    }
}
