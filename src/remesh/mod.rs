//! A triangle mesh with a vertex a cluster: the dual of labels, a manifold whatever the labels are.
//!
//! # Definition
//!
//! S is the mesh as a [cut surface](crate::complex). Clusters are divided into `cells` that are disks; the complex of
//! cells, arcs and junctions has a `dual`, whose files say why it exists. It has no edge of more than two triangles, no
//! vertex of several umbrellas and no triangle twice, is oriented alike, and has the components, the boundary circles
//! and the Euler number of S. `check` sees to that before a remesh is given out. It may intersect itself, and has more
//! vertices than clusters where the topology needs them.
//!
//! | placement | the vertex of a cell |
//! |---|---|
//! | `centroid` | the area-weighted mean of its triangles |
//! | `surface` | the point of its own triangles nearest to that |
//! | `fit` | the least squared distance to its triangles' planes (`quadric`), then to the whole surface (`fit`) |
//!
//! With `fit`, a vertex goes back toward `surface` where a triangle lies against its cells' normals. Vertices on the
//! boundary stay on the polyline of the input and slide along it (`slide`). Points of arcs between
//! cells begin on their arc; `fit` moves them.
//!
//! Every vertex has a source, the point of the upload that it stands for ([`VertexSource`]). Labels are not affected by
//! anything here. Positions come from + − × ÷ √ of f64 in a fixed order, so they are the same on every machine and for
//! any number of threads.

mod cells;
mod check;
mod closest;
mod dual;
mod fit;
mod geometry;
mod place;
mod points;
mod polygon;
mod quadric;
mod slide;

use glam::DVec3;
use serde::Serialize;
use utoipa::ToSchema;

use crate::complex::{Complex, CutSurface, check_labels};
use crate::error::Result;
use crate::mesh::PolygonMesh;
use crate::parallel;
use crate::surface::Rows;
use cells::Cells;
use dual::{Dual, dual};
use fit::Fit;
use geometry::Geometry;
use place::{Cloth, OnSurface};
use points::Spot;

pub use place::Placement;

/// A triangle mesh with a vertex a cluster.
#[derive(Debug, Clone, PartialEq)]
pub struct Remesh {
    /// Positions in source units. Point i is that of cluster i for all clusters, then come those of split-off parts of
    /// clusters, of the boundary, and of curves between clusters. No triangle uses the point of a cluster without faces
    /// or with degenerate faces only.
    pub points: Vec<DVec3>,
    /// Numbers of points, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// What each point stands for.
    pub sources: Vec<VertexSource>,
    /// What is said about it in a report.
    pub summary: Summary,
}

/// The point of the upload that a vertex of a remesh stands for. An attribute of the upload's vertices is there
/// Σ `barycentric[j]` · attribute[`vertices[j]`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VertexSource {
    /// What the vertex is.
    pub kind: VertexKind,
    /// Its cluster; between two, the lower one.
    pub cluster: u32,
    /// The face of the upload.
    pub face: u32,
    /// Three vertices of the upload, corners of that face.
    pub vertices: [u32; 3],
    /// How much of each of them: numbers from 0 to 1 that add up to 1.
    pub barycentric: [f64; 3],
}

/// What a vertex of a remesh is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum VertexKind {
    /// The vertex of a cluster.
    Cluster = 0,
    /// The vertex of a part of a cluster that is in several pieces or no disk.
    Split = 1,
    /// A vertex on the boundary.
    Boundary = 2,
    /// A point of a curve between two clusters.
    Extra = 3,
}

/// What a report says about a remesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
pub struct Summary {
    /// Where the vertices of clusters stand.
    pub placement: Placement,
    /// Numbers of vertices.
    pub vertices: VertexCounts,
    /// Number of triangles.
    pub triangles: u64,
    /// Vertices that triangles use − edges + triangles.
    pub euler: i64,
    /// Circles that the boundary consists of.
    pub loops: u64,
    /// Components.
    pub components: u64,
    /// Edges of the upload that were cut: of more than two faces, or along which the surface cannot be oriented.
    pub cut_edges: u64,
    /// Triangles that lie against the mean normals of their clusters.
    pub flipped: u64,
    /// Whether it was checked to be a manifold, oriented alike, with the Euler number, boundary circles and
    /// components of the cut surface. One that is not is refused.
    pub checked: bool,
}

/// Numbers of vertices by kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
pub struct VertexCounts {
    /// Of clusters.
    pub clusters: u64,
    /// Of parts of clusters that are in several pieces or no disks.
    pub split: u64,
    /// On the boundary.
    pub boundary: u64,
    /// On curves between clusters.
    pub extra: u64,
}

