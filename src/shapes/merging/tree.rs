//! Hierarchies: the merges from single faces on, recorded, with optimisation at stops.
//!
//! Rounds are those of [`super`], in which several pairs merge, or of one merge each ([`super::one_by_one`]). At stops,
//! the levels and the last number of clusters, faces move and clusters swap as in flat runs ([`crate::shapes::run`]).
//! In rounds of one merge, faces move after each ([`super::multilevel`]). Prices are those of the number of clusters
//! that the run ends with, or of 100 for whole trees.
//!
//! Energies of the tree are those of the best shapes by moments, without prices. Where moves after merges reach their
//! bound on work, faces move at stops only from then on; where prices of single merges do, rounds have several.

use super::multilevel::{Settled, Settling};
use super::one_by_one::{Queue, no_edge};
use super::{Edge, LOOKS_AN_EDGE, Merged, Merging, Union};
use crate::cluster::hierarchy::{Options, RoundRow, check};
use crate::cluster::numbers;
use crate::cluster::tree_builder::Builder;
use crate::device::{Cancel, Ending};
use crate::energy::{Energy, Merged as Made};
use crate::error::Result;
use crate::hierarchy::Tree;
use crate::shapes::best::Allowed;
use crate::shapes::central::Central;
use crate::shapes::faces::Faces;
use crate::shapes::kind::Kind;
use crate::shapes::moments::SHIFT;
use crate::shapes::moves::Gpu;
use crate::shapes::prices::Prices;
use crate::shapes::run::{Clustering, Run, Step};
use crate::shapes::shape::Shape;
use crate::surface::{Surface, Units};

/// What to make a hierarchy of.
#[derive(Debug, Clone, Copy)]
pub struct Input<'a> {
    /// The faces of a mesh.
    pub surface: &'a Surface,
    /// The same as shapes see them.
    pub faces: Faces<'a>,
    /// Types, in the order of [`Kind::ALL`], planes among them.
    pub kinds: &'a [Kind],
    /// Distances below it are noise, in lattice units.
    pub resolution: f64,
    /// What to build: stops, and how many clusters merge in a round.
    pub options: &'a Options,
}

/// A hierarchy and the clusters that it ends with.
#[derive(Debug)]
pub struct Hierarchy {
    /// The merges and moves.
    pub tree: Tree,
    /// The last clusters; one a face.
    pub labels: Vec<u32>,
    /// Their shapes, in units of moments.
    pub shapes: Vec<Shape>,
    /// F of these, without prices.
    pub energy: i128,
    /// Whether a bound on work was reached.
    pub ending: Ending,
}

/// Builds a hierarchy. Calls `on_step` with the round and every step of an optimisation, and `on_round` with every
/// round, its energy in source units.
pub fn hierarchy(
    input: Input<'_>,
    gpu: &mut Gpu,
    cancel: &Cancel,
    on_step: &mut dyn FnMut(u32, Step),
    on_round: &mut dyn FnMut(RoundRow<f64>),
) -> Result<Hierarchy> {
    let Input { surface, faces, kinds, resolution, options } = input;
    let target = check(&surface.items, options)?;
    let prices = Prices::of_tree(faces.graph, options.clusters, resolution);
    let allowed = Allowed { kinds, prices: &prices, tolerance: None };
    let merging = Merging::new(faces, allowed);
    let count = faces.count() as u32;
    let mut growing = Growing {
        surface,
        options,
        target,
        gpu,
        cancel,
        merges: Merges::in_rounds(&merging),
        energy: (0..count).map(|face| merging.cost(face)).sum(),
        merging,
        settling: None,
        builder: Builder::new(&surface.items, (u64::from(count) - target) as usize),
        names: (0..count).collect(),
        left: u64::from(count),
        last: None,
        may_settle: options.optimise,
        is_exhausted: false,
        is_bounded: false,
    };
    while growing.left > target {
        growing.round(on_step, on_round)?;
    }
    growing.end()
}

/// How clusters merge.
enum Merges {
    /// Several pairs in a round, of so many looks until one end suffices.
    InRounds(Vec<Edge>, usize),
    OneByOne(Box<Queue>),
}

impl Merges {
    /// Of clusters between which no face has moved.
    fn in_rounds(merging: &Merging<'_>) -> Self {
        Self::of(merging.edges_inside(&vec![0; merging.parts.len()], &[1]))
    }

    fn of(edges: Vec<Edge>) -> Self {
        let looks = LOOKS_AN_EDGE * edges.len();
        Self::InRounds(edges, looks)
    }
}

