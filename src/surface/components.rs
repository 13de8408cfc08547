//! Sets of faces connected across shared edges.

use std::hint::select_unpredictable;
use std::ops::Range;

use super::adjacency::Links;
use crate::union_find;

/// A set of faces connected across shared edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Component {
    /// First face, internal order.
    pub first_face: u32,
    /// Number of faces.
    pub faces: u32,
    /// Sum of their weights.
    pub weight: u64,
    /// A unit of weight here counts `2^energy_shift` units of the component with the finest unit: 0 ..= 30.
    pub energy_shift: u32,
}

impl Component {
    /// Its faces, internal order.
    pub fn range(&self) -> Range<usize> {
        self.first_face as usize..(self.first_face + self.faces) as usize
    }
}

/// Which face is in which component.
#[derive(Debug)]
pub struct Components {
    /// The component of each face, numbered in the order of their smallest face; [`NO_COMPONENT`] of a loose one.
    pub of_face: Vec<u32>,
    /// How many there are.
    pub count: usize,
}

/// Of a face that takes no part in the clustering.
pub const NO_COMPONENT: u32 = u32::MAX;

/// Finds the components.
pub fn label(faces: usize, links: &Links<'_>) -> Components {
    // a link to a number above all faces is none
    let mut sets = union_find::forest(faces, |face| {
        links.beside(face as usize).map(move |other| select_unpredictable(other < face, other, face))
    });
    for &(face, other) in &links.bridges {
        union_find::join(&mut sets, face, other);
    }
    let (of_face, count) = union_find::numbered(sets);
    Components { of_face, count }
}

impl Components {
    /// Takes the faces of whole components out.
    pub fn leave_out(&mut self, faces: impl Iterator<Item = u32>) {
        let mut is_left_out = vec![false; self.count];
        for face in faces {
            let component = std::mem::replace(&mut self.of_face[face as usize], NO_COMPONENT);
            is_left_out[component as usize] = true;
        }
        let mut kept = 0;
        let number: Vec<u32> = is_left_out
            .iter()
            .map(|&is_left_out| {
                kept += u32::from(!is_left_out);
                kept.wrapping_sub(1)
            })
            .collect();
        let others = self.of_face.iter_mut().filter(|component| **component != NO_COMPONENT);
        others.for_each(|component| *component = number[*component as usize]);
        self.count = kept as usize;
    }

    /// The run of internal faces that each component occupies.
    pub fn runs(&self, upload_face: &[u32]) -> Vec<Range<usize>> {
        if self.count == 1 {
            return std::iter::once(0..upload_face.len()).collect();
        }
        let component = |face: u32| self.of_face[face as usize];
        let mut runs = Vec::with_capacity(self.count);
        let mut start = 0;
        for run in upload_face.chunk_by(|&a, &b| component(a) == component(b)) {
            runs.push(start..start + run.len());
            start += run.len();
        }
        runs
    }
}
