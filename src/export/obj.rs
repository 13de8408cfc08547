//! Wavefront OBJ: polygons as they are, positions that read back exactly, and a group `cluster-17` a cluster.
//!
//! Faces are in the order of their clusters, and in upload order within one. Clusters of points become colours after
//! the positions, which most readers take.

use std::io::{self, Write};

use super::{Clusters, Geometry, Split, colour};

/// Writes an OBJ.
pub fn write(out: &mut dyn Write, geometry: &Geometry<'_>) -> io::Result<()> {
    match geometry.clusters {
        Clusters::OfFaces(labels) => {
            for point in geometry.points {
                write_point(out, point)?;
                out.write_all(b"\n")?;
            }
            let clusters = labels.iter().max().map_or(0, |&label| label as usize + 1);
            let split = Split::new(geometry, labels, clusters);
            for cluster in 0..clusters {
                if !split.faces_of(cluster).is_empty() {
                    writeln!(out, "g cluster-{cluster}")?;
                }
                for &face in split.faces_of(cluster) {
                    write_face(out, geometry.faces.corners(face as usize))?;
                }
            }
        }
        Clusters::OfPoints(clusters) => {
            for (point, &cluster) in geometry.points.iter().zip(clusters) {
                write_point(out, point)?;
                for channel in colour::of_cluster(cluster) {
                    write!(out, " {}", f32::from(channel) / 255.0)?;
                }
                out.write_all(b"\n")?;
            }
            for face in 0..geometry.faces.len() {
                write_face(out, geometry.faces.corners(face))?;
            }
        }
    }
    Ok(())
}

/// Writes one mesh without groups: points, and faces whose corners are indices of them.
pub(super) fn write_plain(
    out: &mut dyn Write,
    points: impl Iterator<Item = [f64; 3]>,
    faces: impl Iterator<Item = impl AsRef<[u32]>>,
) -> io::Result<()> {
    for point in points {
        write_point(out, &point)?;
        out.write_all(b"\n")?;
    }
    for corners in faces {
        write_face(out, corners.as_ref())?;
    }
    Ok(())
}

fn write_point(out: &mut dyn Write, [x, y, z]: &[f64; 3]) -> io::Result<()> {
    write!(out, "v {x} {y} {z}")
}

fn write_face(out: &mut dyn Write, corners: &[u32]) -> io::Result<()> {
    out.write_all(b"f")?;
    for &corner in corners {
        write!(out, " {}", u64::from(corner) + 1)?;
    }
    out.write_all(b"\n")
}
