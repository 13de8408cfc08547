//! Faces from lists of vertex indices, of PLY and OFF: polygons, and strips of triangles.

use super::Faces;

/// Corners that all faces together may have: they are counted in 32 bits.
const MOST_CORNERS: usize = u32::MAX as usize;

/// An index that ends a triangle strip: −1, in signed and in unsigned integers.
const RESTARTS: [i64; 2] = [-1, u32::MAX as i64];

/// Faces whose corners are checked to be vertices of the file.
#[derive(Debug)]
pub struct Polygons {
    /// The faces so far.
    pub faces: Faces,
    /// How many of them have fewer than three corners in the file.
    pub short: u64,
    /// Number of vertices of the file.
    vertices: u64,
}

impl Polygons {
    /// No faces yet, of a file with so many vertices; with room for so many triangles.
    pub fn new(vertices: u64, triangles: usize) -> Self {
        Self { faces: Faces::with_capacity(triangles), short: 0, vertices }
    }

    /// Appends a polygon. One of fewer than three corners keeps its place as a degenerate triangle: it repeats its last
    /// corner, or vertex 0 if it has none.
    #[inline]
    pub fn polygon(&mut self, indices: impl Iterator<Item = i64>) -> Result<(), String> {
        let first = self.faces.all_corners().len();
        for index in indices {
            let vertex = self.vertex(index)?;
            self.faces.push_corner(vertex);
        }
        let corners = self.faces.all_corners().len() - first;
        if corners < 3 {
            self.short += 1;
            let last = self.faces.all_corners()[first..].last().copied().unwrap_or_default();
            (corners..3).for_each(|_| self.faces.push_corner(last));
        }
        self.close(first)
    }

    /// Appends the triangles of a strip: every three corners in a row, every other one turned around so that all face
    /// the same side. After −1 a new strip begins.
    pub fn strip(&mut self, indices: impl Iterator<Item = i64>) -> Result<(), String> {
        let (mut before, mut length) = ([0; 2], 0u64);
        for index in indices {
            if RESTARTS.contains(&index) {
                length = 0;
                continue;
            }
            let vertex = self.vertex(index)?;
            length += 1;
            if length >= 3 {
                let [a, b] = if length % 2 == 1 { before } else { [before[1], before[0]] };
                let first = self.faces.all_corners().len();
                [a, b, vertex].into_iter().for_each(|corner| self.faces.push_corner(corner));
                self.close(first)?;
            }
            before = [before[1], vertex];
        }
        Ok(())
    }

    /// Appends the faces of a later part of the file.
    pub fn append(&mut self, later: &Polygons) -> Result<(), String> {
        check_corners(self.faces.all_corners().len() + later.faces.all_corners().len())?;
        self.faces.append(&later.faces);
        self.short += later.short;
        Ok(())
    }

    /// Whether all of these are vertices, or end a strip.
    pub fn have(&self, mut indices: impl Iterator<Item = i64>) -> bool {
        indices.all(|index| RESTARTS.contains(&index) || self.vertex(index).is_ok())
    }

    #[inline]
    fn vertex(&self, index: i64) -> Result<u32, String> {
        match u32::try_from(index) {
            Ok(vertex) if u64::from(vertex) < self.vertices => Ok(vertex),
            _ => Err(self.no_such_vertex(index)),
        }
    }

    #[cold]
    fn no_such_vertex(&self, index: i64) -> String {
        format!("there is no such vertex, the file has {}, counted from 0: {index}", self.vertices)
    }

    #[inline]
    fn close(&mut self, first: usize) -> Result<(), String> {
        self.faces.close(first);
        check_corners(self.faces.all_corners().len())
    }
}

#[inline]
fn check_corners(corners: usize) -> Result<(), String> {
    match corners <= MOST_CORNERS {
        true => Ok(()),
        false => Err(format!("the faces so far have more corners than can be numbered, {MOST_CORNERS}: {corners}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners(polygons: &Polygons) -> Vec<&[u32]> {
        (0..polygons.faces.len()).map(|face| polygons.faces.corners(face)).collect()
    }

    #[test]
    fn strips_alternate_and_restart() {
        let mut polygons = Polygons::new(6, 0);
        polygons.strip([0, 1, 2, 3, 4, -1, 5, 4, u32::MAX.into(), 3, 4, 5, 0, -1].into_iter()).expect("a strip");
        assert_eq!(corners(&polygons), [[0, 1, 2], [2, 1, 3], [2, 3, 4], [3, 4, 5], [5, 4, 0]]);
        assert!(polygons.strip([0, 1, -2].into_iter()).is_err());
        assert!(polygons.strip([0, 1, 6].into_iter()).is_err());
    }

    #[test]
    fn short_faces_keep_their_places() {
        let mut polygons = Polygons::new(6, 0);
        for indices in [&[][..], &[4], &[4, 5], &[1, 2, 3, 4]] {
            polygons.polygon(indices.iter().copied()).expect("a polygon");
        }
        assert_eq!(corners(&polygons), [&[0, 0, 0][..], &[4, 4, 4], &[4, 5, 5], &[1, 2, 3, 4]]);
        assert_eq!(polygons.short, 3);
        for index in [-1, 6, i64::MAX] {
            assert!(polygons.polygon([0, 1, index].into_iter()).is_err());
        }
    }
}
