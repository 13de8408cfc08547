//! The self-test of a connection: all kernels that decide a label, on a small made-up graph, against the cpu.
//!
//! Kernels compute with 64-bit integers, which few programs do on a gpu, and with atomics; a driver may get either
//! wrong. The graph has the largest coordinates, weights and shifts that the arithmetic allows, so that each division,
//! shift, carry and sum is made with small and large numbers: growth, boundary phase, refinement, repair, dual edges,
//! a merge, and labels and energy after each. It takes some 150 dispatches, about a millisecond on a card.

use std::sync::Arc;

use super::connection::Connection;
use super::state::GpuSteps;
use crate::device::cpu::CpuDevice;
use crate::device::dual_edge::{Rank, Ties, mutual};
use crate::device::{Cancel, Device, FREE, MergeSteps, Step};
use crate::energy::Words;
use crate::error::{Error, Kind, Result};
use crate::surface::{Component, DualGraph, Moves, Rows};

/// Faces in a row of a component, and rows.
const SIDE: u32 = 32;

/// Faces of a component.
const FACES: u32 = SIDE * SIDE;

/// A seed stands on every face whose row and column are multiples of this.
const SEEDS_APART: u32 = 4;

/// Clusters of a component.
const CLUSTERS: u32 = (SIDE / SEEDS_APART) * (SIDE / SEEDS_APART);

/// The `energy_shift` of each component: none, and the largest.
const SHIFTS: [u32; 2] = [0, 30];

/// Fails with [`Kind::DeviceUnsuitable`] and what differed where the device computes other numbers than the cpu. With
/// `is_paged`, kernels for buffers in pages do.
pub(super) fn run<E: Words>(connection: &Arc<Connection>, is_paged: bool) -> Result<()> {
    let graph = graph::<E>();
    let component_of_cluster: Vec<u32> = (0..).zip(SHIFTS).flat_map(|(at, _)| [at; 2 * CLUSTERS as usize]).collect();
    let unsuitable = |why: &str| {
        let name = &connection.name;
        let message = format_args!("the gpu {name} is not used, since its self-test gave wrong numbers: {why}");
        Err(Error::unsuitable(message))
    };
    let mut steps = GpuSteps::new(Arc::clone(connection), &graph, &component_of_cluster, true, is_paged)?;
    let found = match results(&mut steps) {
        Err(error) if error.kind == Kind::DeviceWrong => return unsuitable(&error.message),
        found => found?,
    };
    let mut cpu = CpuDevice::new();
    let expected = results(cpu.open_merging(&graph, &component_of_cluster)?.as_mut())?;
    difference(&found, &expected).map_or(Ok(()), |why| unsuitable(&why))
}

