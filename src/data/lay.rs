//! From a set of points to what algorithms see of it.

use super::bridge;
use super::frame::{Frame, LEAST_DIFFERENCE, spreads};
use super::grid::Grid;
use super::members::Members;
use super::neighbours::Neighbours;
use super::order;
use super::{Graph, PointSet, knn};
use crate::error::{Error, Result};
use crate::parallel;
use crate::power::factors;
use crate::surface::lattice;
use crate::surface::order::{by_component, inverse};
use crate::surface::{Component, Rows};

/// Lattice units below which the standard deviation of an axis is worth a warning.
const LEAST_DEVIATION: u32 = 1 << 10;

/// Squares of neighbours that a graph may have, for each item and each neighbour: a grid of a million items may have a
/// hub of 50,000, and 1,024 items may all be neighbours.
const MOST_OF_A_HUB: u64 = 1024;

/// Axes that a warning names.
const NAMED_AXES: usize = 8;

/// Points, weights and neighbours on the integer lattice, in internal order. Points are padded with zeros to `D`
/// coordinates, which change no sum.
#[derive(Debug, Clone, PartialEq)]
pub struct Laid<const D: usize> {
    /// Points on the lattice: each coordinate is below 2 to [`bits`](super::bits) in size.
    pub points: Vec<[i32; D]>,
    /// Weights, at least 1. A component's weights sum to less than 2³⁴.
    pub weights: Vec<u32>,
    /// Neighbours of each item, ascending. Symmetric, each once, none of itself.
    pub neighbours: Rows,
    /// The connected components, each a run of items.
    pub components: Vec<Component>,
    /// The member that each internal item is ([`Members`]).
    pub member: Vec<u32>,
    /// Power of two between lengths in the source and here, on all axes.
    pub exponent: i32,
    /// What was subtracted from the coordinates of the source, one an axis.
    pub centre: Vec<f64>,
    /// Weights of the component with the finest unit are weights of the source × 2^this; where there are none, × 1.
    pub weight_exponent: i32,
    /// Pairs of neighbours, bridges included.
    pub edges: u64,
    /// Components before bridges joined them.
    pub components_found: u64,
    /// What is unusual, in words.
    pub warnings: Vec<String>,
}

/// Puts the members of a set of points on the lattice; with `bridge`, joins its components into one.
///
/// # Errors
/// What [`PointSet::check`] refuses; graphs with more edges, and nearest neighbours with more pairs to compare than
/// there may be.
pub fn lay<const D: usize>(set: &PointSet, members: &Members, bridge: bool) -> Result<Laid<D>> {
    set.check()?;
    if set.dimensions > D {
        return Err(Error::internal(format_args!("points of {} coordinates do not fit into {D}", set.dimensions)));
    }
    // from within the pool, parallel steps need not wake it
    rayon::scope(|_| lay_in_pool(set, members, bridge))
}

fn lay_in_pool<const D: usize>(set: &PointSet, members: &Members, bridge: bool) -> Result<Laid<D>> {
    let frame = Frame::of(set, members);
    let points: Vec<[i32; D]> = frame.points(set, members);
    let spreads = spreads(&points, set.dimensions);
    let (neighbours, sorted) = match &set.graph {
        Graph::Grid { full } => {
            let grid = Grid::new(&set.shape, *full, members);
            let sorted = grid.along_curve();
            (Neighbours::Grid(grid), sorted)
        }
        Graph::Rows(csr) => (Neighbours::Rows(csr.rows(members)?), order::along_curve(&points, &spreads)),
        Graph::Knn(nearest) => {
            (Neighbours::Rows(knn(&points, set.dimensions, *nearest)?), order::along_curve(&points, &spreads))
        }
    };
    let [differing, alike] = alike(set, members, &points, &sorted);
    let mut components = neighbours.components(points.len());
    let components_found = components.count as u64;
    let weights = Weights::of(set, members);
    let mut bridges = Vec::new();
    if bridge && components.count > 1 {
        bridges = bridge::bridges(&points, set.dimensions, |member| weights.relative(member), &components, &sorted);
        components.of_face.fill(0);
        components.count = 1;
    }

    let member_of = by_component(sorted, &components);
    let runs = components.runs(&member_of);
    let internal = inverse(&member_of, points.len());
    let neighbours = neighbours.compressed(&member_of, &internal, &bridges)?;
    drop(internal);
    check_hubs(&neighbours.offsets, |at| members.item(member_of[at]))?;
    let relative = |at: usize| weights.relative(member_of[at]);
    let (of_items, components, finest) = lattice::weigh(relative, &runs);
    let mut warnings = Vec::from_iter(coarse_axes(&frame, &spreads, points.len()));
    if 2 * alike > differing {
        warnings.push(format!(
            "items that cannot be told from others, as they differ by less than the unit of the lattice, {:e}, which \
             the largest values set: {alike} or more; cut off outliers, such as a number that stands for a missing one",
            libm::ldexp(1.0, -frame.exponent)
        ));
    }
    if let Some(weights) = &set.weights {
        let given = member_of.iter().map(|&member| weights[members.item(member) as usize]);
        warnings.extend(lattice::lost_weights(given, &of_items, "items"));
    }
    Ok(Laid {
        warnings,
        points: member_of.iter().map(|&member| points[member as usize]).collect(),
        weights: of_items,
        edges: neighbours.items.len() as u64 / 2,
        neighbours,
        components,
        member: member_of,
        exponent: frame.exponent,
        centre: frame.centre,
        weight_exponent: finest + weights.exponent,
        components_found,
    })
}

