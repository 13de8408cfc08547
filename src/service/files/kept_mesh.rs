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
//! All little-endian. A triangle and its half of a vertex take 18 bytes of f32 before compression. Parts, names and
//! warnings are not kept: no output is made of them.

use std::io::{self, Read, Write};

use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::mesh::{Adjusted, Faces, Format, PolygonMesh};

pub(crate) const NAME: &str = "mesh.kept";

/// The name of an image that is kept: the file as it was uploaded.
pub(crate) const IMAGE: &str = "image.kept";

const MAGIC: &[u8; 8] = b"TSRMESH1";

/// zstd's fastest usual level: positions compress little at any.
const LEVEL: i32 = 1;

const CHUNK: usize = 1 << 14;

pub(crate) fn write(out: &mut dyn Write, mesh: &PolygonMesh) -> io::Result<()> {
    let mut out = zstd::Encoder::new(out, LEVEL)?;
    let PolygonMesh { positions, faces, .. } = mesh;
    let is_single = positions.iter().flatten().all(|&x| f64::from(x as f32).to_bits() == x.to_bits());
    out.write_all(MAGIC)?;
    out.write_all(&[u8::from(is_single), u8::from(faces.are_triangles())])?;
    for count in [positions.len(), faces.len(), faces.all_corners().len()] {
        out.write_all(&(count as u64).to_le_bytes())?;
    }
    match is_single {
        true => write_all(&mut out, positions.as_flattened(), |x| (*x as f32).to_le_bytes())?,
        false => write_all(&mut out, positions.as_flattened(), |x| x.to_le_bytes())?,
    }
    write_all(&mut out, faces.all_corners(), |corner| corner.to_le_bytes())?;
    if !faces.are_triangles() {
        let counts: Vec<u32> = (0..faces.len()).map(|face| faces.corners(face).len() as u32).collect();
        write_all(&mut out, &counts, |count| count.to_le_bytes())?;
    }
    out.finish()?;
    Ok(())
}

fn write_all<T, const N: usize>(out: &mut impl Write, numbers: &[T], to: impl Fn(&T) -> [u8; N]) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(N * CHUNK);
    for chunk in numbers.chunks(CHUNK) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(&to));
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Reads a mesh, which has `faces` faces and was of this format.
pub(crate) fn read(from: impl Read, faces: u64, format: Format) -> Result<PolygonMesh> {
    let damaged = |why: &dyn std::fmt::Display| Error::new(Kind::Internal, format!("the kept mesh is damaged: {why}"));
    let (positions, faces) = read_numbers(from, faces).map_err(|error| damaged(&error))?;
    if faces.all_corners().iter().any(|&corner| corner as usize >= positions.len()) {
        return Err(damaged(&"a corner is no point"));
    }
    let adjusted = Adjusted::default();
    Ok(PolygonMesh { format, positions, faces, parts: Vec::new(), warnings: Vec::new(), adjusted })
}

fn read_numbers(from: impl Read, expected: u64) -> io::Result<(Vec<[f64; 3]>, Faces)> {
    let wrong = |what: &str| io::Error::other(what.to_owned());
    let mut from = zstd::Decoder::new(from)?;
    let mut head = [0; 10];
    from.read_exact(&mut head)?;
    let ([magic @ .., is_single, are_triangles], mut counts) = (head, [0; 3]);
    if magic != *MAGIC {
        return Err(wrong("it begins with something else"));
    }
    for count in &mut counts {
        let mut bytes = [0; 8];
        from.read_exact(&mut bytes)?;
        *count = u64::from_le_bytes(bytes);
    }
    let [points, faces, corners] = counts;
    if faces != expected {
        return Err(wrong("it has another number of faces"));
    }
    let count = |number: u64| usize::try_from(number).map_err(|_| wrong("it is too large"));
    let coordinates = 3 * count(points)?;
    let flat: Vec<f64> = match is_single {
        1 => read_all(&mut from, coordinates, |bytes| f64::from(f32::from_le_bytes(bytes)))?,
        _ => read_all(&mut from, coordinates, f64::from_le_bytes)?,
    };
    let corners = read_all(&mut from, count(corners)?, u32::from_le_bytes)?;
    let faces = match are_triangles {
        1 if corners.len() as u64 == 3 * faces => Faces::from_triangles(corners),
        1 => return Err(wrong("triangles have three corners")),
        _ => {
            let mut polygons = Faces::with_capacity(count(faces)?);
            let mut rest = &corners[..];
            for length in read_all(&mut from, count(faces)?, u32::from_le_bytes)? {
                let (face, after) =
                    rest.split_at_checked(length as usize).ok_or_else(|| wrong("corners are missing"))?;
                polygons.push(face);
                rest = after;
            }
            polygons
        }
    };
    Ok((flat.as_chunks().0.to_vec(), faces))
}

/// Reads numbers, a chunk at a time: no memory is taken for what is not there.
fn read_all<T, const N: usize>(from: &mut impl Read, count: usize, of: impl Fn([u8; N]) -> T) -> io::Result<Vec<T>> {
    let mut numbers = Vec::new();
    let mut bytes = vec![0; N * CHUNK];
    while numbers.len() < count {
        let bytes = &mut bytes[..N * CHUNK.min(count - numbers.len())];
        from.read_exact(bytes)?;
        numbers.extend(bytes.as_chunks::<N>().0.iter().map(|bytes| of(*bytes)));
    }
    Ok(numbers)
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
            assert_eq!(read(&bytes[..cut], faces, mesh.format).expect_err("cut").kind, Kind::Internal);
        }
        assert!(read(&bytes[..], faces + 1, mesh.format).is_err());
        let mut plain = zstd::decode_all(&bytes[..]).expect("its own");
        plain[10..18].copy_from_slice(&(1u64 << 40).to_le_bytes());
        let claims = zstd::encode_all(&plain[..], LEVEL).expect("a vector takes everything");
        assert!(read(&claims[..], faces, mesh.format).is_err());
    }
}
