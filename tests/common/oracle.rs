//! Boundary-based clustering as the definition in `tesserae::cluster` says it, one sentence a statement: sequential,
//! everything recomputed in every iteration, wide integers throughout. Slow and plain on purpose.

use tesserae::device::FREE;
use tesserae::surface::Surface;

/// The state after an iteration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct State {
    pub labels: Vec<u32>,
    /// Σ (2·P·S − M·|P|²) << shift.
    pub explained: i128,
    pub moves: u64,
}

/// Labels after growth from `seeds`.
pub fn grow(surface: &Surface, labels: &[u32]) -> Vec<u32> {
    let mut labels = labels.to_vec();
    loop {
        let before = labels.clone();
        for face in 0..labels.len() as u32 {
            if before[face as usize] == FREE {
                let reach = surface.neighbours_of(face).iter().map(|&near| before[near as usize]);
                labels[face as usize] = reach.min().unwrap_or(FREE);
            }
        }
        if labels == before {
            return labels;
        }
    }
}

/// Sums of one cluster: S, M, faces.
#[derive(Clone, Default)]
struct Sums {
    s: [i128; 3],
    m: i128,
    faces: usize,
}

fn sums(surface: &Surface, clusters: usize, labels: &[u32]) -> Vec<Sums> {
    let mut all = vec![Sums::default(); clusters];
    for (face, &label) in labels.iter().enumerate() {
        let weight = i128::from(surface.weights[face]);
        let sums = &mut all[label as usize];
        for axis in 0..3 {
            sums.s[axis] += weight * i128::from(surface.centroids[face][axis]);
        }
        sums.m += weight;
        sums.faces += 1;
    }
    all
}

fn proxy(sums: &Sums) -> [i128; 3] {
    sums.s.map(|s| (2 * s + sums.m).div_euclid(2 * sums.m))
}

pub fn explained(surface: &Surface, component_of_cluster: &[u32], labels: &[u32]) -> i128 {
    let sums = sums(surface, component_of_cluster.len(), labels);
    sums.iter()
        .zip(component_of_cluster)
        .filter(|(sums, _)| sums.faces > 0)
        .map(|(sums, &component)| {
            let proxy = proxy(sums);
            let along: i128 = (0..3).map(|axis| 2 * proxy[axis] * sums.s[axis]).sum();
            let square: i128 = proxy.iter().map(|p| p * p).sum();
            (along - sums.m * square) << surface.components[component as usize].energy_shift
        })
        .sum()
}

/// One iteration; None when nothing moves.
pub fn iterate(surface: &Surface, component_of_cluster: &[u32], labels: &[u32]) -> Option<State> {
    let sums = sums(surface, component_of_cluster.len(), labels);
    let proxies: Vec<Option<[i128; 3]>> = sums.iter().map(|sums| (sums.faces > 0).then(|| proxy(sums))).collect();
    let distance = |face: usize, cluster: u32| {
        let proxy = proxies[cluster as usize].expect("a cluster that a face carries has faces");
        (0..3).map(|axis| (i128::from(surface.centroids[face][axis]) - proxy[axis]).pow(2)).sum::<i128>()
    };
    let wishes: Vec<Option<u32>> = (0..labels.len())
        .map(|face| {
            let own = labels[face];
            let near = surface.neighbours_of(face as u32).iter().map(|&near| labels[near as usize]);
            let (best, to) = near.filter(|&label| label != own).map(|label| (distance(face, label), label)).min()?;
            (best < distance(face, own)).then_some(to)
        })
        .collect();
    let mut after = labels.to_vec();
    let mut moves = 0;
    for face in 0..labels.len() {
        let Some(to) = wishes[face] else { continue };
        let own = labels[face];
        let leavers: Vec<usize> = (0..labels.len()).filter(|&f| labels[f] == own && wishes[f].is_some()).collect();
        if leavers.len() == sums[own as usize].faces && leavers[0] == face {
            continue;
        }
        after[face] = to;
        moves += 1;
    }
    let explained = explained(surface, component_of_cluster, &after);
    (moves > 0).then_some(State { labels: after, explained, moves })
}