/// A hierarchy on the way.
struct Growing<'a> {
    surface: &'a Surface,
    options: &'a Options,
    /// Clusters to end with.
    target: u64,
    gpu: &'a mut Gpu,
    cancel: &'a Cancel,
    merging: Merging<'a>,
    merges: Merges,
    /// Of rounds in which faces move after each merge.
    settling: Option<Settling<'a>>,
    builder: Builder<'a, Energy>,
    /// What the tree calls each cluster, by its number.
    names: Vec<u32>,
    /// Clusters that are left.
    left: u64,
    /// Of the clusters, without prices, in units of moments and of the finest component.
    energy: f64,
    /// What the last round ended with, if it was a stop that optimised.
    last: Option<Clustering>,
    /// Whether faces move after merges of one pair.
    may_settle: bool,
    /// Whether no more pairs merge alone.
    is_exhausted: bool,
    /// Whether a stop reached a bound on work.
    is_bounded: bool,
}

/// Moves: (face, from, to), by the names of the tree.
type Moves = Vec<(u32, u32, u32)>;

impl<'a> Growing<'a> {
    fn round(&mut self, on_step: &mut dyn FnMut(u32, Step), on_round: &mut dyn FnMut(RoundRow<f64>)) -> Result<()> {
        self.cancel.check()?;
        let Options { levels, clusters, optimise, sequential_at, .. } = self.options;
        let round = self.builder.tree.rounds.len() as u32 + 1;
        let left = self.left;
        let stop = levels.iter().copied().filter(|&level| level < left).fold(self.target, u64::max);
        let is_sequential = left <= *sequential_at && !self.is_exhausted;
        let unions =
            if is_sequential { vec![self.merge_cheapest()?] } else { self.merge_some((left - stop) as usize)? };
        self.left -= unions.len() as u64;
        let is_level = self.left == stop && (levels.contains(&stop) || *clusters == Some(stop));
        self.last = None;
        let moves = match unions.as_slice() {
            _ if *optimise && is_level => self.optimised(&mut |step| on_step(round, step))?,
            [union] if is_sequential => self.settled(union)?,
            _ => Vec::new(),
        };
        self.builder.moves(&moves);
        let energy = self.in_source_units(self.energy);
        self.builder.end_round(self.left, energy);
        let (merges, moves) = (unions.len() as u64, moves.len() as u64);
        on_round(RoundRow { round, clusters: self.left, energy, merges, moves, is_level });
        Ok(())
    }

    /// Merges the cheapest pairs of those that chose each other.
    fn merge_some(&mut self, surplus: usize) -> Result<Vec<Union>> {
        let (mut edges, looks_left) = match std::mem::replace(&mut self.merges, Merges::InRounds(Vec::new(), 0)) {
            Merges::InRounds(edges, looks_left) => (edges, looks_left),
            Merges::OneByOne(queue) => {
                self.merging.has_merged.fill(false);
                (queue.edges(&self.merging), 0)
            }
        };
        let looks_left = looks_left.saturating_sub(edges.len());
        let chosen = self.merging.choose_some(&edges, surplus, looks_left == 0)?;
        let unions = chosen.iter().map(|edge| self.merge(edge)).collect();
        self.merging.contract(&mut edges, &mut Vec::new());
        self.merges = Merges::InRounds(edges, looks_left);
        Ok(unions)
    }

    /// Merges the cheapest pair.
    fn merge_cheapest(&mut self) -> Result<Union> {
        if let Merges::InRounds(edges, _) = &mut self.merges {
            let edges = std::mem::take(edges);
            self.merges = Merges::OneByOne(Box::new(Queue::new(&self.merging, edges)));
        }
        let edge = match &mut self.merges {
            Merges::OneByOne(queue) => queue.pop(&self.merging),
            Merges::InRounds(..) => None,
        };
        Ok(self.merge(&edge.ok_or_else(no_edge)?))
    }