/// Makes the remesh of labels, one a face, each below `clusters`.
///
/// # Errors
/// Labels do not fit the mesh ([`check_labels`]), or the mesh is too large to number.
pub fn remesh(mesh: &PolygonMesh, labels: &[u32], clusters: u64, placement: Placement) -> Result<Remesh> {
    check_labels(mesh, labels, clusters)?;
    let of_clusters = Rows::grouped(labels, clusters as usize);
    let surface = CutSurface::in_order(mesh, of_clusters.items.iter().copied())?;
    drop(of_clusters);
    let halves = &surface.halves;
    let (geometry, mut cells) =
        rayon::join(|| Geometry::new(&surface), || Cells::pieces(halves, surface.labels(labels), clusters as usize));
    let crossing = cells.divide_into_disks(halves, &geometry);
    let triangles_of_cells = Rows::grouped(&cells.of_triangle, cells.clusters.len());
    let cloth = Cloth { surface: &surface, geometry: &geometry, triangles_of_cells: &triangles_of_cells };
    let complex = Complex::new(halves, &cells.of_triangle, &crossing);

    let mut positions = cloth.positions(placement);
    let Dual { triangles, mut spots, on_boundary } = dual(&surface, &complex, &positions);
    slide::slide(&surface, &mut spots[..on_boundary]);
    positions.extend(spots.iter().map(|spot| spot.position(&surface)));
    let flipped = match placement {
        Placement::Fit => {
            let fixed = cells.clusters.len()..cells.clusters.len() + on_boundary;
            let is_free: Vec<bool> = (0..positions.len()).map(|vertex| !fixed.contains(&vertex)).collect();
            let fit = Fit {
                geometry: &geometry,
                triangles_of_cells: &triangles_of_cells,
                triangles: &triangles,
                is_free: &is_free,
            };
            fit.run(&mut positions);
            cloth.turn_back(&triangles, &mut positions, Some(&is_free))
        }
        Placement::Surface | Placement::Centroid => cloth.turn_back(&triangles, &mut positions, None),
    };
    let topology = halves.topology();
    check::check(&triangles, positions.len(), topology)?;

    let made = Made { mesh, labels, clusters, cells: &cells, cloth: &cloth, spots: &spots, on_boundary };
    let sources = made.sources(&positions);
    let points = parallel::map(sources.len(), 1, |at| made.point(&sources[at], positions[at]));
    let count = |kind: VertexKind| sources.iter().filter(|source| source.kind == kind).count() as u64;
    let summary = Summary {
        placement,
        vertices: VertexCounts {
            clusters,
            split: count(VertexKind::Split),
            boundary: count(VertexKind::Boundary),
            extra: count(VertexKind::Extra),
        },
        triangles: triangles.len() as u64,
        euler: topology.euler,
        loops: topology.loops,
        components: topology.components,
        cut_edges: halves.cut_edges,
        flipped,
        checked: true,
    };
    Ok(Remesh { points, triangles, sources, summary })
}

/// What sources are made from.
struct Made<'a> {
    mesh: &'a PolygonMesh,
    labels: &'a [u32],
    clusters: u64,
    cells: &'a Cells,
    cloth: &'a Cloth<'a>,
    spots: &'a [Spot],
    on_boundary: usize,
}

impl Made<'_> {
    /// What every vertex stands for.
    fn sources(&self, positions: &[DVec3]) -> Vec<VertexSource> {
        let cells = self.cells.clusters.len();
        let mut first_faces = vec![0u32; self.clusters as usize];
        for (face, &label) in self.labels.iter().enumerate().rev() {
            first_faces[label as usize] = face as u32;
        }
        let source = |vertex: usize| {
            if vertex < cells {
                let is_cluster = (vertex as u64) < self.clusters;
                let kind = if is_cluster { VertexKind::Cluster } else { VertexKind::Split };
                return match self.cloth.nearest(vertex, positions[vertex]) {
                    Some(place) => self.source(kind, place),
                    None => self.without_triangles(vertex as u32, first_faces[vertex]),
                };
            }
            let spot = self.spots[vertex - cells];
            let triangle = spot.half / 3;
            if vertex - cells >= self.on_boundary {
                let cell = self.cells.of_triangle[triangle as usize] as usize;
                if let Some(place) = self.cloth.nearest(cell, positions[vertex]) {
                    return self.source(VertexKind::Extra, place);
                }
            }
            let mut weights = [0.0; 3];
            weights[spot.half as usize % 3] = 1.0 - spot.along;
            weights[(spot.half as usize + 1) % 3] = spot.along;
            self.source(VertexKind::Boundary, (triangle, weights))
        };
        parallel::map(positions.len(), 1, source)
    }

    fn source(&self, kind: VertexKind, (triangle, barycentric): OnSurface) -> VertexSource {
        let cell = self.cells.of_triangle[triangle as usize];
        VertexSource {
            kind,
            cluster: self.cells.clusters[cell as usize],
            face: self.cloth.surface.faces[triangle as usize],
            vertices: self.cloth.surface.upload_vertices(self.mesh, triangle),
            barycentric,
        }
    }

    /// Of a cluster without triangles: the first corner of its first face; without faces, of the mesh.
    fn without_triangles(&self, cluster: u32, face: u32) -> VertexSource {
        let vertices = [self.mesh.faces.corners(face as usize)[0]; 3];
        VertexSource { kind: VertexKind::Cluster, cluster, face, vertices, barycentric: [1.0, 0.0, 0.0] }
    }

    /// The position of a vertex in source units: exactly that of a vertex of the upload where it stands on one.
    fn point(&self, source: &VertexSource, position: DVec3) -> DVec3 {
        let is_off_surface = source.kind != VertexKind::Boundary && source.vertices[0] != source.vertices[1];
        match source.barycentric.iter().position(|&weight| weight == 1.0) {
            Some(corner) if !is_off_surface => self.mesh.positions[source.vertices[corner] as usize].into(),
            _ => self.cloth.surface.frame.source_position(position),
        }
    }
}