/// A step, and the numbers that it gave.
type Numbers = (&'static str, Vec<i128>);

/// The numbers that all steps give.
fn results<E: Words>(steps: &mut dyn MergeSteps<E>) -> Result<Vec<Numbers>> {
    let cancel = Cancel::default();
    let mut all: Vec<Numbers> = Vec::new();
    let labels = |steps: &mut dyn MergeSteps<E>| -> Result<Vec<i128>> {
        let energy = steps.energy()?.explained;
        Ok(std::iter::once(energy).chain(steps.labels()?.into_iter().map(i128::from)).collect())
    };
    steps.set_labels(&seeds())?;
    steps.grow(&cancel)?;
    all.push(("growth", labels(steps)?));
    let mut moves = Vec::new();
    let mut on_step = |step: Step| moves.extend([step.energy.explained, step.moves.into()]);
    steps.optimise_boundary(3, &cancel, &mut on_step)?;
    all.push(("boundary phase", std::mem::take(&mut moves)));
    let mut on_step = |step: Step| moves.extend([step.energy.explained, step.moves.into()]);
    steps.refine(3, &cancel, &mut on_step)?;
    all.push(("refinement", moves));
    all.push(("repair", vec![steps.repair(&cancel)?.into()]));
    all.push(("labels", labels(steps)?));
    let edges = steps.optimal_dual_edges(Ties::Hash)?;
    let numbers = edges.iter().flat_map(|edge| [edge.cluster, edge.other, edge.cost].map(i128::from));
    all.push(("best dual edges", numbers.collect()));
    let cheapest = steps.cheapest_dual_edge(Ties::Hash)?;
    all.push(("cheapest dual edge", cheapest.iter().flat_map(|&(a, b)| [a, b].map(i128::from)).collect()));
    let mut pairs: Vec<(u32, u32)> = mutual(&edges, &mut Vec::new()).iter().map(Rank::ends).collect();
    pairs.sort_unstable();
    let (ordered, _) = steps.merge_pairs(&pairs)?;
    all.push(("merges", ordered.iter().flat_map(|&(from, into)| [from, into].map(i128::from)).collect()));
    all.push(("labels after merges", labels(steps)?));
    Ok(all)
}

/// Where numbers first differ.
fn difference(found: &[Numbers], expected: &[Numbers]) -> Option<String> {
    let (found, expected) = found.iter().zip(expected).find(|(found, expected)| found != expected)?;
    let step = expected.0;
    if found.1.len() != expected.1.len() {
        return Some(format!("{step}: {} numbers instead of {}", found.1.len(), expected.1.len()));
    }
    let at = found.1.iter().zip(&expected.1).position(|(found, expected)| found != expected)?;
    Some(format!("{step}: number {at} must be {} and was {}", expected.1[at], found.1[at]))
}

/// One face in every other cluster, all others free.
fn seeds() -> Vec<u32> {
    let label = |face: u32| {
        let (component, row, column) = (face / FACES, face % FACES / SIDE, face % SIDE);
        let is_seed = row % SEEDS_APART == 0 && column % SEEDS_APART == 0;
        let place = (row * SIDE / SEEDS_APART + column) / SEEDS_APART;
        if is_seed { 2 * (component * CLUSTERS + place) } else { FREE }
    };
    (0..SHIFTS.len() as u32 * FACES).map(label).collect()
}

/// Two squares of faces, each a component. Places reach to the ends of the lattice in one, and are close together in
/// the other; weights have 1 to 32 bits.
fn graph<E: Words>() -> DualGraph<E> {
    // a coordinate is below 2 to this
    let bits_of_places = if E::AXES <= 4 { 27 } else { 26 };
    let mut state = 1u64;
    // a number of `bits` bits at most
    let mut random = |bits: u32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u32 >> (31 - bits)
    };
    let mut graph = DualGraph {
        points: Vec::new(),
        weights: Vec::new(),
        neighbours: Rows::empty(0),
        components: Vec::new(),
        moves: Moves::Free,
    };
    for (component, energy_shift) in (0..).zip(SHIFTS) {
        let first = component * FACES;
        let scale = bits_of_places - 4 - 14 * component;
        for at in 0..FACES {
            let (row, column) = (at / SIDE, at % SIDE);
            // the middle of the square is the origin
            let middle = (SIDE / 2) << scale;
            let place = |index: u32, beyond: u32| ((index << scale) + beyond) as i32 - middle as i32;
            graph.points.push(E::point(|axis| {
                let (index, bits) = match axis {
                    0 => (column, scale),
                    1 => (row, scale),
                    _ => (SIDE / 2, scale + 2),
                };
                place(index, random(bits)).max(1 - (1 << bits_of_places))
            }));
            let bits = 1 + random(5) % 24;
            // the sum of a component stays below 2³⁴
            graph.weights.push(if at == FACES / 2 { u32::MAX } else { 1 + random(bits) });
            let beside = [
                (row > 0).then(|| at - SIDE),
                (column > 0).then(|| at - 1),
                (column + 1 < SIDE).then_some(at + 1),
                (row + 1 < SIDE).then_some(at + SIDE),
            ];
            graph.neighbours.push(beside.into_iter().flatten().map(|near| first + near));
        }
        let range = first as usize..(first + FACES) as usize;
        let weight = graph.weights[range].iter().map(|&weight| u64::from(weight)).sum();
        graph.components.push(Component { first_face: first, faces: FACES, weight, energy_shift });
    }
    graph
}
