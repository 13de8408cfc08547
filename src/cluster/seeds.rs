//! Where clusters start (P§5.3): random faces, area-stratified random faces along the internal order, or a list.
//!
//! Clusters are shared among the components by area first, so that each gets at least one and none more than it has
//! faces (apportionment by Sainte-Laguë, the rounding that favours neither large nor small components).

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::path::PathBuf;

use crate::device::FREE;
use crate::device::dual_edge::keep_first;
use crate::energy::Functional;
use crate::error::names::{Name, more_than};
use crate::error::{Error, Result};
use crate::surface::{DualGraph, Items, NO_FACE};

/// Where clusters start.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Seeds {
    /// Merged from more clusters, coarse to fine ([`super::coarse`]).
    #[default]
    Coarse,
    /// Merged from single faces ([`super::merging`]), by normals from groups of them ([`super::grouping`]).
    Merged,
    /// One random face in each of k strata of equal area along a Morton curve.
    Morton,
    /// Random faces, all equally likely (P§5.3).
    Random,
    /// A file with a list of face numbers; on the command line only.
    File(PathBuf),
    /// Face numbers that came with the request.
    Listed,
}

/// One face for each cluster, internal order, and the component it lies in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SeedFaces {
    /// The face that each cluster starts from; all different.
    pub face_of_cluster: Vec<u32>,
    /// The component of that face.
    pub component_of_cluster: Vec<u32>,
}

impl SeedFaces {
    /// Labels of the seeds; all other faces are free.
    pub fn labels(&self, faces: usize) -> Vec<u32> {
        labels(&self.face_of_cluster, faces)
    }
}

/// Labels of one face a cluster; all other faces are free.
pub(super) fn labels(face_of_cluster: &[u32], faces: usize) -> Vec<u32> {
    let mut labels = vec![FREE; faces];
    (0..).zip(face_of_cluster).for_each(|(cluster, &face)| labels[face as usize] = cluster);
    labels
}

/// How many clusters each component gets: at least 1, at most its faces, by area. Refuses numbers that the surface
/// cannot have.
pub fn shares<E: Functional>(items: &Items<E>, clusters: u64) -> Result<Vec<usize>> {
    check_number(items, Name::CLUSTERS, clusters)?;
    Ok(apportion(items, clusters as usize))
}

/// Chooses seeds for `clusters` clusters. `listed` are faces of the upload, and then decide alone.
pub fn choose<E: Functional>(
    items: &Items<E>,
    clusters: u64,
    seeds: &Seeds,
    seed: u64,
    listed: Option<&[u32]>,
) -> Result<SeedFaces> {
    let shares = shares(items, clusters)?;
    if let Some(listed) = listed {
        return from_list(items, listed);
    }
    Ok(match seeds {
        Seeds::Random => each_component(&shares, |component, share, _| random(items, component, share, seed)),
        Seeds::Coarse | Seeds::Merged | Seeds::Morton | Seeds::File(_) | Seeds::Listed => {
            stratified(items, &shares, seed)
        }
    })
}

/// Faces along the internal order: so many in each component, one in each of as many strata of equal weight.
pub fn stratified<E: Functional>(graph: &DualGraph<E>, shares: &[usize], seed: u64) -> SeedFaces {
    each_component(shares, |component, share, first_cluster| strata(graph, component, share, seed, first_cluster))
}

/// Seeds that are chosen in each component apart: `choose(component, share, first cluster)`.
fn each_component(shares: &[usize], choose: impl Fn(usize, usize, usize) -> Vec<u32>) -> SeedFaces {
    let mut seeds = SeedFaces { face_of_cluster: Vec::new(), component_of_cluster: Vec::new() };
    for (component, &share) in shares.iter().enumerate() {
        seeds.face_of_cluster.extend(choose(component, share, seeds.face_of_cluster.len()));
        seeds.component_of_cluster.extend(std::iter::repeat_n(component as u32, share));
    }
    seeds
}

/// Refuses a number of clusters that this surface cannot have; `name` is the parameter that has it.
pub(super) fn check_number<E: Functional>(items: &Items<E>, name: Name, number: u64) -> Result<()> {
    let (faces, components) = (items.faces() as u64, items.components.len() as u64);
    if number == 0 {
        return Err(Error::parameter(format_args!("{name} must be at least 1, not 0")));
    }
    if number > faces {
        let loose = match items.loose.len() {
            0 => String::new(),
            loose => format!(" (without {loose} faces that have no area and share no edge with these)"),
        };
        return Err(more_than(name, number, items.noun, format_args!("{faces}{loose}")));
    }
    if number < components && items.has_features {
        return Err(Error::parameter(format_args!(
            "{name} must be at least the number of regions, {components}, into which {} divides the mesh, because a \
             cluster does not cross them (a larger angle makes fewer): {number}",
            Name::FEATURES
        )));
    }
    if number < components {
        return Err(Error::parameter(format_args!(
            "{name} must be at least the number of connected components, {components}, because a cluster cannot \
             reach across a gap ({} joins them): {number}",
            Name::BRIDGE_COMPONENTS
        )));
    }
    Ok(())
}

