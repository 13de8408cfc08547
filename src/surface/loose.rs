//! Loose faces: faces without area that shared edges connect with no face that has area. They are no items of the
//! clustering, and each has the label of its *host*: the first face at one of its vertices, else the face with the
//! nearest centroid among those beside it along the curve ([`NEAR`]).
//!
//! They have no extent, and as components they would take clusters of their own. Where a mesh has no other faces, none
//! is loose.

use glam::DVec3;

use super::components::Components;
use super::weld::Weld;
use crate::mesh::{Frame, MeshView};

/// A face that takes no cluster. Both are numbers of the upload.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loose {
    /// The face without area.
    pub face: u32,
    /// The face whose label it has, which is not loose.
    pub host: u32,
}

/// Faces on each side along the curve whose centroids are compared, where no face is at a vertex. A bound, so that the
/// work is in proportion to the faces.
const NEAR: usize = 32;

/// No face, at a position where a host is wanted.
const WANTED: u32 = u32::MAX;
/// No host is wanted at a position.
const UNWANTED: u32 = u32::MAX - 1;

/// The loose faces, ascending. `along_curve` has all faces, those that are close in space close to each other.
pub fn find(
    mesh: MeshView<'_>,
    frame: &Frame,
    weld: &Weld,
    components: &Components,
    along_curve: &[u32],
) -> Vec<Loose> {
    let mut loose = of_components_without_area(mesh, frame, components);
    if loose.is_empty() || loose.len() == mesh.faces.len() {
        return Vec::new();
    }
    let mut is_loose = vec![false; mesh.faces.len()];
    loose.iter().for_each(|&Loose { face, .. }| is_loose[face as usize] = true);
    at_vertices(&mut loose, &is_loose, mesh, weld);
    if loose.iter().any(|loose| loose.host == WANTED) {
        nearest(&mut loose, &is_loose, mesh, frame, along_curve);
    }
    loose
}

/// The faces of components without area; their hosts are not known.
fn of_components_without_area(mesh: MeshView<'_>, frame: &Frame, components: &Components) -> Vec<Loose> {
    if components.count == 1 {
        return Vec::new();
    }
    let mut has_area = vec![false; components.count];
    for (face, &component) in components.of_face.iter().enumerate() {
        let has_area = &mut has_area[component as usize];
        *has_area = *has_area || frame.face(mesh, face).0.area > 0.0;
    }
    let faces = (0..).zip(&components.of_face).filter(|(_, component)| !has_area[**component as usize]);
    faces.map(|(face, _)| Loose { face, host: WANTED }).collect()
}

/// Gives loose faces the first face at one of their vertices.
fn at_vertices(loose: &mut [Loose], is_loose: &[bool], mesh: MeshView<'_>, weld: &Weld) {
    let positions = |face: u32| {
        let corners = mesh.faces.corners(face as usize);
        corners.iter().map(|&vertex| weld.position_of_vertex[vertex as usize] as usize)
    };
    let mut host_at = vec![UNWANTED; weld.vertices as usize];
    for loose in loose.iter() {
        positions(loose.face).for_each(|position| host_at[position] = WANTED);
    }
    for face in (0..is_loose.len() as u32).filter(|&face| !is_loose[face as usize]) {
        for position in positions(face) {
            let host = &mut host_at[position];
            *host = if *host == WANTED { face } else { *host };
        }
    }
    for loose in loose {
        let hosts = positions(loose.face).map(|position| host_at[position]);
        loose.host = hosts.min().unwrap_or(WANTED);
    }
}

/// Gives loose faces without a host the face with the nearest centroid, the first of equally near ones, among the
/// [`NEAR`] faces before and after them along the curve.
fn nearest(loose: &mut [Loose], is_loose: &[bool], mesh: MeshView<'_>, frame: &Frame, along_curve: &[u32]) {
    let centroid = |face: u32| frame.face(mesh, face as usize).0.centroid;
    let others = along_curve.iter().filter(|&&face| !is_loose[face as usize]);
    let others: Vec<(u32, DVec3)> = others.map(|&face| (face, centroid(face))).collect();
    let mut passed = 0usize;
    for &face in along_curve {
        if !is_loose[face as usize] {
            passed += 1;
            continue;
        }
        let Ok(at) = loose.binary_search_by_key(&face, |loose| loose.face) else { continue };
        if loose[at].host != WANTED {
            continue;
        }
        let near = &others[passed.saturating_sub(NEAR)..others.len().min(passed + NEAR)];
        let own = centroid(face);
        let distances = near.iter().map(|&(other, place)| (place.distance_squared(own), other));
        let first = distances.min_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
        loose[at].host = first.map_or(WANTED, |(_, other)| other);
    }
}
