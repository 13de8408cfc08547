//! The mesh of a job as it is kept with the result: positions and faces, compressed by zstd.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `TSRMESH1` |
//! | 1 | 1 if positions are f32, which then holds all of them exactly, 0 if they are f64 |
//! | 1 | 1 if all faces are triangles, else 0 |
//! | 3 · 8 | numbers of points, faces and corners, u64 |
//! | 12 or 24 a point | positions |
//! | 4 a corner | points of the corners, u32 |
//! | 4 a face | numbers of corners, u32, unless all faces are triangles |
//!
//! All little-endian; 18 bytes a triangle of f32 before compression. No output needs parts, names or warnings.

use std::io::{self, Read, Write};

use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::mesh::{Adjusted, Faces, Format, PolygonMesh};

pub(crate) const NAME: &str = "mesh.kept";

/// The name of an image that is kept: the file as it was uploaded.
pub(crate) const IMAGE: &str = "image.kept";

const MAGIC: &[u8; 8] = b"TSRMESH1";

/// zstd's fastest usual level: positions compress little at any.
const LEVEL: i32 = 1;

pub(crate) fn write(out: &mut dyn Write, mesh: &PolygonMesh) -> io::Result<()> {
    let mut out = io::BufWriter::new(zstd::Encoder::new(out, LEVEL)?);
    let PolygonMesh { positions, faces, .. } = mesh;
    let is_single = positions.iter().flatten().all(|&x| f64::from(x as f32).to_bits() == x.to_bits());
    out.write_all(MAGIC)?;
    out.write_all(&[u8::from(is_single), u8::from(faces.are_triangles())])?;
    for count in [positions.len(), faces.len(), faces.all_corners().len()] {
        out.write_all(&(count as u64).to_le_bytes())?;
    }
    for x in positions.as_flattened() {
        if is_single { out.write_all(&(*x as f32).to_le_bytes())? } else { out.write_all(&x.to_le_bytes())? }
    }
    for corner in faces.all_corners() {
        out.write_all(&corner.to_le_bytes())?;
    }
    if !faces.are_triangles() {
        for face in 0..faces.len() {
            out.write_all(&(faces.corners(face).len() as u32).to_le_bytes())?;
        }
    }
    out.into_inner()?.finish().map(drop)
}

/// Reads a mesh, which has `faces` faces and was of this format.
pub(crate) fn read(from: impl Read, faces: u64, format: Format) -> Result<PolygonMesh> {
    let damaged = |why| Error::internal(format_args!("the kept mesh is damaged: {why}"));
    let (positions, faces) = read_numbers(from, faces).map_err(damaged)?;
    Ok(PolygonMesh { format, positions, faces, parts: Vec::new(), warnings: Vec::new(), adjusted: Adjusted::default() })
}

fn read_numbers(from: impl Read, expected: u64) -> io::Result<(Vec<[f64; 3]>, Faces)> {
    let mut from = io::BufReader::new(zstd::Decoder::new(from)?);
    let mut head = [0; 10];
    from.read_exact(&mut head)?;
    let [magic @ .., is_single, are_triangles] = head;
    if magic != *MAGIC {
        return Err(io::Error::other("it begins with something else"));
    }
    let counts = read_all(&mut from, 3, u64::from_le_bytes)?;
    let (coordinates, faces, corners) = (counts[0].saturating_mul(3), counts[1], counts[2]);
    if faces != expected {
        return Err(io::Error::other("it has another number of faces"));
    }
    let flat: Vec<f64> = match is_single {
        1 => read_all(&mut from, coordinates, |bytes| f64::from(f32::from_le_bytes(bytes)))?,
        _ => read_all(&mut from, coordinates, f64::from_le_bytes)?,
    };
    let corners = read_all(&mut from, corners, u32::from_le_bytes)?;
    if corners.iter().any(|&corner| u64::from(corner) >= counts[0]) {
        return Err(io::Error::other("a corner is no point"));
    }
    let faces = match are_triangles {
        1 if corners.len() as u64 == 3 * faces => Faces::from_triangles(corners),
        1 => return Err(io::Error::other("triangles have three corners")),
        _ => {
            let mut polygons = Faces::with_capacity(faces as usize);
            let mut rest = &corners[..];
            for length in read_all(&mut from, faces, u32::from_le_bytes)? {
                let (face, after) =
                    rest.split_at_checked(length as usize).ok_or_else(|| io::Error::other("corners are missing"))?;
                polygons.push(face);
                rest = after;
            }
            polygons
        }
    };
    Ok((flat.as_chunks().0.to_vec(), faces))
}

/// Reads numbers one by one: no memory is taken for what is not there.
fn read_all<T, const N: usize>(from: &mut impl Read, count: u64, of: impl Fn([u8; N]) -> T) -> io::Result<Vec<T>> {
    let mut bytes = [0; N];
    (0..count).map(|_| from.read_exact(&mut bytes).map(|()| of(bytes))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tesserae_mesh::dev::sample::{Sample, generate};

    #[test]
    fn a_mesh_is_read_as_it_was_written() {
        for (sample, is_single) in [(Sample::Knot, false), (Sample::Quads, true), (Sample::Quads, false)] {
            let mut mesh = generate(sample, 2000).expect("a sample");
            if is_single {
                mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x = f64::from(*x as f32));
            }
            let mut bytes = Vec::new();
            write(&mut bytes, &mesh).expect("a vector takes everything");
            let read = read(&bytes[..], mesh.faces.len() as u64, mesh.format).expect("a mesh");
            assert_eq!((&read.positions, &read.faces), (&mesh.positions, &mesh.faces));
        }
    }

    #[test]
    fn a_damaged_mesh_is_an_error_and_takes_no_more_memory_than_is_there() {
        let mesh = generate(Sample::Quads, 500).expect("a sample");
        let faces = mesh.faces.len() as u64;
        let mut bytes = Vec::new();
        write(&mut bytes, &mesh).expect("a vector takes everything");
        for cut in [0, 5, bytes.len() / 2] {
            assert_eq!(read(&bytes[..cut], faces, mesh.format).expect_err("cut").kind, tesserae_mesh::Kind::Internal);
        }
        assert!(read(&bytes[..], faces + 1, mesh.format).is_err());
        let mut plain = zstd::decode_all(&bytes[..]).expect("its own");
        plain[10..18].copy_from_slice(&(1u64 << 40).to_le_bytes());
        let claims = zstd::encode_all(&plain[..], LEVEL).expect("a vector takes everything");
        assert!(read(&claims[..], faces, mesh.format).is_err());
    }
}
