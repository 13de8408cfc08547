//! Initial growth (P§5.3): breadth first, the smallest cluster wins a contested face.

use super::labels::Labels;
use crate::device::{Cancel, FREE};
use crate::error::Result;
use crate::surface::DualGraph;

/// Scratch memory of growth, kept between growths.
#[derive(Debug, Default)]
pub struct Growth {
    /// The smallest label offered to each free face in the current pass; [`FREE`] between passes. Empty before the
    /// first growth.
    offered: Vec<u32>,
}

impl Growth {
    /// Labels all free faces that can be reached from the labelled faces in `front`, which holds all neighbours of free
    /// faces.
    ///
    /// Only faces labelled in the last pass have free neighbours, so the cost is in proportion to the faces labelled.
    pub fn grow(&mut self, graph: &DualGraph, labels: &mut Labels, mut front: Vec<u32>, cancel: &Cancel) -> Result<()> {
        self.offered.resize(graph.faces(), FREE);
        let mut reached = Vec::new();
        while !front.is_empty() {
            cancel.check()?;
            reached.clear();
            for &face in &front {
                let label = labels.of(face);
                for &near in graph.neighbours_of(face) {
                    if labels.of(near) == FREE {
                        let offer = &mut self.offered[near as usize];
                        if *offer == FREE {
                            reached.push(near);
                        }
                        *offer = label.min(*offer);
                    }
                }
            }
            std::mem::swap(&mut front, &mut reached);
            for &face in &front {
                labels.set(face, std::mem::replace(&mut self.offered[face as usize], FREE));
            }
        }
        Ok(())
    }
}
