//! Nearest neighbours, exactly: by the integer |x − y|², of equally near points those whose numbers come next, the
//! first after the last. So a thousand equal points have some neighbours each; by number alone, all would have the
//! first ones.
//!
//! Points of up to [`TREE_DIMENSIONS`] coordinates are put in a k-d tree (Bentley 1975). A search leaves out a part of
//! the tree whose box is farther away than the points found so far, or as far where all its numbers come later. So
//! points at one place cost no more than others: the part with the next numbers is searched first, and no other.
//! With more coordinates nearly all parts would be searched; there all pairs are compared.
//!
//! Either way a point is compared with [`MOST_COMPARED`] others at most, on average over all points. A tree of n points
//! has at most n/4 parts, so that up to 2¹⁵ points are never too many.

use std::collections::BinaryHeap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use super::csr::check_neighbours;
use crate::error::{Error, Result};
use crate::parallel;
use crate::surface::Rows;
use crate::surface::rows::symmetric;

/// Most neighbours that an item may have by this rule: more of them hardly change clusters.
pub const MOST_NEIGHBOURS: u32 = 64;

/// Coordinates up to which a tree is searched.
const TREE_DIMENSIONS: usize = 8;

/// Points that a point is compared with at most, on average over all points.
const MOST_COMPARED: u64 = 1 << 17;

/// Points of a leaf at most. Entering a part of the tree counts as as many comparisons.
const LEAF: usize = 16;

/// Points below which a part of the tree is built on one thread.
const SEQUENTIAL: usize = 1 << 13;

/// Points whose neighbours a thread finds at once.
const PIECE: usize = 1 << 8;

/// Points that all points of a piece are compared with before the next: they stay in the caches.
const BLOCK: usize = 1 << 9;

/// Both ends of every edge from a point to one of its `nearest` nearest, of points whose first `dimensions`
/// coordinates count.
///
/// # Errors
/// More comparisons than [`MOST_COMPARED`] a point; more edges than there may be.
pub fn knn<const D: usize>(points: &[[i32; D]], dimensions: usize, nearest: u32) -> Result<Rows> {
    let count = (nearest as usize).min(points.len().saturating_sub(1));
    check_neighbours(2 * points.len() as u64 * count as u64)?;
    let found = match dimensions <= TREE_DIMENSIONS {
        true => in_tree(points, count, points.len() as u64 * MOST_COMPARED)?,
        false => among_all(points, count)?,
    };
    let edges = || {
        (0..).zip(found.chunks_exact(count.max(1))).flat_map(|(item, ends)| ends.iter().map(move |&end| (item, end)))
    };
    Ok(symmetric(points.len(), edges))
}

/// The `count` nearest of each point, by searches of a tree that enter parts as often as `budget` allows.
fn in_tree<const D: usize>(points: &[[i32; D]], count: usize, budget: u64) -> Result<Vec<u32>> {
    let mut numbers: Vec<u32> = (0..points.len() as u32).collect();
    let root = Node::of(points, &mut numbers);
    let compared = AtomicU64::new(0);
    let search = |queries: &[u32]| {
        if compared.load(Ordering::Relaxed) > budget {
            return Err(too_much(points.len()));
        }
        let mut found = Vec::with_capacity(queries.len() * count);
        for &query in queries {
            let mut nearest = Nearest::new(count);
            let visited = nearest.search(points, &root, &numbers, query);
            // the sum of all searches is the same in each run, whatever their order
            if compared.fetch_add(visited, Ordering::Relaxed) + visited > budget {
                return Err(too_much(points.len()));
            }
            found.extend(nearest.numbers(query));
        }
        Ok(found)
    };
    // in the order of the tree, so that searches after each other see the same parts
    let found = parallel::pieces(numbers.len(), PIECE, &|range| search(&numbers[range]));
    let found: Vec<Vec<u32>> = found.into_iter().collect::<Result<_>>()?;
    let mut sorted = vec![0; points.len() * count];
    let lists = found.iter().flat_map(|piece| piece.chunks_exact(count.max(1)));
    for (&query, list) in numbers.iter().zip(lists) {
        sorted[query as usize * count..][..count].copy_from_slice(list);
    }
    Ok(sorted)
}

