//! Meshes made from nothing, for trying out and for tests.
//!
//! One file a shape; [`Sample`] is the table of names. A sample is the same on every machine: positions come from sums,
//! products, quotients, square roots and the sines of the pinned `libm`, noise from integer hashes. Positions are
//! rounded to f32, so that the OBJ and the GLB of a sample hold the same numbers.

mod boxes;
mod flat;
pub mod hard;
mod icosphere;
mod knot;
mod part;
mod parts;
mod patch;
mod sphere;
mod terrain;
mod torus;
mod write;

pub use write::{write_glb, write_obj};

use crate::error::{Error, Result};
use crate::mesh::{Adjusted, Faces, Format, Part, PolygonMesh};

/// The largest number of faces that a sample is made with; what a mesh may have by default.
pub const MAX_FACES: u64 = 50_000_000;

/// A shape. From some 1,500 faces on (200 for all but `cube`, `icosphere`, `parts` and `part`), the number of faces is
/// within 10 % of the request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Sample {
    /// Unit sphere of nearly equal triangles; closed; the number of faces, rounded up to even
    Sphere,
    /// Unit sphere, the triangles of an icosahedron divided evenly; closed; the nearest 20·m² faces
    Icosphere,
    /// Torus; closed, genus 1; 2·u·v faces
    Torus,
    /// Trefoil knot with bumps; closed, genus 1; 2·u·v faces
    Knot,
    /// Hilly square with a border; open; 2·u·v faces
    Terrain,
    /// Twelve separate closed shapes, the largest a thousand times as long as the smallest
    Parts,
    /// Machined part of 13 patches, of which --truth writes the numbers: planes, cylinders, a sphere; closed
    Part,
    /// Rounded box of quads; closed; 4·a·b + 2·a² faces
    Quads,
    /// Flat rectangle of equal right triangles; open; 2·u·v faces
    Plane,
    /// One row of equal triangles; open; exactly the number of faces
    Strip,
    /// Cube of equal right triangles; closed; the nearest 12·m² faces
    Cube,
}

impl Sample {
    /// Every shape.
    pub const ALL: [Sample; 11] = [
        Sample::Sphere,
        Sample::Icosphere,
        Sample::Torus,
        Sample::Knot,
        Sample::Terrain,
        Sample::Parts,
        Sample::Part,
        Sample::Quads,
        Sample::Plane,
        Sample::Strip,
        Sample::Cube,
    ];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Sample::Sphere => "sphere",
            Sample::Icosphere => "icosphere",
            Sample::Torus => "torus",
            Sample::Knot => "knot",
            Sample::Terrain => "terrain",
            Sample::Parts => "parts",
            Sample::Part => "part",
            Sample::Quads => "quads",
            Sample::Plane => "plane",
            Sample::Strip => "strip",
            Sample::Cube => "cube",
        }
    }

    /// The smallest number of faces it can be made of.
    pub fn fewest_faces(self) -> u64 {
        match self {
            Sample::Sphere => 6,
            Sample::Icosphere => 20,
            Sample::Torus => 18,
            Sample::Knot => 72,
            Sample::Terrain | Sample::Plane => 2,
            Sample::Parts => 250,
            Sample::Part => 400,
            Sample::Quads => 6,
            Sample::Strip => 1,
            Sample::Cube => 12,
        }
    }
}

/// Makes a mesh of close to `faces` faces: [`Sample`] tells which numbers come out.
///
/// Every part of the mesh ([`PolygonMesh::parts`]) is one connected component, its faces wound counter-clockwise seen
/// from outside (from above for open shapes).
///
/// # Errors
/// When `faces` is below [`Sample::fewest_faces`] or above [`MAX_FACES`].
pub fn generate(sample: Sample, faces: u64) -> Result<PolygonMesh> {
    check_number(sample, faces)?;
    Ok(match sample {
        Sample::Sphere => whole(sample, sphere::sphere(faces)),
        Sample::Icosphere => whole(sample, icosphere::icosphere(faces)),
        Sample::Torus => whole(sample, torus::torus(faces)),
        Sample::Knot => whole(sample, knot::knot(faces)),
        Sample::Terrain => whole(sample, terrain::terrain(faces)),
        Sample::Parts => join(parts::parts(faces)),
        Sample::Part => whole(sample, part::part(faces, 0.0).0),
        Sample::Quads => whole(sample, boxes::rounded_box(faces)),
        Sample::Plane => whole(sample, flat::plane(faces)),
        Sample::Strip => whole(sample, flat::strip(faces)),
        Sample::Cube => whole(sample, boxes::cube(faces)),
    })
}

fn check_number(sample: Sample, faces: u64) -> Result<()> {
    let fewest = sample.fewest_faces();
    match (fewest..=MAX_FACES).contains(&faces) {
        true => Ok(()),
        false => Err(Error::parameter(format_args!(
            "faces must be between {fewest} and {MAX_FACES} for {}, not {faces}",
            sample.name()
        ))),
    }
}

/// The shape [`Sample::Part`], its corners moved by normal noise of `noise` percent of the diagonal a coordinate, and
/// the patch that each face belongs to, from 0 to 12.
///
/// # Errors
/// Those of [`generate`], and when `noise` is not from 0 to 10.
pub fn generate_part(faces: u64, noise: f64) -> Result<(PolygonMesh, Vec<u32>)> {
    if !(0.0..=10.0).contains(&noise) {
        return Err(Error::parameter(format_args!("noise must be from 0 to 10 percent, not {noise}")));
    }
    check_number(Sample::Part, faces)?;
    let (piece, patches) = part::part(faces, noise);
    Ok((whole(Sample::Part, piece), patches))
}

/// One connected shape.
struct Piece {
    positions: Vec<[f64; 3]>,
    faces: Faces,
}

/// The mesh of a single shape, which gives its name to the only part.
fn whole(sample: Sample, piece: Piece) -> PolygonMesh {
    join(vec![(sample.name().to_owned(), piece)])
}

/// The mesh of several shapes, in the given order.
fn join(pieces: Vec<(String, Piece)>) -> PolygonMesh {
    let mut mesh = PolygonMesh {
        format: Format::Obj,
        positions: Vec::new(),
        faces: Faces::default(),
        parts: Vec::new(),
        warnings: Vec::new(),
        adjusted: Adjusted::default(),
    };
    let mut corners = Vec::new();
    for (name, piece) in pieces {
        let first_vertex = mesh.positions.len() as u32;
        mesh.parts.push(Part {
            group: Some(name.into()),
            first_face: mesh.faces.len() as u64,
            faces: piece.faces.len() as u64,
            ..Part::default()
        });
        if mesh.faces.is_empty() {
            mesh.faces = piece.faces;
        } else {
            for face in 0..piece.faces.len() {
                corners.clear();
                corners.extend(piece.faces.corners(face).iter().map(|c| c + first_vertex));
                mesh.faces.push(&corners);
            }
        }
        mesh.positions.extend(piece.positions.iter().map(|p| p.map(|x| f64::from(x as f32))));
    }
    mesh
}
