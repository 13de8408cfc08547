//! Initial growth (P§5.3): breadth first, the smallest cluster wins a contested face.

use super::labels::Labels;
use crate::device::{Cancel, FREE};
use crate::error::Result;
use crate::surface::DualGraph;

/// Labels all free faces that can be reached from the labelled faces in `front`, which holds all neighbours of free
/// faces.
///
/// Only faces labelled in the last pass have free neighbours, so the cost is in proportion to the faces labelled.
pub fn grow(graph: &DualGraph, labels: &mut Labels, mut front: Vec<u32>, cancel: &Cancel) -> Result<()> {
    while !front.is_empty() {
        cancel.check()?;
        let mut offers = Vec::new();
        for face in front {
            let label = labels.of(face);
            let free = graph.neighbours_of(face).iter().filter(|&&near| labels.of(near) == FREE);
            offers.extend(free.map(|&near| (near, label)));
        }
        // the smallest offer of each face
        offers.sort_unstable();
        offers.dedup_by_key(|&mut (face, _)| face);
        offers.iter().for_each(|&(face, label)| labels.set(face, label));
        front = offers.into_iter().map(|(face, _)| face).collect();
    }
    Ok(())
}
