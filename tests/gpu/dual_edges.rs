//! Dual edges on the gpu, at the ends of the lattice, against their definition.

use crate::common::gpu::{device, numbers, surface};
use tesserae_mesh::dev::sample::Sample;
use tesserae_mesh::device::dual_edge::{Rank, Ties};
use tesserae_mesh::device::{Device, DualEdge};
use tesserae_mesh::energy::{End, Energy, Functional, Sums};
use tesserae_mesh::surface::{Component, Rows, Surface};

/// Faces a cluster, so that weights reach 2³⁴.
const FACES: usize = 4;

/// A surface of pairs of clusters far from all others. The faces of a cluster lie in its proxy.
fn pairs_of(ends: &[[End<[i32; 3]>; 2]], energy_shift: u32) -> (Surface, Vec<u32>) {
    let mut surface = surface(Sample::Strip, 4);
    let faces = 2 * FACES * ends.len();
    surface.items.graph.points.clear();
    surface.items.graph.weights.clear();
    for end in ends.iter().flatten() {
        for face in 0..FACES as u64 {
            surface.items.graph.points.push(end.proxy);
            surface.items.graph.weights.push(((end.weight + face) / FACES as u64) as u32);
        }
    }
    // the first face of a cluster is beside the first of the other
    surface.items.graph.neighbours = Rows::empty(0);
    for face in 0..faces as u32 {
        surface.items.graph.neighbours.push(match face as usize % (2 * FACES) {
            0 => Some(face + FACES as u32),
            FACES => Some(face - FACES as u32),
            _ => None,
        });
    }
    surface.items.upload_face = (0..faces as u32).collect();
    surface.items.graph.components = vec![Component { energy_shift, ..surface.components[0] }];
    surface.items.graph.components[0].faces = faces as u32;
    let labels = (0..faces as u32).map(|face| face / FACES as u32).collect();
    (surface, labels)
}

/// Ends of all magnitudes, the extremes among them, and many whose costs hardly differ.
fn ends(count: usize) -> Vec<[End<[i32; 3]>; 2]> {
    let mut next = numbers(7);
    let far = (1i32 << 27) - 1;
    let most = (1u64 << 34) - FACES as u64;
    let least = FACES as u64;
    let mut all = vec![
        [End { weight: most, proxy: [far; 3] }, End { weight: most, proxy: [-far; 3] }],
        [End { weight: least, proxy: [far; 3] }, End { weight: most, proxy: [-far; 3] }],
        [End { weight: least, proxy: [0; 3] }, End { weight: least, proxy: [0, 1, 0] }],
        [End { weight: most, proxy: [far; 3] }, End { weight: most, proxy: [far; 3] }],
    ];
    while all.len() < count {
        let mut end = || End {
            weight: (next(1 << 34) >> next(33)).clamp(least, most),
            proxy: std::array::from_fn(|_| {
                let place = (next(1 << 27) >> next(27)) as i32;
                if next(2) == 0 { place } else { -place }
            }),
        };
        let pair = [end(), end()];
        all.push(pair);
        // the next ones in order of cost, and one that is as good
        let [mut heavier, mut farther, mut other_way] = [pair; 3];
        heavier[0].weight = (pair[0].weight + 1).min(most);
        farther[1].proxy[2] = (pair[1].proxy[2] + 1).min(far);
        other_way.reverse();
        all.extend([heavier, farther, other_way]);
    }
    all
}

#[test]
fn packed_costs_are_those_of_the_definition_to_the_last_bit() {
    let mut gpu = device();
    let ends = ends(6000);
    for (energy_shift, ties) in [(0, Ties::Hash), (7, Ties::LargestId), (30, Ties::Hash)] {
        let (surface, labels) = pairs_of(&ends, energy_shift);
        let components = vec![0; 2 * ends.len()];
        let mut steps = gpu.open_merging(&surface, &components).expect("it fits");
        steps.set_labels(&labels).expect("set");
        let found = steps.optimal_dual_edges(ties).expect("a search");
        let expected: Vec<DualEdge> = (0..2 * ends.len() as u32)
            .map(|cluster| {
                let [a, b] = ends[cluster as usize / 2];
                DualEdge { cluster, other: cluster ^ 1, cost: Energy::packed_merge_cost(a, b, energy_shift) }
            })
            .collect();
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found, expected, "{:?}", ends[expected.cluster as usize / 2]);
        }
        let sums = steps.sums_of(&[5, 0]).expect("sums");
        for (sums, end) in sums.iter().zip([ends[2][1], ends[0][0]]) {
            assert_eq!((sums.weight as u64, sums.fit().expect("faces").0), (end.weight, end.proxy));
        }
    }
}

#[test]
fn the_cheapest_dual_edge_is_so_by_exact_cost() {
    let mut gpu = device();
    let ends = ends(260);
    for (energy_shift, ties) in [(0, Ties::LargestId), (30, Ties::Hash)] {
        let (surface, labels) = pairs_of(&ends, energy_shift);
        let components = vec![0; 2 * ends.len()];
        let mut expected: Vec<Rank<u128>> = ends
            .iter()
            .zip(0..)
            .map(|(&[a, b], pair)| Rank::new(Energy::merge_cost(a, b) << energy_shift, 2 * pair, 2 * pair + 1, ties))
            .collect();
        expected.sort_unstable();
        let mut steps = gpu.open_merging(&surface, &components).expect("it fits");
        steps.set_labels(&labels).expect("set");
        // each merge takes the cheapest edge away: the order of all of them is compared
        for (step, expected) in expected.iter().enumerate() {
            let (low, high) = expected.ends();
            assert_eq!(steps.cheapest_dual_edge(ties).expect("a search"), Some((low, high)), "step {step}");
            steps.merge(&[(high, low)]).expect("a merge");
        }
        assert_eq!(steps.cheapest_dual_edge(ties).expect("a search"), None);
        assert_eq!(steps.optimal_dual_edges(ties).expect("a search"), []);
    }
}