/// Sainte-Laguë.
fn apportion<E: Functional>(items: &Items<E>, clusters: usize) -> Vec<usize> {
    let components = &items.components;
    let mut shares = vec![1usize; components.len()];
    if let [_] = components[..] {
        return vec![clusters];
    }
    // weights in the finest unit: below 2^(34 + 30)
    let area = |component: usize| u128::from(components[component].weight) << components[component].energy_shift;
    let mut queue: BinaryHeap<Claim> = (0..components.len())
        .filter(|&component| components[component].faces > 1)
        .map(|component| Claim { area: area(component), divisor: 3, component: Reverse(component) })
        .collect();
    for _ in components.len()..clusters {
        let Some(Claim { area, divisor, component }) = queue.pop() else {
            break;
        };
        let share = &mut shares[component.0];
        *share += 1;
        if *share < components[component.0].faces as usize {
            queue.push(Claim { area, divisor: divisor + 2, component });
        }
    }
    shares
}

/// A component's claim to one more cluster: area over 2·share + 1, ties to the component with the smallest face.
#[derive(PartialEq, Eq)]
struct Claim {
    area: u128,
    divisor: u128,
    component: Reverse<usize>,
}

impl Ord for Claim {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        // area < 2⁶⁴ and divisor < 2³³: the products are exact
        (self.area * other.divisor).cmp(&(other.area * self.divisor)).then_with(|| self.component.cmp(&other.component))
    }
}

impl PartialOrd for Claim {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// `share` faces of a component, all sets equally likely: those with the smallest hashes of their upload number.
fn random<E: Functional>(items: &Items<E>, component: usize, share: usize, seed: u64) -> Vec<u32> {
    let range = items.components[component].range();
    let mut hashed: Vec<(u64, u32)> =
        range.map(|face| (hash(seed, u64::from(items.upload_face[face])), face as u32)).collect();
    keep_first(&mut hashed, share);
    let mut faces: Vec<u32> = hashed.into_iter().map(|(_, face)| face).collect();
    faces.sort_unstable();
    faces
}

/// `share` faces of a component: its weight, in internal order, is cut into as many equal strata, and each gives the
/// face at a random point of its middle half: points of the whole stratum end higher
/// (`benches/results/2026-11-22-two-cores/quality.md`). Where faces weigh more than strata, the next face that is still
/// free is taken.
fn strata<E: Functional>(
    graph: &DualGraph<E>,
    component: usize,
    share: usize,
    seed: u64,
    first_cluster: usize,
) -> Vec<u32> {
    let run = graph.components[component];
    let range = run.range();
    let mut faces = Vec::with_capacity(share);
    let mut face = range.start;
    let mut passed = u128::from(graph.weights[face]);
    for stratum in 0..share {
        let offset = run.weight / 4 + hash(seed, (first_cluster + stratum) as u64) % run.weight / 2;
        let point = (u128::from(run.weight) * stratum as u128 + u128::from(offset)) / share as u128;
        let last = range.end - (share - stratum);
        while passed <= point && face < last {
            face += 1;
            passed += u128::from(graph.weights[face]);
        }
        faces.push(face as u32);
        if stratum + 1 < share {
            face += 1;
            passed += u128::from(graph.weights[face]);
        }
    }
    faces
}

/// Listed faces of the upload; cluster i starts from the i-th.
fn from_list<E: Functional>(items: &Items<E>, listed: &[u32]) -> Result<SeedFaces> {
    let internal = items.internal_faces();
    let component_of_face = items.component_of_face();
    let mut seed_of_face = vec![None; items.faces()];
    let mut has_seed = vec![false; items.components.len()];
    let mut chosen = SeedFaces { face_of_cluster: Vec::new(), component_of_cluster: Vec::new() };
    for (seed, &upload) in listed.iter().enumerate() {
        let Some(&face) = internal.get(upload as usize) else {
            return Err(Error::parameter(format_args!(
                "seed {seed} is beyond the last face or item, {}: {upload}",
                internal.len() - 1
            )));
        };
        if face == NO_FACE {
            return Err(Error::parameter(format_args!(
                "seed {seed} is a masked item, or a face without area that shares no edge with others: {upload}"
            )));
        }
        if let Some(earlier) = seed_of_face[face as usize].replace(seed) {
            return Err(Error::parameter(format_args!(
                "seeds {earlier} and {seed} are the same face or item: {upload}"
            )));
        }
        let component = component_of_face[face as usize];
        has_seed[component as usize] = true;
        chosen.face_of_cluster.push(face);
        chosen.component_of_cluster.push(component);
    }
    let with_seed = has_seed.iter().filter(|&&has| has).count();
    if with_seed < has_seed.len() {
        return Err(Error::parameter(format_args!(
            "seeds lie in {with_seed} of the {} connected components; every component needs one ({} joins them)",
            has_seed.len(),
            Name::BRIDGE_COMPONENTS
        )));
    }
    Ok(chosen)
}

/// Two rounds of the SplitMix64 finaliser: every bit of the result depends on every bit of both numbers.
fn hash(seed: u64, number: u64) -> u64 {
    let mix = |mut x: u64| {
        x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ x >> 31
    };
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    mix(mix(seed.wrapping_add(GOLDEN)) ^ number.wrapping_add(1).wrapping_mul(GOLDEN))
}
