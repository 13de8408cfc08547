//! Initial growth (P§5.3): breadth first, the smallest cluster wins a contested face.

use super::labels::Labels;
use crate::device::{Cancel, FREE};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::DualGraph;

/// Labels all of the free faces that can be reached from labelled ones.
///
/// Only faces labelled in the last pass have free neighbours, so the cost is in proportion to the faces labelled.
pub fn grow<E: Functional>(graph: &DualGraph<E>, labels: &mut Labels, free: &[u32], cancel: &Cancel) -> Result<()> {
    let beside = free.iter().flat_map(|&face| graph.neighbours_of(face)).copied();
    let mut front: Vec<u32> = beside.filter(|&near| labels.of(near) != FREE).collect();
    front.sort_unstable();
    front.dedup();
    while !front.is_empty() {
        cancel.check()?;
        let mut offers = Vec::new();
        for face in front {
            let label = labels.of(face);
            let free = graph.neighbours_of(face).iter().filter(|&&near| labels.of(near) == FREE);
            offers.extend(free.map(|&near| (near, label)));
        }
        front = Vec::new();
        for (face, label) in offers {
            let smallest = labels.of(face);
            if smallest == FREE {
                front.push(face);
            }
            labels.set(face, smallest.min(label));
        }
    }
    Ok(())
}
