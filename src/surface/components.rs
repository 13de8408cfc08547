//! Sets of faces connected across shared edges.

use std::ops::Range;

use super::adjacency::Links;

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
    /// The component of each face, numbered in the order of their smallest face.
    pub of_face: Vec<u32>,
    /// How many there are.
    pub count: usize,
}

/// Finds the components.
///
/// Union-find in which the smaller face becomes the root.
pub fn label(faces: usize, links: &Links<'_>) -> Components {
    let mut parent: Vec<u32> = (0..faces as u32).collect();
    links.each_pair(|a, b| {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b) as usize] = a.min(b);
    });
    let mut count = 0;
    for face in 0..faces {
        // a parent is never larger than its child, so it already holds its component's number
        let up = parent[face] as usize;
        parent[face] = if up == face {
            count += 1;
            count - 1
        } else {
            parent[up]
        };
    }
    Components { of_face: parent, count: count as usize }
}

/// The root of a member's tree; halves the path on the way.
pub fn root(parent: &mut [u32], mut face: u32) -> u32 {
    loop {
        let up = parent[face as usize];
        if up == face {
            return face;
        }
        let above = parent[up as usize];
        parent[face as usize] = above;
        face = above;
    }
}

impl Components {
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
