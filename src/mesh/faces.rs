//! Polygons as flat arrays: the corners of all faces one after the other.
//!
//! A mesh of triangles only, the common case, stores no offsets.

use std::ops::Range;

/// The faces of a mesh: each is a loop of at least one corner, a corner is a vertex index.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Faces {
    corners: Vec<u32>,
    /// First corner of each face and one past the last; empty while every face is a triangle.
    offsets: Vec<u32>,
}

impl Faces {
    /// No faces, with room for `faces` triangles.
    pub fn with_capacity(faces: usize) -> Self {
        Self { corners: Vec::with_capacity(3 * faces), offsets: Vec::new() }
    }

    /// Triangles from their corners, three a face.
    ///
    /// # Panics
    /// When the number of corners is not a multiple of three.
    pub fn from_triangles(corners: Vec<u32>) -> Self {
        assert!(corners.len().is_multiple_of(3), "three corners a triangle");
        Self { corners, offsets: Vec::new() }
    }

    /// Appends one face.
    pub fn push(&mut self, corners: &[u32]) {
        let first = self.corners.len();
        self.corners.extend_from_slice(corners);
        self.close(first);
    }

    /// Appends a corner of a face that [`close`](Self::close) will end.
    #[inline]
    pub(super) fn push_corner(&mut self, corner: u32) {
        self.corners.push(corner);
    }

    /// Ends a face whose corners begin at `first`, the end of the face before it.
    #[inline]
    pub(super) fn close(&mut self, first: usize) {
        if self.offsets.is_empty() {
            if self.corners.len() - first == 3 {
                return;
            }
            self.spell_offsets(first);
        }
        self.offsets.push(self.corners.len() as u32);
    }

    /// Writes down the offsets of what has been triangles only, up to corner `end`.
    fn spell_offsets(&mut self, end: usize) {
        self.offsets = (0..=end as u32 / 3).map(|face| 3 * face).collect();
    }

    /// Appends the faces of `other`.
    pub(super) fn append(&mut self, other: &Faces) {
        let first = self.corners.len();
        if self.offsets.is_empty() && !other.offsets.is_empty() {
            self.spell_offsets(first);
        }
        self.corners.extend_from_slice(&other.corners);
        if !self.offsets.is_empty() {
            let first = first as u32;
            self.offsets.extend((0..other.len()).map(|face| first + other.corner_range(face).end as u32));
        }
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        if self.offsets.is_empty() { self.corners.len() / 3 } else { self.offsets.len() - 1 }
    }

    /// Whether every face is a triangle.
    pub fn are_triangles(&self) -> bool {
        self.offsets.is_empty()
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners of face `face`, as vertex indices.
    pub fn corners(&self, face: usize) -> &[u32] {
        &self.corners[self.corner_range(face)]
    }

    /// Where the corners of face `face` are in [`all_corners`](Self::all_corners).
    #[inline]
    pub fn corner_range(&self, face: usize) -> Range<usize> {
        match self.offsets.is_empty() {
            true => 3 * face..3 * face + 3,
            false => self.offsets[face] as usize..self.offsets[face + 1] as usize,
        }
    }

    /// All corners, face after face.
    pub fn all_corners(&self) -> &[u32] {
        &self.corners
    }

    /// All corners, to change them.
    pub(super) fn all_corners_mut(&mut self) -> &mut [u32] {
        &mut self.corners
    }

    /// The face that corner `corner` of [`all_corners`](Self::all_corners) belongs to.
    pub(super) fn face_of_corner(&self, corner: usize) -> usize {
        if self.offsets.is_empty() {
            corner / 3
        } else {
            self.offsets.partition_point(|&first| first as usize <= corner) - 1
        }
    }

    /// Number of triangles of the fans that the faces are cut into: corners − 2 each, none for fewer than three
    /// corners.
    pub fn triangles(&self) -> u64 {
        if self.offsets.is_empty() {
            self.len() as u64
        } else {
            self.offsets.windows(2).map(|w| u64::from(w[1] - w[0]).saturating_sub(2)).sum()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_after_triangles_keep_their_corners() {
        let mut faces = Faces::default();
        for corners in [&[0, 1, 2][..], &[2, 1, 3], &[4, 5, 6, 7], &[0, 1, 2]] {
            faces.push(corners);
        }
        assert_eq!(faces.len(), 4);
        assert_eq!(faces.corners(1), [2, 1, 3]);
        assert_eq!(faces.corners(2), [4, 5, 6, 7]);
        assert_eq!(faces.corners(3), [0, 1, 2]);
        assert_eq!(faces.triangles(), 5);
        let owners: Vec<usize> = (0..13).map(|corner| faces.face_of_corner(corner)).collect();
        assert_eq!(owners, [0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3]);
    }

    #[test]
    fn joined_faces_are_those_pushed_one_by_one() {
        let lists: [&[&[u32]]; 4] = [&[], &[&[0, 1, 2], &[2, 1, 3]], &[&[4, 5, 6, 7]], &[&[1, 2, 3, 4, 5], &[0, 1, 2]]];
        for first in lists {
            for second in lists {
                let (mut one, mut two, mut both) = (Faces::default(), Faces::default(), Faces::default());
                first.iter().for_each(|corners| one.push(corners));
                second.iter().for_each(|corners| two.push(corners));
                first.iter().chain(second).for_each(|corners| both.push(corners));
                one.append(&two);
                assert_eq!(one, both);
            }
        }
    }
}
