//! Binary STL: triangles with their normals, single precision.

use std::io::{self, Write};

use glam::DVec3;

use super::{Geometry, fan, single};
use crate::error::{Error, Result};

/// Bytes of a triangle.
const TRIANGLE: usize = 50;

/// What the 80 bytes of the header begin with; not `solid`, by which readers tell text.
const HEADER: &[u8] = b"binary STL, written by tesserae";

/// Checks a geometry, and gives what writes it.
///
/// # Errors
/// Positions are beyond single precision, or there are more triangles than the format can count.
pub fn encode<'a>(geometry: Geometry<'a>) -> Result<impl FnOnce(&mut dyn Write) -> io::Result<()> + 'a> {
    let points = single(geometry.points.iter().copied(), [0.0; 3], "STL")?;
    let triangles = u32::try_from(geometry.faces.triangles()).map_err(|_| {
        Error::too_large(format_args!("STL counts triangles in 32 bits: {}", geometry.faces.triangles()))
    })?;
    Ok(move |out: &mut dyn Write| {
        let of = (0..geometry.faces.len()).flat_map(|face| fan(geometry.faces.corners(face)));
        write(out, triangles, of.map(|triangle| triangle.map(|corner| points[corner as usize])))
    })
}

/// Writes triangles.
pub(super) fn write(out: &mut dyn Write, count: u32, triangles: impl Iterator<Item = [[f32; 3]; 3]>) -> io::Result<()> {
    let mut header = [0u8; 80];
    header[..HEADER.len()].copy_from_slice(HEADER);
    out.write_all(&header)?;
    out.write_all(&count.to_le_bytes())?;
    let mut bytes = Vec::with_capacity(TRIANGLE);
    for corners in triangles {
        bytes.clear();
        let normal = normal(corners);
        for x in [normal].iter().chain(&corners).flatten() {
            bytes.extend(x.to_le_bytes());
        }
        bytes.extend([0, 0]);
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// The unit normal of a triangle; zero where it has no area.
fn normal(corners: [[f32; 3]; 3]) -> [f32; 3] {
    let [a, b, c] = corners.map(|corner| DVec3::from(corner.map(f64::from)));
    let normal = (b - a).cross(c - a);
    let length = normal.dot(normal).sqrt();
    if length > 0.0 && length.is_finite() { (normal / length).to_array().map(|x| x as f32) } else { [0.0; 3] }
}