/// Refuses graphs in which few items have most of the neighbours: merging such an item takes time with the square of
/// their number.
fn check_hubs(offsets: &[u32], item: impl Fn(usize) -> u32) -> Result<()> {
    let degree = |at: usize| u64::from(offsets[at + 1] - offsets[at]);
    let items = offsets.len() - 1;
    let squares: u128 = (0..items).map(|at| u128::from(degree(at)).pow(2)).sum();
    let all = items as u64 + u64::from(offsets[items]);
    if squares <= u128::from(MOST_OF_A_HUB) * u128::from(all) {
        return Ok(());
    }
    let hub = (0..items).max_by_key(|&at| (degree(at), std::cmp::Reverse(item(at)))).unwrap_or(0);
    Err(Error::parameter(format_args!(
        "the graph has items with so many neighbours that clusters of them would take time with the square of that; \
         the sum of the squares may be at most {MOST_OF_A_HUB} times the items and neighbours, {all}: leave out hubs, \
         such as item {} with {} neighbours",
        item(hub),
        degree(hub)
    )))
}

/// Weights of the members, relative to a power of two that none reaches.
struct Weights<'a> {
    of_item: Option<&'a [f64]>,
    members: &'a Members,
    /// Relative weight = weight × 2^exponent.
    exponent: i32,
    factors: [f64; 2],
}

impl<'a> Weights<'a> {
    fn of(set: &'a PointSet, members: &'a Members) -> Self {
        let of_item = set.weights.as_deref();
        let weight = |member| of_item.map_or(1.0, |weights| weights[members.item(member) as usize]);
        let largest = (0..members.len() as u32).map(weight).fold(0.0, f64::max);
        let exponent = libm::frexp(largest).1;
        Self { of_item, members, exponent: -exponent, factors: factors(-exponent) }
    }

    /// Above 0 and below 1.
    fn relative(&self, member: u32) -> f64 {
        let weight = self.of_item.map_or(1.0, |weights| weights[self.members.item(member) as usize]);
        (weight * self.factors[0] * self.factors[1]).max(f64::MIN_POSITIVE)
    }
}

/// Members in a row along the curve that are compared. The curve has upper bits only: members of several places that
/// are close together mix.
const ALIKE_AMONG: usize = 64;

/// How many members differ in the source from the one before them, of [`ALIKE_AMONG`] along the curve in the order of
/// their places on the lattice; how many of these have its place.
fn alike<const D: usize>(set: &PointSet, members: &Members, points: &[[i32; D]], sorted: &[u32]) -> [usize; 2] {
    let differ = |a: u32, b: u32| {
        let [a, b] = [a, b].map(|member| members.item(member) as usize);
        (0..set.dimensions).any(|axis| {
            let (a, b) = (set.at(a, axis), set.at(b, axis));
            (a - b).abs() > LEAST_DIFFERENCE * a.abs().max(b.abs())
        })
    };
    let rows: Vec<&[u32]> = sorted.chunks(ALIKE_AMONG).collect();
    let counts = parallel::ranges(rows.len(), parallel::LEAST / ALIKE_AMONG, &|range| {
        let (mut differing, mut alike) = (0, 0);
        for row in &rows[range] {
            let mut row = row.to_vec();
            row.sort_by_key(|&member| points[member as usize]);
            for pair in row.windows(2) {
                let is_alike = points[pair[0] as usize] == points[pair[1] as usize];
                let differs = !is_alike || differ(pair[0], pair[1]);
                differing += usize::from(differs);
                alike += usize::from(differs && is_alike);
            }
        }
        [differing, alike]
    });
    counts.into_iter().fold([0, 0], |a, b| [a[0] + b[0], a[1] + b[1]])
}

/// Names axes that have little resolution left beside a longer one or outliers.
fn coarse_axes(frame: &Frame, spreads: &[u128], points: usize) -> Option<String> {
    let least = u128::from(LEAST_DEVIATION).pow(2) * (points as u128).pow(2);
    let coarse: Vec<usize> = (0..spreads.len()).filter(|&axis| frame.varying[axis] && spreads[axis] < least).collect();
    if coarse.is_empty() {
        return None;
    }
    let named: Vec<String> = coarse.iter().take(NAMED_AXES).map(usize::to_string).collect();
    let others = coarse.len() - named.len();
    let others = if others > 0 { format!(" and {others} more") } else { String::new() };
    Some(format!(
        "columns {}{others} have a standard deviation below {LEAST_DEVIATION} lattice units of {:e}, which the widest \
         column sets: scale the columns to like ranges, or cut off outliers",
        named.join(", "),
        libm::ldexp(1.0, -frame.exponent)
    ))
}
