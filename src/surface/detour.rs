//! A local test whether a cluster stays connected when a face leaves it.
//!
//! Most faces that leave do not cut their cluster, and a short way around the face shows it. Without this test, repair
//! searches every cluster that lost a face (`benches/results/2026-11-22-two-cores/deleted.md`).

use crate::energy::Functional;
use crate::surface::DualGraph;

/// Faces near the first neighbour that are remembered at most.
const NEARBY: usize = 16;

/// Faces that are visited at most on the ways from the other neighbours.
const VISITS: usize = 32;

/// Neighbours of a face that are considered: large polygons have more.
const NEIGHBOURS: usize = 16;

/// Length of a way from another neighbour; from the first neighbour it is two.
const STEPS: usize = 3;

/// Whether a connected cluster surely stays connected without `face`, which has left it: whether its neighbours in the
/// cluster are connected by short ways around the face, which any way through the face can take instead.
pub fn surely_stays_connected<E: Functional>(graph: &DualGraph<E>, face: u32, is_own: impl Fn(u32) -> bool) -> bool {
    let is_own = |near: &u32| is_own(*near);
    let mut own = graph.neighbours_of(face).iter().copied().filter(is_own);
    let Some((first, second)) = own.next().zip(own.next()) else { return true };
    let mut nearby = [first; NEARBY];
    let mut found = 1;
    for expanded in [0..1, 1..NEARBY] {
        for at in expanded.start..expanded.end.min(found) {
            for near in graph.neighbours_of(nearby[at]).iter().take(NEIGHBOURS).copied().filter(is_own) {
                if found < NEARBY && near != first {
                    nearby[found] = near;
                    found += 1;
                }
            }
        }
    }
    let mut visits = VISITS;
    std::iter::once(second)
        .chain(own)
        .all(|other| leads_to(graph, &is_own, &nearby[..found], [other, face], STEPS, &mut visits))
}

/// Whether a way of at most `steps` faces of the cluster leads from a face, which was reached from `before`, to one of
/// `nearby`.
fn leads_to<E: Functional>(
    graph: &DualGraph<E>,
    is_own: &impl Fn(&u32) -> bool,
    nearby: &[u32],
    [face, before]: [u32; 2],
    steps: usize,
    visits: &mut usize,
) -> bool {
    if nearby.contains(&face) {
        return true;
    }
    if steps == 0 {
        return false;
    }
    graph.neighbours_of(face).iter().take(NEIGHBOURS).any(|&near| {
        if near == before || *visits == 0 || !is_own(&near) {
            return false;
        }
        *visits -= 1;
        leads_to(graph, is_own, nearby, [near, face], steps - 1, visits)
    })
}