    /// Merges a pair, and records it.
    fn merge(&mut self, edge: &Edge) -> Union {
        let union = self.merging.merge(edge.ends());
        self.energy += union.rise;
        let part = &self.merging.parts[union.into as usize];
        let Units { weight_exponent, density, .. } = self.surface.units;
        let shift = self.surface.graph.components[part.component as usize].energy_shift as i32;
        let mean = Central::of(&part.moments).mean * f64::from(1u32 << SHIFT);
        let made = Made {
            cost: self.in_source_units(union.rise),
            energy: self.in_source_units(self.merging.cost(union.into)),
            faces: part.faces,
            // the samples of a face weigh three times the face
            weight: libm::ldexp(part.moments.weight as f64 / 3.0, weight_exponent + shift) * density,
            proxy: self.surface.frame().source_position(mean).to_array(),
            shape: Some(part.kind),
        };
        let [from, into] = [union.from, union.into].map(|number| self.names[number as usize]);
        self.builder.record((from, into), made);
        union
    }

    /// What follows a merge of one pair: moves of faces, and prices. Returns the moves.
    fn settled(&mut self, union: &Union) -> Result<Moves> {
        let Self { merging, names, settling, .. } = self;
        let Merges::OneByOne(mut queue) = std::mem::replace(&mut self.merges, Merges::of(Vec::new())) else {
            return Ok(Vec::new());
        };
        if !self.may_settle {
            queue.merged(merging, union);
            self.is_exhausted = queue.is_exhausted();
            self.merges = Merges::OneByOne(queue);
            return Ok(Vec::new());
        }
        let settling = match settling {
            Some(settling) => settling,
            None => {
                let labels = (0..names.len() as u32).map(|face| merging.root(face)).collect();
                settling.insert(Settling::new(merging, labels)?)
            }
        };
        let Settled { clusters, mut moves, rise } = settling.settle(merging, union)?;
        queue.changed(merging, &clusters, |cluster| settling.beside(merging, cluster));
        self.is_exhausted = queue.is_exhausted();
        self.may_settle = !settling.clusters.is_bounded();
        // without moves, the queue knows neighbours of clusters by their merges
        self.merges = if self.may_settle { Merges::OneByOne(queue) } else { Merges::of(queue.edges(merging)) };
        self.energy += rise;
        moves.iter_mut().for_each(|(_, from, to)| [*from, *to] = [*from, *to].map(|number| names[number as usize]));
        Ok(moves)
    }

    /// Moves faces and swaps clusters until neither changes anything. Returns the moves.
    fn optimised(&mut self, on_step: &mut dyn FnMut(Step)) -> Result<Moves> {
        let (before, run) = self.run()?;
        let clustering =
            run.with_swaps(std::iter::empty(), u32::MAX, self.gpu, self.cancel, &mut |step, _| on_step(step))?;
        let after = numbers::kept(&before, &clustering.labels);
        let axes: Vec<_> = clustering.shapes.iter().map(Shape::axis).collect();
        let numbers = self.merging.begin(&clustering.labels, &axes);
        numbers.iter().for_each(|&number| self.names[number as usize] = after[number as usize]);
        self.energy = numbers.iter().map(|&number| self.merging.cost(number)).sum();
        self.is_bounded |= clustering.ending == Ending::WorkLimit;
        self.merges = Merges::in_rounds(&self.merging);
        self.last = Some(clustering);
        let faces = (0..).zip(before).zip(after);
        Ok(faces.filter(|((_, from), to)| from != to).map(|((face, from), to)| (face, from, to)).collect())
    }

    /// The clusters so far, with shapes; and what the tree calls that of each face.
    fn run(&mut self) -> Result<(Vec<u32>, Run<'a>)> {
        let labels = self.settling.take().map(|settling| settling.clusters.labels);
        let Merged { labels, component_of_cluster, axes, numbers, .. } = self.merging.clusters(labels.as_deref());
        let name = |&label: &u32| self.names[numbers[label as usize] as usize];
        let names = labels.iter().map(name).collect();
        let Merging { faces, allowed, .. } = self.merging;
        Ok((names, Run::of(faces, allowed, labels, component_of_cluster, &axes)?))
    }

    fn end(mut self) -> Result<Hierarchy> {
        let clustering = match self.last.take() {
            Some(clustering) => clustering,
            None => self.run()?.1.ended_at_once(),
        };
        let Clustering { labels, shapes, energies: [_, energy], .. } = clustering;
        let is_bounded = self.is_bounded || self.is_exhausted || self.may_settle != self.options.optimise;
        let ending = if is_bounded { Ending::WorkLimit } else { Ending::Converged };
        Ok(Hierarchy { tree: self.builder.tree, labels, shapes, energy, ending })
    }

    fn in_source_units(&self, energy: f64) -> f64 {
        self.surface.source_of_lattice(energy * f64::from(1u32 << (2 * SHIFT)), 0) / 3.0
    }
}
