//! STL, binary and text.
//!
//! A file is binary if its length is that of as many triangles as its header counts, or if no `facet` follows a first
//! line `solid`: headers of binary files may begin with that word, too.
//!
//! A facet is a triangle with three vertices of its own; welding finds its neighbours. Normals and attribute bytes are
//! not looked at. The solids of a text are the parts of the mesh.

mod solids;

use super::text::{is_space, with_line_feeds};
use super::{Adjusted, Faces, Format, Opened, Part, PolygonMesh, ReadMesh, Source};
use crate::error::{Error, Result};
use crate::parallel;

/// Bytes of the header of a binary file, before the number of triangles.
const HEADER: usize = 80;
/// Bytes before the first triangle.
const BEFORE: usize = HEADER + 4;
/// Bytes of a triangle: a normal, three corners, attributes.
const TRIANGLE: usize = 50;
/// Where the corners of a triangle begin in it.
const CORNERS: usize = 12;

/// Triangles that a thread reads at once, at least.
const PIECE: usize = 1 << 13;

/// Triangles whose corners can be numbered.
const MOST_TRIANGLES: u64 = (u32::MAX / 3) as u64;

/// Whether a file with these first bytes is an STL, of this length where it is known.
pub fn is_stl(head: &[u8], length: Option<u64>) -> bool {
    begins_with_solid(head) || has_declared_length(head, length) || has_triangle(head)
}

/// Refuses what is no STL file by its first bytes and its length.
pub fn check_head(head: &[u8], length: Option<u64>) -> Result<()> {
    let Some(length) = length.filter(|_| !is_stl(head, length)) else { return Ok(()) };
    Err(Format::Stl.is_not(&match triangles(head) {
        Some(triangles) => format!(
            "it does not begin with \"solid\", and a binary STL file of as many triangles as its header counts, \
             {triangles}, has {} bytes, not {length}",
            declared_length(triangles)
        ),
        None => {
            format!("it does not begin with \"solid\", and a binary STL file has at least {BEFORE} bytes, not {length}")
        }
    }))
}

/// Opens an STL file: counts its triangles.
pub fn open(source: Source<'_>, then: &mut dyn FnMut(Opened<'_>)) -> Result<()> {
    let Source { bytes, limits, .. } = source;
    let length = bytes.len() as u64;
    if !has_declared_length(bytes, Some(length)) && begins_with_solid(bytes) && has_facet(bytes) {
        let text = with_line_feeds(bytes);
        let pieces = solids::split(&text);
        let facets = parallel::map(pieces.len(), 1, |piece| solids::count_facets(pieces[piece])).into_iter().sum();
        check_triangles(facets)?;
        limits.check_faces(facets)?;
        then(Opened::new(facets, || {
            let (positions, parts, warnings) = solids::read(&text, &pieces)?;
            finish(positions, parts, warnings)
        }));
        return Ok(());
    }
    let Some(triangles) = triangles(bytes) else {
        return Err(Error::mesh(format_args!(
            "the STL file is truncated: a binary one has at least {BEFORE} bytes, and a text has facets: {length}"
        )));
    };
    let there = declared_length(triangles);
    if there > length {
        return Err(Error::mesh(format_args!(
            "the file is truncated, or no STL file: its header counts {triangles} triangles, which end at byte \
             {there}; it has {length}"
        )));
    }
    check_triangles(triangles)?;
    limits.check_faces(triangles)?;
    let warning = (length > there).then(|| format!("bytes after the last triangle were ignored: {}", length - there));
    let (of_triangles, _) = bytes[BEFORE..there as usize].as_chunks::<TRIANGLE>();
    then(Opened::new(triangles, || {
        let parts = vec![Part { faces: triangles, ..Part::default() }];
        finish(read(of_triangles)?, parts, warning.into_iter().collect())
    }));
    Ok(())
}

/// The positions of the corners of all triangles.
fn read(triangles: &[[u8; TRIANGLE]]) -> Result<Vec<[f64; 3]>> {
    let mut positions = vec![[0.0f64; 3]; 3 * triangles.len()];
    let are_finite = parallel::runs_mut(positions.as_chunks_mut::<3>().0, PIECE, &|first, corners| {
        let mut is_finite = true;
        for (corners, triangle) in corners.iter_mut().zip(&triangles[first..]) {
            let (numbers, _) = triangle[CORNERS..].as_chunks::<4>();
            for (coordinate, number) in corners.as_flattened_mut().iter_mut().zip(numbers) {
                *coordinate = f32::from_le_bytes(*number).into();
                is_finite &= coordinate.is_finite();
            }
        }
        is_finite
    });
    if are_finite.into_iter().all(|is_finite| is_finite) {
        return Ok(positions);
    }
    let wrong = positions.as_flattened().iter().enumerate().find(|(_, coordinate)| !coordinate.is_finite());
    let (at, coordinate) = wrong.unwrap_or((0, &0.0));
    Err(Error::mesh(format_args!("triangle {} (from 0): a coordinate is not finite: {coordinate}", at / 9)))
}

