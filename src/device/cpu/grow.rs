//! Initial growth (P§5.3): breadth first, the smallest cluster wins a contested face.

use super::labels::Labels;
use crate::device::{Cancel, FREE};
use crate::error::Result;
use crate::surface::DualGraph;

/// What growth needs to remember; kept between growths to save its memory.
#[derive(Debug, Default)]
pub struct Growth {
    /// The smallest label offered to each free face in the current pass; [`FREE`] between passes. Empty until something grows.
    offered: Vec<u32>,
}

impl Growth {
    /// Labels all free faces that can be reached from the labelled faces in `frontier`, which must hold all those
    /// beside a free face. Returns the faces it labelled.
    ///
    /// Only the faces labelled in the last pass can offer a label to a face that is still free: what lay beside an
    /// earlier one was labelled then. The cost is in proportion to the faces labelled.
    pub fn grow(
        &mut self,
        graph: &DualGraph,
        labels: &mut Labels,
        mut frontier: Vec<u32>,
        cancel: &Cancel,
    ) -> Result<Vec<u32>> {
        self.offered.resize(graph.faces(), FREE);
        let mut grown = Vec::new();
        while !frontier.is_empty() {
            cancel.check()?;
            let first = grown.len();
            for &face in &frontier {
                let label = labels.of(face);
                for &near in graph.neighbours_of(face) {
                    if labels.of(near) == FREE {
                        let offer = &mut self.offered[near as usize];
                        if *offer == FREE {
                            grown.push(near);
                        }
                        *offer = label.min(*offer);
                    }
                }
            }
            frontier.clear();
            frontier.extend_from_slice(&grown[first..]);
            for &face in &frontier {
                labels.set(face, std::mem::replace(&mut self.offered[face as usize], FREE));
            }
        }
        Ok(grown)
    }
}
