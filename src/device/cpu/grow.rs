//! Initial growth (P§5.3): breadth first, the smallest cluster wins a contested face.

use crate::device::{Cancel, FREE};
use crate::error::Result;
use crate::surface::Surface;

/// Labels all free faces that can be reached from labelled ones.
///
/// Only the faces labelled in the last pass can offer a label to a face that is still free: what lay beside an earlier
/// one was labelled then. The cost is in proportion to the faces labelled.
pub fn grow(surface: &Surface, labels: &mut [u32], cancel: &Cancel) -> Result<()> {
    let mut frontier: Vec<u32> = (0..labels.len() as u32)
        .filter(|&face| {
            labels[face as usize] != FREE
                && surface.neighbours_of(face).iter().any(|&neighbour| labels[neighbour as usize] == FREE)
        })
        .collect();
    let mut offered = vec![FREE; labels.len()];
    let mut reached = Vec::new();
    while !frontier.is_empty() {
        cancel.check()?;
        for &face in &frontier {
            let label = labels[face as usize];
            for &neighbour in surface.neighbours_of(face) {
                if labels[neighbour as usize] == FREE {
                    let offer = &mut offered[neighbour as usize];
                    if *offer == FREE {
                        reached.push(neighbour);
                    }
                    *offer = label.min(*offer);
                }
            }
        }
        for &face in &reached {
            labels[face as usize] = offered[face as usize];
        }
        std::mem::swap(&mut frontier, &mut reached);
        reached.clear();
    }
    Ok(())
}