/// The `count` nearest of each point, by comparing all pairs.
fn among_all<const D: usize>(points: &[[i32; D]], count: usize) -> Result<Vec<u32>> {
    if points.len() as u64 > MOST_COMPARED {
        return Err(too_much(points.len()));
    }
    let compare = |range: Range<usize>| {
        let (first, queries) = (range.start as u32, &points[range]);
        let mut nearest = vec![Nearest::new(count); queries.len()];
        for (block, others) in points.chunks(BLOCK).enumerate() {
            for ((query, point), nearest) in (first..).zip(queries).zip(&mut nearest) {
                for (other, place) in ((block * BLOCK) as u32..).zip(others) {
                    if other != query {
                        nearest.offer((squared_length(point, place), other.wrapping_sub(query)));
                    }
                }
            }
        }
        (first..).zip(nearest).flat_map(|(query, found)| found.numbers(query)).collect::<Vec<u32>>()
    };
    Ok(parallel::joined(parallel::pieces(points.len(), PIECE, &compare)))
}

fn too_much(points: usize) -> Error {
    Error::too_large(format_args!(
        "nearest neighbours of these items take more comparisons than {MOST_COMPARED} an item; bring a graph with so \
         many items: {points}"
    ))
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
    /// The smallest and the largest number of a point.
    numbers: (u32, u32),
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
        let (mut low, mut high, mut range) = ([i32::MAX; D], [i32::MIN; D], (u32::MAX, 0));
        for &number in &*numbers {
            range = (range.0.min(number), range.1.max(number));
            for (axis, &x) in points[number as usize].iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(x), high[axis].max(x));
            }
        }
        if numbers.len() <= LEAF {
            return Self { low, high, numbers: range, content: Content::Leaf };
        }
        let widest = (0..D).max_by_key(|&axis| high[axis].abs_diff(low[axis])).unwrap_or(0);
        let middle = numbers.len() / 2;
        numbers.select_nth_unstable_by_key(middle, |&number| (points[number as usize][widest], number));
        let (left, right) = numbers.split_at_mut(middle);
        let halves = match middle < SEQUENTIAL {
            true => (Self::of(points, left), Self::of(points, right)),
            false => rayon::join(|| Self::of(points, left), || Self::of(points, right)),
        };
        Self { low, high, numbers: range, content: Content::Halves(Box::new([halves.0, halves.1]), middle) }
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

    /// What a point of the box has at least: its squared distance, and how far its number comes after the point's.
    fn least(&self, point: &[i32; D], number: u32) -> (u64, u32) {
        let (first, last) = self.numbers;
        let follows = if (first..last).contains(&number) { 1 } else { first.wrapping_sub(number) };
        (self.distance(point), follows)
    }
}

/// The nearest points found so far, the farthest on top.
#[derive(Clone)]
struct Nearest {
    count: usize,
    found: BinaryHeap<(u64, u32)>,
}

impl Nearest {
    fn new(count: usize) -> Self {
        Self { count, found: BinaryHeap::with_capacity(count + 1) }
    }

    /// Finds the neighbours of a point in a part of a tree; returns what that counts as in comparisons.
    fn search<const D: usize>(&mut self, points: &[[i32; D]], node: &Node<D>, numbers: &[u32], query: u32) -> u64 {
        let point = &points[query as usize];
        let mut compared = LEAF as u64;
        match &node.content {
            Content::Leaf => {
                for &number in numbers.iter().filter(|&&number| number != query) {
                    self.offer((squared_length(point, &points[number as usize]), number.wrapping_sub(query)));
                }
            }
            Content::Halves(halves, middle) => {
                let (left, right) = numbers.split_at(*middle);
                let mut parts = [(&halves[0], left), (&halves[1], right)]
                    .map(|(node, numbers)| (node.least(point, query), node, numbers));
                if parts[1].0 < parts[0].0 {
                    parts.swap(0, 1);
                }
                for (least, node, numbers) in parts {
                    if self.takes(least) {
                        compared += self.search(points, node, numbers, query);
                    }
                }
            }
        }
        compared
    }

