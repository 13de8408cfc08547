//! Bridges: dual edges between components, which share no edge. With them one tree covers separate parts, and there may
//! be fewer clusters than parts.
//!
//! A component is represented by the face nearest to its proxy. Components whose proxies are near each other are
//! joined: the candidates are neighbours along Morton curves through the proxies, on the lattice as it is and shifted
//! twice, and of those a minimum spanning tree by distance is taken. So there is one bridge less than components, no
//! component has more than six, and the cost is that of sorting.

use glam::DVec3;

use super::components::{Components, NO_COMPONENT};
use super::lattice::FaceGeometry;
use super::order::along_curve;
use crate::union_find::join;

/// Shifts of the lattice for each curve, as parts of its width: thirds cut cells of all sizes elsewhere.
const SHIFTS: [f64; 3] = [0.0, 1.0 / 3.0, 2.0 / 3.0];
/// Half of the lattice's width.
const REACH: f64 = (1 << 27) as f64;

/// Pairs of faces (upload numbers) that join all components into one. Loose faces take no part.
pub fn bridges(geometry: &[FaceGeometry], components: &Components) -> Vec<(u32, u32)> {
    let (component_of_face, components) = (&components.of_face, components.count);
    let proxies = proxies(geometry, component_of_face, components);
    let representatives = representatives(geometry, component_of_face, &proxies);
    let mut candidates: Vec<(f64, u32, u32)> = Vec::new();
    for shift in SHIFTS {
        // at half size, so that the shifted lattice holds them
        let shifted = |components: &[u32], visit: &mut dyn FnMut(usize, DVec3)| {
            for (at, &component) in components.iter().enumerate() {
                visit(at, (proxies[component as usize] + REACH * shift) / 2.0);
            }
        };
        let sorted = along_curve(components, &shifted);
        candidates.extend(sorted.windows(2).map(|pair| {
            let (a, b) = (pair[0].min(pair[1]), pair[0].max(pair[1]));
            (proxies[a as usize].distance_squared(proxies[b as usize]), a, b)
        }));
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut parent: Vec<u32> = (0..components as u32).collect();
    let mut bridges = Vec::with_capacity(components.saturating_sub(1));
    for (_, a, b) in candidates {
        if join(&mut parent, a, b) {
            bridges.push((representatives[a as usize], representatives[b as usize]));
        }
    }
    bridges
}

/// Area-weighted mean centroid of each component; of its faces' centroids where there is no area.
fn proxies(geometry: &[FaceGeometry], component_of_face: &[u32], components: usize) -> Vec<DVec3> {
    // sums with the areas as weights, and with 1
    let mut sums = vec![[(DVec3::ZERO, 0.0); 2]; components];
    for (face, &component) in
        geometry.iter().zip(component_of_face).filter(|(_, component)| **component != NO_COMPONENT)
    {
        for ((sum, total), weight) in sums[component as usize].iter_mut().zip([face.area, 1.0]) {
            *sum += weight * face.centroid;
            *total += weight;
        }
    }
    let used = sums.into_iter().map(|[weighted, plain]| if weighted.1 > 0.0 { weighted } else { plain });
    used.map(|(sum, total)| sum / total).collect()
}

/// The face of each component that is nearest to its proxy, the smallest of equally near ones.
fn representatives(geometry: &[FaceGeometry], component_of_face: &[u32], proxies: &[DVec3]) -> Vec<u32> {
    let mut nearest = vec![(f64::INFINITY, 0u32); proxies.len()];
    let all = geometry.iter().zip(component_of_face).enumerate();
    for (face, (geometry, &component)) in all.filter(|(_, (_, component))| **component != NO_COMPONENT) {
        let distance = geometry.centroid.distance_squared(proxies[component as usize]);
        let best = &mut nearest[component as usize];
        if distance < best.0 {
            *best = (distance, face as u32);
        }
    }
    nearest.into_iter().map(|(_, face)| face).collect()
}
