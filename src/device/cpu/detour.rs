//! A local test whether a cluster stays connected when a face leaves it.
//!
//! Most faces that leave do not cut their cluster, and a short way around the face shows it. Without this test, repair
//! searches every cluster that lost a face: a whole hierarchy of the bunny with optimisation then takes 1.1 to 1.2
//! times as long (`benches/results/2026-11-22-two-cores/deleted.md`).

use crate::surface::DualGraph;

/// Faces that are visited at most, and neighbours of a face that are considered: large polygons have more.
const VISITS: usize = 16;

/// Whether a connected cluster surely stays connected without `face`, which is not among its own: whether a short walk
/// from one of the face's neighbours in the cluster reaches the others. A way through the face can then go around it.
pub fn surely_stays_connected(graph: &DualGraph, face: u32, is_own: impl Fn(u32) -> bool) -> bool {
    let mut beside = graph.neighbours_of(face).iter().copied().filter(|&near| is_own(near));
    let Some(first) = beside.next() else { return true };
    let mut visited = [first; VISITS];
    let (mut count, mut expanded) = (1, 0);
    beside.all(|other| {
        while expanded < count && !visited[..count].contains(&other) {
            for &near in graph.neighbours_of(visited[expanded]).iter().take(VISITS) {
                if count < VISITS && !visited[..count].contains(&near) && is_own(near) {
                    visited[count] = near;
                    count += 1;
                }
            }
            expanded += 1;
        }
        visited[..count].contains(&other)
    })
}
