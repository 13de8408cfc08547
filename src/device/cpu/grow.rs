//! Initial growth (P§5.3): breadth first, the smallest cluster wins a contested face.

use super::labels::Labels;
use crate::device::{Cancel, FREE};
use crate::error::Result;
use crate::surface::DualGraph;

/// Labels all free faces that can be reached from the labelled faces in `front`, which holds all neighbours of free faces.
///
/// Only faces labelled in the last pass have free neighbours, so the cost is in proportion to the faces labelled.
pub fn grow(graph: &DualGraph, labels: &mut Labels, mut front: Vec<u32>, cancel: &Cancel) -> Result<()> {
    // the smallest label offered to each free face in the current pass; none between passes
    let mut offered = vec![FREE; graph.faces()];
    let mut reached = Vec::new();
    while !front.is_empty() {
        cancel.check()?;
        reached.clear();
        for &face in &front {
            let label = labels.of(face);
            for &near in graph.neighbours_of(face) {
                if labels.of(near) == FREE {
                    let offer = &mut offered[near as usize];
                    if *offer == FREE {
                        reached.push(near);
                    }
                    *offer = label.min(*offer);
                }
            }
        }
        std::mem::swap(&mut front, &mut reached);
        for &face in &front {
            labels.set(face, std::mem::replace(&mut offered[face as usize], FREE));
        }
    }
    Ok(())
}
