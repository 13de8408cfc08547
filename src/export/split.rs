//! A mesh cut apart where clusters meet: a vertex a point and cluster that has a corner there.
//!
//! Vertices are numbered cluster by cluster, in the order in which the corners of its faces use them; so a cluster is a
//! range of vertices and a range of faces, and a mesh of its own.

use std::ops::Range;

use super::Geometry;
use crate::mesh::Faces;
use crate::surface::Rows;

/// A mesh cut apart along the boundaries of its clusters.
#[derive(Debug)]
pub struct Split {
    /// The faces, cluster by cluster, in upload order within one.
    pub faces: Vec<u32>,
    /// Where the faces of each cluster begin, and the end.
    face_starts: Vec<u32>,
    /// The point of each vertex.
    pub points: Vec<u32>,
    /// Where the vertices of each cluster begin, and the end.
    vertex_starts: Vec<u32>,
    /// The vertex of every corner, in the order of [`Faces::all_corners`](crate::mesh::Faces::all_corners).
    pub corners: Vec<u32>,
}

impl Split {
    /// Cuts a mesh of `clusters` clusters apart; `labels` has one a face, each below `clusters`.
    pub fn new(geometry: &Geometry<'_>, labels: &[u32], clusters: usize) -> Self {
        let mesh = geometry.faces;
        let Rows { offsets: face_starts, items: faces } = Rows::grouped(labels, clusters);

        // the last vertex made of a point; one of an earlier cluster is below the start of this one
        const NONE: u32 = u32::MAX;
        let mut vertex_of_point = vec![NONE; geometry.points.len()];
        let mut points = Vec::with_capacity(geometry.points.len());
        let mut corners = vec![0u32; mesh.all_corners().len()];
        let mut vertex_starts = Vec::with_capacity(clusters + 1);
        for cluster in 0..clusters {
            let start = points.len() as u32;
            vertex_starts.push(start);
            for &face in &faces[face_starts[cluster] as usize..face_starts[cluster + 1] as usize] {
                for corner in mesh.corner_range(face as usize) {
                    let point = mesh.all_corners()[corner];
                    let vertex = &mut vertex_of_point[point as usize];
                    if *vertex == NONE || *vertex < start {
                        *vertex = points.len() as u32;
                        points.push(point);
                    }
                    corners[corner] = *vertex;
                }
            }
        }
        vertex_starts.push(points.len() as u32);
        Self { faces, face_starts, points, vertex_starts, corners }
    }

    /// Number of clusters.
    pub fn clusters(&self) -> usize {
        self.vertex_starts.len() - 1
    }

    /// The position of each vertex.
    pub fn positions(&self, geometry: &Geometry<'_>) -> Vec<[f64; 3]> {
        self.points.iter().map(|&point| geometry.points[point as usize]).collect()
    }

    /// The cluster of each vertex.
    pub fn cluster_of_vertex(&self) -> Vec<u32> {
        let of = (0..self.clusters()).flat_map(|cluster| self.vertices(cluster).map(move |_| cluster as u32));
        of.collect()
    }

    /// The faces in upload order, whose corners are vertices.
    pub fn cut_faces(&self, geometry: &Geometry<'_>) -> Faces {
        let mut faces = Faces::with_capacity(geometry.faces.len());
        (0..geometry.faces.len()).for_each(|face| faces.push(&self.corners[geometry.faces.corner_range(face)]));
        faces
    }

    /// The vertices of a cluster.
    pub fn vertices(&self, cluster: usize) -> Range<usize> {
        self.vertex_starts[cluster] as usize..self.vertex_starts[cluster + 1] as usize
    }

    /// The faces of a cluster.
    pub fn faces_of(&self, cluster: usize) -> &[u32] {
        &self.faces[self.face_starts[cluster] as usize..self.face_starts[cluster + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::Clusters;

    #[test]
    fn vertices_are_split_where_clusters_meet_and_nowhere_else() {
        let mut faces = Faces::default();
        for corners in [&[0, 1, 2][..], &[2, 1, 3], &[3, 1, 4, 5]] {
            faces.push(corners);
        }
        let points: Vec<[f64; 3]> = (0..7).map(|x| [f64::from(x), 0.0, 0.0]).collect();
        let labels = [1, 0, 1];
        let geometry = Geometry { points: &points, faces: &faces, clusters: Clusters::OfFaces(&labels) };
        let split = Split::new(&geometry, &labels, 3);
        assert_eq!(split.points, [2, 1, 3, 0, 1, 2, 3, 4, 5]);
        assert_eq!(split.corners, [3, 4, 5, 0, 1, 2, 6, 4, 7, 8]);
        assert_eq!((split.faces_of(0), split.faces_of(1)), (&[1][..], &[0, 2][..]));
        assert_eq!((split.vertices(0), split.vertices(1), split.vertices(2)), (0..3, 3..9, 9..9));
        assert_eq!(split.clusters(), 3);
        assert_eq!(split.cluster_of_vertex(), [0, 0, 0, 1, 1, 1, 1, 1, 1]);
        let cut = split.cut_faces(&geometry);
        assert_eq!((cut.len(), cut.corners(1), cut.corners(2)), (3, &[0, 1, 2][..], &[6, 4, 7, 8][..]));
        assert_eq!(split.positions(&geometry)[3], [0.0; 3]);
    }
}
