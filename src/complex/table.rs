//! The cluster table: size, place and shape of each cluster.

use glam::DVec3;
use serde::Serialize;
use utoipa::ToSchema;

use super::surface::CutSurface;
use crate::energy::{Energy, Functional};
use crate::mesh::PolygonMesh;
use crate::union_find;

/// A row of the cluster table. Lengths, areas and positions in source units; a number that f64 cannot hold is null in
/// JSON.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Cluster {
    /// The number of the cluster.
    pub cluster: u32,
    /// Number of faces.
    pub faces: u64,
    /// Area of its faces, polygons in fans.
    pub area: f64,
    /// Length of the curves around it.
    pub perimeter: f64,
    /// Mean of its faces' centroids, weighted by area. Null without faces.
    pub centroid: Option<[f64; 3]>,
    /// Unit vector along the sum of its faces' normals, weighted by area. Null if that sum is 0.
    pub normal: Option<[f64; 3]>,
    /// The cosine of the largest angle between `normal` and the normal of one of its triangles.
    pub normal_cone: Option<f64>,
    /// Lowest and highest coordinates of its corners. Null without faces.
    pub bbox: Option<[[f64; 3]; 2]>,
    /// 4π·area/perimeter²: 1 of a flat circle. Null without a perimeter.
    pub roundness: Option<f64>,
    /// Length of the sum of its faces' normals, weighted by area, over its area: 1 if it is flat, 0 if it is closed.
    /// Null without an area.
    pub planarity: Option<f64>,
    /// Its Euler number without its border: 1 of a disk, 0 of a ring.
    pub euler: i64,
    /// Number of clusters that a curve separates from it.
    pub neighbours: u64,
    /// Number of the component that its first face is in, connected across shared edges. Null if all its faces are
    /// degenerate.
    pub component: Option<u32>,
    /// Whether it has a boundary, edges of more than two faces included.
    pub open: bool,
    /// Its share of the energy cvd: the sum over its faces of area × squared distance from centroid to centroid.
    pub energy: f64,
}

/// What faces of a cluster add up to, in the frame.
#[derive(Clone, Copy)]
struct Sums {
    faces: u64,
    area: f64,
    weighted: DVec3,
    plain: DVec3,
    energy: f64,
    normal: DVec3,
    cone: f64,
    low: DVec3,
    high: DVec3,
}

impl Sums {
    const ZERO: Self = Self {
        faces: 0,
        area: 0.0,
        weighted: DVec3::ZERO,
        plain: DVec3::ZERO,
        energy: 0.0,
        normal: DVec3::ZERO,
        cone: 1.0,
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
    };

    fn centroid(&self) -> DVec3 {
        if self.area > 0.0 { self.weighted / self.area } else { self.plain / self.faces as f64 }
    }
}

/// The table without what neighbours decide: perimeters, roundness, numbers of neighbours, and whether clusters are
/// open.
pub(super) fn table(mesh: &PolygonMesh, surface: &CutSurface, labels: &[u32], euler: &[i64]) -> Vec<Cluster> {
    let frame = &surface.frame;
    let mut all = vec![Sums::ZERO; euler.len()];
    let geometry = frame.faces(mesh.into(), |_| None);
    for (face, (&label, of_face)) in labels.iter().zip(&geometry).enumerate() {
        let sums = &mut all[label as usize];
        sums.faces += 1;
        sums.area += of_face.area;
        sums.weighted += of_face.area * of_face.centroid;
        sums.plain += of_face.centroid;
        for &corner in mesh.faces.corners(face) {
            let position = DVec3::from(mesh.positions[corner as usize]);
            (sums.low, sums.high) = (sums.low.min(position), sums.high.max(position));
        }
    }
    let centroids: Vec<DVec3> = all.iter().map(Sums::centroid).collect();
    let faces =
        labels.iter().zip(&geometry).map(|(&label, of_face)| (of_face.centroid.to_array(), of_face.area, label));
    Energy::source_terms(faces, all.len()).for_each(|(label, term)| all[label as usize].energy += term);
    drop(geometry);
    let triangles = 0..surface.faces.len() as u32;
    let label_of = |triangle: u32| labels[surface.faces[triangle as usize] as usize] as usize;
    let normal = |triangle: u32| {
        let [a, b, c] = surface.corners(triangle);
        (b - a).cross(c - a) / 2.0
    };
    triangles.clone().for_each(|triangle| all[label_of(triangle)].normal += normal(triangle));
    let axes: Vec<Option<DVec3>> = all.iter().map(|sums| sums.normal.try_normalize()).collect();
    for triangle in triangles.clone() {
        let label = label_of(triangle);
        if let (Some(axis), Some(normal)) = (axes[label], normal(triangle).try_normalize()) {
            all[label].cone = all[label].cone.min(axis.dot(normal));
        }
    }
    let components = components(surface);
    let mut component = vec![None; euler.len()];
    for triangle in triangles.rev() {
        component[label_of(triangle)] = Some(components[surface.halves.component[triangle as usize] as usize]);
    }
    let scaled = |value: f64, lengths: i32| libm::ldexp(value, -lengths * frame.exponent);
    let row = |(cluster, sums): (usize, &Sums)| Cluster {
        cluster: cluster as u32,
        faces: sums.faces,
        area: scaled(sums.area, 2),
        perimeter: 0.0,
        centroid: (sums.faces > 0).then(|| frame.source_position(centroids[cluster]).to_array()),
        normal: axes[cluster].map(|axis| axis.to_array()),
        normal_cone: axes[cluster].map(|_| sums.cone),
        bbox: (sums.faces > 0).then(|| [sums.low.to_array(), sums.high.to_array()]),
        roundness: None,
        planarity: (sums.area > 0.0).then(|| (sums.normal.length() / sums.area).min(1.0)),
        euler: euler[cluster],
        neighbours: 0,
        component: component[cluster],
        open: false,
        energy: scaled(sums.energy, 4),
    };
    all.iter().enumerate().map(row).collect()
}

/// For each component of the cut surface that of the mesh across shared edges, cut ones included.
fn components(surface: &CutSurface) -> Vec<u32> {
    let of = |triangle: u32| surface.halves.component[triangle as usize];
    let mut parent = union_find::singletons(surface.halves.components as usize);
    for &[one, other] in &surface.halves.across_crowded {
        union_find::join(&mut parent, of(one), of(other));
    }
    // triangles of one face, between which there may have been one with two equal corners
    for (triangle, faces) in (0..).zip(surface.faces.windows(2)) {
        if faces[0] == faces[1] && of(triangle) != of(triangle + 1) {
            union_find::join(&mut parent, of(triangle), of(triangle + 1));
        }
    }
    union_find::numbered(parent).0
}
