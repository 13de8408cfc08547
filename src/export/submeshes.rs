//! A mesh a cluster: nodes of a GLB, files of an archive, and index buffers.
//!
//! Index buffers (`.npz`) hold for cluster c, between `*_offsets[c]` and `*_offsets[c + 1]`:
//!
//! | array | what |
//! |---|---|
//! | `vertices` | u32, vertices of the upload |
//! | `triangles` | rows of three, indices among the vertices of the cluster; u16, or u32 where a cluster has more |
//! | `spheres` | f64, one row a cluster: centre and radius of a sphere around it |
//! | `cones` | f64, one row a cluster: mean normal, and the least cosine between it and the normal of a triangle |
//!
//! The axis of a cone is zero, and its cosine −1, where the normals of a cluster add up to nothing.

use std::io::{self, Write};

use glam::DVec3;

use super::archive::Archive;
use super::npz::{self, Array};
use super::{Geometry, Split, fan, glb, obj, ply, single, stl};
use crate::error::{Error, Result};

/// Nodes of a GLB that readers load within seconds.
pub const MOST_NODES: usize = 2000;

/// The format of the files of an archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Member {
    /// Binary PLY.
    Ply,
    /// Binary STL.
    Stl,
    /// OBJ.
    Obj,
}

/// A GLB with a node a cluster; more than [`MOST_NODES`] only if it is forced.
///
/// # Errors
/// There are too many clusters, and as those of [`glb::nodes`].
pub fn nodes(geometry: &Geometry<'_>, split: &Split, is_forced: bool) -> Result<Vec<u8>> {
    if split.clusters() > MOST_NODES && !is_forced {
        return Err(Error::conflict(format_args!(
            "readers of GLB take long to load more nodes than {MOST_NODES}: take zip, or force it; clusters: {}",
            split.clusters()
        )));
    }
    glb::nodes(geometry, split)
}

/// Checks a geometry, and gives what writes an archive with a file `cluster-00017.ply` for every cluster with faces.
///
/// # Errors
/// STL: positions are beyond single precision.
pub fn archive<'a>(
    geometry: Geometry<'a>,
    split: Split,
    member: Member,
) -> Result<impl FnOnce(&mut dyn Write) -> io::Result<()> + 'a> {
    let near = match member {
        Member::Stl => single(geometry.points.iter().copied(), [0.0; 3], "STL")?,
        Member::Ply | Member::Obj => Vec::new(),
    };
    Ok(move |out: &mut dyn Write| {
        let mut archive = Archive::new(out);
        let mut bytes = Vec::new();
        for cluster in 0..split.clusters() {
            let (faces, vertices) = (split.faces_of(cluster), split.vertices(cluster));
            if faces.is_empty() {
                continue;
            }
            let points = || split.points[vertices.clone()].iter().map(|&point| geometry.points[point as usize]);
            let local = faces.iter().map(|&face| {
                let corners = &split.corners[geometry.faces.corner_range(face as usize)];
                corners.iter().map(|vertex| vertex - vertices.start as u32).collect::<Vec<u32>>()
            });
            bytes.clear();
            let extension = match member {
                Member::Ply => {
                    ply::write_plain(&mut bytes, &points().collect::<Vec<_>>(), &local.collect::<Vec<_>>())?;
                    "ply"
                }
                Member::Obj => {
                    obj::write_plain(&mut bytes, points(), local)?;
                    "obj"
                }
                Member::Stl => {
                    let of = faces.iter().flat_map(|&face| fan(geometry.faces.corners(face as usize)));
                    let triangles: Vec<[[f32; 3]; 3]> =
                        of.map(|triangle| triangle.map(|corner| near[corner as usize])).collect();
                    stl::write(&mut bytes, triangles.len() as u32, triangles.into_iter())?;
                    "stl"
                }
            };
            archive.add(&format!("cluster-{cluster:05}.{extension}"), &bytes)?;
        }
        archive.finish()
    })
}

/// Writes the index buffers.
pub fn write_buffers(out: &mut dyn Write, geometry: &Geometry<'_>, split: &Split) -> io::Result<()> {
    let clusters = split.clusters();
    let (mut triangles, mut offsets) = (Vec::new(), vec![0u32]);
    let (mut spheres, mut cones) = (Vec::with_capacity(4 * clusters), Vec::with_capacity(4 * clusters));
    for cluster in 0..clusters {
        let start = split.vertices(cluster).start as u32;
        let mut normals = Vec::new();
        for &face in split.faces_of(cluster) {
            let range = geometry.faces.corner_range(face as usize);
            triangles.extend(fan(&split.corners[range.clone()]).flatten().map(|vertex| vertex - start));
            normals.extend(fan(&geometry.faces.all_corners()[range]).map(|corners| area_vector(geometry, corners)));
        }
        offsets.push((triangles.len() / 3) as u32);
        let points = split.points[split.vertices(cluster)].iter().map(|&p| DVec3::from(geometry.points[p as usize]));
        let (centre, radius) = sphere(points);
        spheres.extend(centre.to_array().into_iter().chain([radius]));
        let (axis, cosine) = cone(&normals);
        cones.extend(axis.to_array().into_iter().chain([cosine]));
    }
    let vertex_offsets: Vec<u32> =
        (0..clusters).map(|cluster| split.vertices(cluster).start as u32).chain([split.points.len() as u32]).collect();
    let widest = (0..clusters).map(|cluster| split.vertices(cluster).len()).max().unwrap_or_default();
    let rows = triangles.len() / 3;
    let triangles = match u16::try_from(widest) {
        Ok(_) => Array::u16(&[rows, 3], &triangles.iter().map(|&vertex| vertex as u16).collect::<Vec<_>>()),
        Err(_) => Array::u32(&[rows, 3], &triangles),
    };
    npz::write(
        out,
        &[
            ("vertices", Array::u32(&[split.points.len()], &split.points)),
            ("vertex_offsets", Array::u32(&[clusters + 1], &vertex_offsets)),
            ("triangles", triangles),
            ("triangle_offsets", Array::u32(&[clusters + 1], &offsets)),
            ("spheres", Array::f64(&[clusters, 4], &spheres)),
            ("cones", Array::f64(&[clusters, 4], &cones)),
        ],
    )
}

/// The normal of a triangle, as long as twice its area.
fn area_vector(geometry: &Geometry<'_>, corners: [u32; 3]) -> DVec3 {
    let [a, b, c] = corners.map(|corner| DVec3::from(geometry.points[corner as usize]));
    (b - a).cross(c - a)
}

/// A sphere around points, with the centre of their bounding box.
fn sphere(points: impl Iterator<Item = DVec3> + Clone) -> (DVec3, f64) {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for point in points.clone() {
        (low, high) = (low.min(point), high.max(point));
    }
    if low.x > high.x {
        return (DVec3::ZERO, 0.0);
    }
    let centre = low / 2.0 + high / 2.0;
    let farthest = points.map(|point| (point - centre).length_squared()).fold(0.0, f64::max);
    (centre, farthest.sqrt())
}

/// The mean of area vectors, of length 1, and the least cosine between it and one of them.
fn cone(normals: &[DVec3]) -> (DVec3, f64) {
    let unit = |vector: DVec3| Some(vector / vector.length()).filter(|unit| unit.is_finite());
    let sum = normals.iter().fold(DVec3::ZERO, |sum, &normal| sum + normal);
    let Some(axis) = unit(sum) else { return (DVec3::ZERO, -1.0) };
    let cosines = normals.iter().filter_map(|&normal| unit(normal)).map(|normal| normal.dot(axis));
    (axis, cosines.fold(1.0, f64::min).max(-1.0))
}
