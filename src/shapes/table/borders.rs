//! Borders between clusters: how long they are, and by how much the surface bends there.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Serialize;
use utoipa::ToSchema;

use super::ClusterShape;
use crate::surface::Surface;
use crate::surface::corners::Corners;

/// A cluster beside another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Neighbour {
    /// Its label.
    pub label: u32,
    /// Length of the edges between both.
    pub length: f64,
    /// The angle, in degrees, by which the surface bends at them, the mean by length: above 0 where it is convex, below
    /// 0 where it is concave, 0 where it is flat.
    pub angle: f64,
}

/// Adds the neighbours to the rows of all clusters. Only faces at vertices of several clusters are sorted.
pub(super) fn add(surface: &Surface, corners: &Corners, labels: &[u32], rows: &mut [ClusterShape]) {
    let mut label_of_vertex = vec![None; corners.vertices()];
    let mut is_shared = vec![false; corners.vertices()];
    for (face, &label) in (0..).zip(labels) {
        for &vertex in corners.of(face) {
            let first = label_of_vertex[vertex as usize].get_or_insert(label);
            is_shared[vertex as usize] |= *first != label;
        }
    }
    // the vertices of an edge, a face at it, and whether the face runs along it from the first to the second
    let mut edges: Vec<([u32; 2], u32, bool)> = (0..corners.faces.len() as u32)
        .flat_map(|face| corners.edges_of(face).map(move |[a, b]| ([a.min(b), a.max(b)], face, a < b)))
        .filter(|&([a, b], ..)| a != b && is_shared[a as usize] && is_shared[b as usize])
        .collect();
    edges.sort_unstable();
    edges.dedup_by_key(|&mut (edge, face, _)| (edge, face));
    // length, length of those whose angle is known, and length × angle
    let mut sums: BTreeMap<(u32, u32), [f64; 3]> = BTreeMap::new();
    // faces at one edge are neighbours in the order of their numbers
    for pair in edges.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let ([a, b], faces) = (pair[0].0, [pair[0].1, pair[1].1]);
        let [one, other] = faces.map(|face| labels[face as usize]);
        if one != other {
            let length = corners.position(a).distance(corners.position(b));
            let sum = sums.entry((one.min(other), one.max(other))).or_default();
            sum[0] += length;
            if let Some(angle) = bend(surface, corners.position(a), faces, pair[0].2 == pair[1].2) {
                sum[1] += length;
                sum[2] += length * angle;
            }
        }
    }
    let scale = libm::ldexp(1.0, -surface.frame().exponent);
    for (&(one, other), &[length, known, bend]) in &sums {
        let angle = if known > 0.0 { bend / known } else { 0.0 };
        for (of, label) in [(one, other), (other, one)] {
            rows[of as usize].neighbours.push(Neighbour { label, length: length * scale, angle });
        }
    }
    rows.iter_mut().for_each(|row| row.neighbours.sort_unstable_by_key(|neighbour| neighbour.label));
}

/// The angle by which the surface bends between two faces that share a vertex, in degrees, with its sign; none of faces
/// without area. `are_alike`: the faces run along their edge in the same direction, so that one of them is turned over.
fn bend(surface: &Surface, vertex: DVec3, faces: [u32; 2], are_alike: bool) -> Option<f64> {
    let [(one_area, one, _), (other_area, other, place)] = faces.map(|face| surface.area_normal_and_place(face));
    if one_area == 0.0 || other_area == 0.0 {
        return None;
    }
    let other = if are_alike { -other } else { other };
    let angle = libm::atan2(one.cross(other).length(), one.dot(other)).to_degrees();
    // the second face lies below the first where the surface is convex
    Some(if (place - vertex).dot(one) > 0.0 { -angle } else { angle })
}