/// Makes the mesh: every three positions are a triangle.
fn finish(positions: Vec<[f64; 3]>, parts: Vec<Part>, warnings: Vec<String>) -> Result<ReadMesh> {
    if positions.is_empty() {
        return Err(Error::mesh("the mesh has no faces: the STL file has no triangles"));
    }
    let faces = Faces::from_triangles((0..positions.len() as u32).collect());
    let adjusted = Adjusted::default();
    Ok(PolygonMesh { format: Format::Stl, positions, faces, parts, warnings, adjusted }.into())
}

fn check_triangles(triangles: u64) -> Result<()> {
    if triangles <= MOST_TRIANGLES {
        return Ok(());
    }
    Err(Error::too_large(format_args!(
        "the mesh has more triangles than can be numbered, {MOST_TRIANGLES}: {triangles}"
    )))
}

/// Triangles that the header of a binary file counts.
fn triangles(head: &[u8]) -> Option<u64> {
    head.get(HEADER..)?.first_chunk().map(|count| u32::from_le_bytes(*count).into())
}

/// Bytes of a binary file of so many triangles.
fn declared_length(triangles: u64) -> u64 {
    BEFORE as u64 + TRIANGLE as u64 * triangles
}

fn has_declared_length(head: &[u8], length: Option<u64>) -> bool {
    let declared = triangles(head).filter(|&triangles| triangles > 0).map(declared_length);
    declared.is_some() && declared == length
}

/// Whether the first word is `solid`, in any case.
fn begins_with_solid(head: &[u8]) -> bool {
    let text = head.trim_ascii_start();
    let (word, rest) = text.split_at(text.len().min(5));
    word.eq_ignore_ascii_case(b"solid") && rest.first().is_some_and(|&byte| is_space(byte))
}

/// Whether a line after the first begins with `facet` or ends the solid, in any case.
fn has_facet(text: &[u8]) -> bool {
    let mut lines =
        text.trim_ascii_start().split(|byte| matches!(byte, b'\n' | b'\r')).skip(1).map(<[u8]>::trim_ascii_start);
    let is_sought = |line: &[u8]| {
        [&b"facet"[..], b"endsolid"]
            .iter()
            .any(|word| line.get(..word.len()).is_some_and(|l| l.eq_ignore_ascii_case(word)))
    };
    lines.any(is_sought)
}

/// Whether it has a header of 80 bytes of any kind, a number, and a triangle whose corners are numbers of usual sizes.
fn has_triangle(head: &[u8]) -> bool {
    let Some(first) = head.get(..BEFORE + TRIANGLE) else { return false };
    // four bytes of text make a float of another size
    let is_usual = |value: f32| value == 0.0 || (1e-12..1e12).contains(&value.abs());
    let (corners, _) = first[BEFORE + CORNERS..BEFORE + TRIANGLE - 2].as_chunks::<4>();
    let are_usual = corners.iter().all(|bytes| is_usual(f32::from_le_bytes(*bytes)));
    triangles(head) != Some(0) && first.contains(&0) && are_usual
}

#[cfg(test)]
mod tests {
    use super::*;

    fn binary(header: &[u8], triangles: usize) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(HEADER, 0);
        bytes.extend((triangles as u32).to_le_bytes());
        for _ in 0..triangles {
            let numbers = [f32::NAN, 0.0, 1.0, 0.0, 0.0, 0.0, 25.4, 0.0, 0.0, 0.0, -3.5e-3, 0.0];
            bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
            bytes.extend([0, 0]);
        }
        bytes
    }

    #[test]
    fn binary_files_are_known_by_length_and_numbers() {
        for header in [&b""[..], b"solid made by CAD\nfacet", b"Exported from Blender", b"COLOR=\xff\xff\xff", b"OFF\n"]
        {
            let bytes = binary(header, 2);
            for length in [Some(bytes.len() as u64), None, Some(bytes.len() as u64 + 1)] {
                assert!(is_stl(&bytes, length), "{header:?}");
                assert_eq!(check_head(&bytes, length), Ok(()));
            }
        }
        let mut bytes = binary(b"", 2);
        bytes[BEFORE + CORNERS..][..8].fill(0x7f);
        assert!(is_stl(&bytes, Some(184)) && !is_stl(&bytes, Some(183)) && !is_stl(&bytes, None));
        assert!(check_head(&bytes, Some(183)).is_err() && check_head(&bytes, None).is_ok());
        assert!(!is_stl(&[0; 84], Some(84)));
        assert!(!is_stl("v 0.125 0.25 0.5\n".repeat(20).as_bytes(), Some(340)));
        assert!(!is_stl(&[0; 4096], None));
    }

    #[test]
    fn text_is_known_by_its_first_words() {
        for text in ["solid", "solidx\n", "", "so", "# solid"] {
            assert!(!is_stl(text.as_bytes(), None), "{text:?}");
        }
        for text in ["solid \n", "SOLID\tx", "\n solid\r\n"] {
            assert!(is_stl(text.as_bytes(), None), "{text:?}");
        }
        for text in ["solid x\n\n  FACET normal", "solid\rfacet", "solid\nendsolid\n", "solid\ncolor 1\nfacet"] {
            assert!(has_facet(text.as_bytes()), "{text:?}");
        }
        for text in ["solid facet\n", "facet", "\nsolid facet\0\0\0"] {
            assert!(!has_facet(text.as_bytes()), "{text:?}");
        }
    }
}
