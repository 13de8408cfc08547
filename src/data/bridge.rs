//! Bridges: edges that join all components of points into one.
//!
//! Points of up to three coordinates get those of a surface. With more, a component is represented by the member
//! nearest to its mean, and the bridges are the minimum spanning tree of all means. That takes the square of the number
//! of components, so above [`MOST_MEANS`] of them neighbours along the internal curve that lie in two components are
//! joined, where those are not connected yet.

use glam::DVec3;

use super::knn::squared_length;
use crate::surface::bridge;
use crate::surface::components::Components;
use crate::surface::lattice::FaceGeometry;
use crate::union_find;

/// Components whose means are compared pair by pair.
const MOST_MEANS: usize = 1 << 12;

/// Pairs of members that join all components. `weight` is that of a member, in any unit; `sorted` has the members
/// along the curve.
pub fn bridges<const D: usize>(
    points: &[[i32; D]],
    dimensions: usize,
    weight: impl Fn(u32) -> f64,
    components: &Components,
    sorted: &[u32],
) -> Vec<(u32, u32)> {
    if dimensions <= 3 {
        let geometry = (0..).zip(points).map(|(member, point)| {
            let mut place = [0.0; 3];
            place.iter_mut().zip(point).for_each(|(to, &x)| *to = f64::from(x));
            FaceGeometry::new(DVec3::from(place), weight(member))
        });
        return bridge::bridges(&geometry.collect::<Vec<_>>(), components);
    }
    if components.count > MOST_MEANS {
        return along(sorted, components);
    }
    let means = means(points, weight, components);
    let nearest = nearest(points, &means, components);
    spanning_tree(&means).into_iter().map(|(a, b)| (nearest[a], nearest[b])).collect()
}

/// Members beside each other on the curve that join two components.
fn along(sorted: &[u32], components: &Components) -> Vec<(u32, u32)> {
    let mut sets = union_find::singletons(components.count);
    let component = |member: u32| components.of_face[member as usize];
    let pairs = sorted.windows(2).map(|pair| (pair[0], pair[1]));
    pairs.filter(|&(a, b)| union_find::join(&mut sets, component(a), component(b))).collect()
}

/// The lattice point nearest to the weighted mean of each component. Sums are in the order of the members.
fn means<const D: usize>(points: &[[i32; D]], weight: impl Fn(u32) -> f64, components: &Components) -> Vec<[i32; D]> {
    let mut sums = vec![([0.0; D], 0.0); components.count];
    for ((member, point), &component) in (0..).zip(points).zip(&components.of_face) {
        let (sum, total) = &mut sums[component as usize];
        let weight = weight(member);
        sum.iter_mut().zip(point).for_each(|(sum, &x)| *sum += weight * f64::from(x));
        *total += weight;
    }
    sums.into_iter().map(|(sum, total)| sum.map(|sum| (sum / total + 0.5).floor() as i32)).collect()
}

/// The member of each component that is nearest to a point, the first of equally near ones.
fn nearest<const D: usize>(points: &[[i32; D]], means: &[[i32; D]], components: &Components) -> Vec<u32> {
    let mut nearest = vec![(u64::MAX, 0); means.len()];
    for ((member, point), &component) in (0..).zip(points).zip(&components.of_face) {
        let best = &mut nearest[component as usize];
        *best = (*best).min((squared_length(point, &means[component as usize]), member));
    }
    nearest.into_iter().map(|(_, member)| member).collect()
}

/// The minimum spanning tree of points; edges of equal length go by their ends (Prim 1957).
fn spanning_tree<const D: usize>(points: &[[i32; D]]) -> Vec<(usize, usize)> {
    // of each point outside the tree, the shortest edge into it
    let mut edges: Vec<(u64, usize, usize)> = vec![(u64::MAX, 0, 0); points.len()];
    let mut outside: Vec<usize> = (1..points.len()).collect();
    let (mut last, mut tree) = (0, Vec::with_capacity(points.len()));
    while !outside.is_empty() {
        for &point in &outside {
            let length = squared_length(&points[point], &points[last]);
            edges[point] = edges[point].min((length, point.min(last), point.max(last)));
        }
        let Some(at) = (0..outside.len()).min_by_key(|&at| edges[outside[at]]) else { break };
        last = outside.swap_remove(at);
        let (_, a, b) = edges[last];
        tree.push((a, b));
    }
    tree
}
