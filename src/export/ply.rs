//! PLY, binary and little-endian: polygons as they are, with a colour and the cluster of each face or point.
//!
//! Positions are `float` where single precision holds all of them exactly, else `double`.

use std::io::{self, Write};

use super::{Clusters, Geometry, are_single, colour};

/// Writes a PLY.
pub fn write(out: &mut dyn Write, geometry: &Geometry<'_>) -> io::Result<()> {
    const CLUSTER: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty int cluster\n";
    let Geometry { points, faces, clusters } = *geometry;
    let (of_points, of_faces) = match clusters {
        Clusters::OfPoints(clusters) => (Some(clusters), None),
        Clusters::OfFaces(clusters) => (None, Some(clusters)),
    };
    let (is_single, longest) = (are_single(points), longest(geometry));
    write_header(
        out,
        points.len(),
        of_points.map_or("", |_| CLUSTER),
        faces.len(),
        of_faces.map_or("", |_| CLUSTER),
        [if is_single { "float" } else { "double" }, count_type(longest)],
    )?;
    let mut bytes = Vec::new();
    for (number, point) in points.iter().enumerate() {
        bytes.clear();
        put_point(&mut bytes, *point, is_single);
        put_cluster(&mut bytes, of_points.map(|clusters| clusters[number]));
        out.write_all(&bytes)?;
    }
    for face in 0..faces.len() {
        bytes.clear();
        put_face(&mut bytes, faces.corners(face), longest);
        put_cluster(&mut bytes, of_faces.map(|clusters| clusters[face]));
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Writes one mesh without clusters: points, and faces whose corners are indices of them.
pub(super) fn write_plain(out: &mut dyn Write, points: &[[f64; 3]], faces: &[impl AsRef<[u32]>]) -> io::Result<()> {
    let is_single = are_single(points);
    let longest = faces.iter().map(|corners| corners.as_ref().len()).max().unwrap_or_default();
    let types = [if is_single { "float" } else { "double" }, count_type(longest)];
    write_header(out, points.len(), "", faces.len(), "", types)?;
    let mut bytes = Vec::new();
    points.iter().for_each(|point| put_point(&mut bytes, *point, is_single));
    faces.iter().for_each(|corners| put_face(&mut bytes, corners.as_ref(), longest));
    out.write_all(&bytes)
}

fn write_header(
    out: &mut dyn Write,
    points: usize,
    of_points: &str,
    faces: usize,
    of_faces: &str,
    [position, count]: [&str; 2],
) -> io::Result<()> {
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment written by tesserae\nelement vertex {points}\n\
         property {position} x\nproperty {position} y\nproperty {position} z\n{of_points}element face {faces}\n\
         property list {count} int vertex_indices\n{of_faces}end_header\n"
    )
}

/// The type of the number of corners: `uchar`, which every reader knows, while that holds all of them.
fn count_type(longest: usize) -> &'static str {
    if longest <= usize::from(u8::MAX) { "uchar" } else { "uint" }
}

/// Most corners of a face.
fn longest(geometry: &Geometry<'_>) -> usize {
    match geometry.faces.are_triangles() {
        true => 3,
        false => (0..geometry.faces.len()).map(|face| geometry.faces.corners(face).len()).max().unwrap_or_default(),
    }
}

fn put_point(bytes: &mut Vec<u8>, point: [f64; 3], is_single: bool) {
    for x in point {
        match is_single {
            true => bytes.extend((x as f32).to_le_bytes()),
            false => bytes.extend(x.to_le_bytes()),
        }
    }
}

fn put_face(bytes: &mut Vec<u8>, corners: &[u32], longest: usize) {
    match count_type(longest) {
        "uchar" => bytes.push(corners.len() as u8),
        _ => bytes.extend((corners.len() as u32).to_le_bytes()),
    }
    bytes.extend(corners.iter().flat_map(|corner| corner.to_le_bytes()));
}

fn put_cluster(bytes: &mut Vec<u8>, cluster: Option<u32>) {
    if let Some(cluster) = cluster {
        bytes.extend(colour::of_cluster(cluster));
        bytes.extend(cluster.to_le_bytes());
    }
}