    /// Takes a point, given as its squared distance and how far its number comes after the point's, if it is among the
    /// nearest so far.
    #[inline]
    fn offer(&mut self, key: (u64, u32)) {
        if self.takes(key) {
            self.found.push(key);
            if self.found.len() > self.count {
                self.found.pop();
            }
        }
    }

    /// Whether such a point is among the nearest so far.
    #[inline]
    fn takes(&self, key: (u64, u32)) -> bool {
        self.found.len() < self.count || self.found.peek().is_some_and(|farthest| key < *farthest)
    }

    /// The numbers of the points that were found for a point.
    fn numbers(self, query: u32) -> impl Iterator<Item = u32> {
        self.found.into_iter().map(move |(_, follows)| query.wrapping_add(follows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::random;

    /// The others of each point, the nearest first.
    fn others<const D: usize>(points: &[[i32; D]]) -> Vec<Vec<u32>> {
        let of = |point: usize| {
            let mut others: Vec<u32> = (0..points.len() as u32).filter(|&other| other as usize != point).collect();
            let follows = |other: u32| (other as usize + points.len() - point) % points.len();
            others.sort_by_key(|&other| (squared_length(&points[point], &points[other as usize]), follows(other)));
            others
        };
        (0..points.len()).map(of).collect()
    }

    /// Neighbours by definition.
    fn by_definition(others: &[Vec<u32>], nearest: usize) -> Vec<Vec<u32>> {
        let mut rows = vec![Vec::new(); others.len()];
        for (a, others) in others.iter().enumerate() {
            for &b in others.iter().take(nearest) {
                rows[a].push(b);
                rows[b as usize].push(a as u32);
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
        let mut states = random(1);
        let mut next = || ((states() >> 33) % places) as i32 - places as i32 / 2;
        (0..count).map(|_| std::array::from_fn(|axis| if axis < dimensions { next() } else { 0 })).collect()
    }

    fn check<const D: usize>(dimensions: usize) {
        for (count, places) in [(1, 5), (2, 5), (150, 2), (200, 5), (200, 1 << 26), (90, 1)] {
            let points = points::<D>(count, dimensions, places);
            let others = others(&points);
            for nearest in [1, 3, 8, 64] {
                let rows = knn(&points, dimensions, nearest).expect("neighbours");
                let expected = by_definition(&others, nearest as usize);
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
        check::<64>(16);
        check::<64>(33);
    }

    #[test]
    fn points_at_one_place_take_no_more_work_than_others() {
        let points = vec![[7, -3, 0]; 50_000];
        let rows = knn(&points, 3, 8).expect("neighbours");
        assert!(rows.of(40_000).iter().copied().eq((39_992..40_009).filter(|&other| other != 40_000)));
        assert_eq!(rows.of(3), [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 49_995, 49_996, 49_997, 49_998, 49_999]);
        // a path through the tree, not its 6,000 parts
        assert!(in_tree(&points, 8, 50_000 * 40 * LEAF as u64).is_ok());
    }

    #[test]
    fn too_many_comparisons_are_refused() {
        let error = knn(&vec![[0; 16]; (1 << 17) + 1], 9, 8).expect_err("too many pairs");
        assert!(error.message.contains("bring a graph"), "{error}");
        let points = points::<3>(5000, 3, 1 << 20);
        let error = in_tree(&points, 8, 5000 * 40).expect_err("searches enter more than two leaves");
        assert!(error.message.contains("bring a graph"), "{error}");
        assert!(in_tree(&points, 8, 5000 * 5000).is_ok());
    }
}
