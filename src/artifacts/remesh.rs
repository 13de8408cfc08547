//! The remesh: a triangle mesh with a vertex a cluster, in formats of meshes, and what its vertices stand for.

use std::borrow::Cow;

use super::mesh::geometry;
use super::{Artifact, Choice, Content, Encoding, Flag, Form, Need, given};
use crate::error::Result;
use crate::export::npz::{self, Array};
use crate::export::{Clusters, Geometry, glb, obj, ply, stl, vtp};
use crate::mesh::Faces;
use crate::mesh::divide::Origin;
use crate::remesh::{Remesh, VertexSource, remesh};

/// The remesh.
pub static REMESH: Artifact = Artifact {
    name: "remesh",
    about: "A triangle mesh with a vertex a cluster, a manifold for any labels.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[
        Form { file: "remesh.ply", media_type: "model/ply", is_stored: false, schema: None, encode: as_ply },
        Form { file: "remesh.obj", media_type: "model/obj", is_stored: false, schema: None, encode: as_obj },
        Form { file: "remesh.stl", media_type: "model/stl", is_stored: false, schema: None, encode: as_stl },
        Form { file: "remesh.glb", media_type: "model/gltf-binary", is_stored: false, schema: None, encode: as_glb },
        Form { file: "remesh.vtp", media_type: "application/x-vtp", is_stored: false, schema: None, encode: as_vtp },
    ],
    choices: &[Choice::Placement],
    flags: &[Flag {
        name: "--remesh",
        value: "OUT",
        help: "Where to write a triangle mesh with a vertex a cluster: OUT.ply, OUT.obj, OUT.stl, OUT.glb or OUT.vtp",
    }],
    is_of_points: false,
    is_served: true,
};

/// What the vertices of the remesh stand for.
pub static REMESH_SOURCE: Artifact = Artifact {
    name: "remesh-source",
    about: "What each vertex of the remesh stands for: its kind, cluster, face, and barycentric coordinates there.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[Form {
        file: "remesh-source.npz",
        media_type: "application/x-npz",
        is_stored: false,
        schema: None,
        encode: source,
    }],
    choices: &[Choice::Placement],
    flags: &[Flag {
        name: "--remesh-source",
        value: "OUT.npz",
        help: "Where to write what each vertex of the remesh stands for, to carry attributes over: OUT.npz",
    }],
    is_of_points: false,
    is_served: true,
};

/// The remesh: the one that another output of the content was written from, where there is one.
fn made<'a>(content: &Content<'a>) -> Result<Cow<'a, Remesh>> {
    let (mesh, labels) = (given(content.mesh)?, given(content.labels)?);
    let make = || remesh(mesh, labels.labels, labels.clusters, content.choices.placement);
    let Some(cell) = content.remesh else { return Ok(Cow::Owned(make()?)) };
    if cell.get().is_none() {
        // a value that came in between would be the same
        let _ = cell.set(make()?);
    }
    cell.get().map(Cow::Borrowed).map_or_else(|| Ok(Cow::Owned(make()?)), Ok)
}

/// A remesh as encoders take it.
struct Shape {
    points: Vec<[f64; 3]>,
    faces: Faces,
    cluster_of_point: Vec<u32>,
}

impl Shape {
    fn of(content: &Content<'_>) -> Result<Self> {
        // checks the labels
        geometry(content)?;
        let remesh = made(content)?;
        Ok(Self {
            points: remesh.points.iter().map(|point| point.to_array()).collect(),
            faces: Faces::from_triangles(remesh.triangles.as_flattened().to_vec()),
            cluster_of_point: remesh.sources.iter().map(|source| source.cluster).collect(),
        })
    }

    fn geometry(&self) -> Geometry<'_> {
        let clusters = Clusters::OfPoints(&self.cluster_of_point);
        Geometry { points: &self.points, faces: &self.faces, clusters }
    }
}

fn as_ply<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let shape = Shape::of(content)?;
    Ok(Box::new(move |out| ply::write(out, &shape.geometry())))
}

fn as_obj<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let shape = Shape::of(content)?;
    Ok(Box::new(move |out| obj::write(out, &shape.geometry())))
}

fn as_vtp<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let shape = Shape::of(content)?;
    Ok(Box::new(move |out| vtp::write(out, &shape.geometry())))
}

fn as_stl<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let shape = Shape::of(content)?;
    let mut bytes = Vec::new();
    let written = stl::encode(shape.geometry())?(&mut bytes);
    Ok(Box::new(move |out| written.and_then(|()| out.write_all(&bytes))))
}

fn as_glb<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let clusters = given(content.labels)?.clusters;
    let bytes = glb::mesh(&Shape::of(content)?.geometry(), clusters, &[])?;
    Ok(Box::new(move |out| out.write_all(&bytes)))
}

/// The source of a vertex in the mesh whose divided faces were clustered.
fn before_division(source: &VertexSource, divided: &Faces, origin: &Origin) -> VertexSource {
    let part = origin.of(source.face);
    let corners = divided.corners(source.face as usize);
    let mut barycentric = [0.0; 3];
    for (vertex, weight) in source.vertices.iter().zip(source.barycentric) {
        let corner = corners.iter().position(|corner| corner == vertex).unwrap_or_default();
        (0..3).for_each(|i| barycentric[i] += weight * part.corners[corner][i]);
    }
    VertexSource { face: part.face, vertices: part.vertices, barycentric, ..*source }
}

fn source<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (of_clusters, _) = geometry(content)?;
    let remesh = made(content)?;
    let read = |source: &VertexSource| match content.origin {
        Some(origin) => before_division(source, of_clusters.faces, origin),
        None => *source,
    };
    let sources: Vec<VertexSource> = remesh.sources.iter().map(read).collect();
    let count = sources.len();
    let u32s = |of: fn(&VertexSource) -> u32| sources.iter().map(of).collect::<Vec<u32>>();
    let vertices: Vec<u32> = sources.iter().flat_map(|source| source.vertices).collect();
    let barycentric: Vec<f64> = sources.iter().flat_map(|source| source.barycentric).collect();
    let arrays = [
        ("kind", Array::u8(&[count], sources.iter().map(|source| source.kind as u8).collect())),
        ("cluster", Array::u32(&[count], &u32s(|source| source.cluster))),
        ("face", Array::u32(&[count], &u32s(|source| source.face))),
        ("vertices", Array::u32(&[count, 3], &vertices)),
        ("barycentric", Array::f64(&[count, 3], &barycentric)),
    ];
    Ok(Box::new(move |out| npz::write(out, &arrays)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};
    use crate::mesh::divide::divided;
    use crate::remesh::Placement;

    #[test]
    fn sources_in_a_divided_mesh_are_points_of_the_mesh_that_was_read() {
        for (sample, times) in [(Sample::Quads, 2), (Sample::Terrain, 1)] {
            let mesh = generate(sample, 300).expect("a sample");
            let (fine, origin) = divided(&mesh, times).expect("few faces");
            let labels: Vec<u32> = (0..fine.faces.len() as u32).map(|face| face / 40).collect();
            let clusters = u64::from(labels[labels.len() - 1]) + 1;
            let made = remesh(&fine, &labels, clusters, Placement::Fit).expect("labels fit");
            for source in &made.sources {
                let before = before_division(source, &fine.faces, &origin);
                assert!(before.vertices.iter().all(|at| mesh.faces.corners(before.face as usize).contains(at)));
                assert!((before.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                let point = |vertices: [u32; 3], weights: [f64; 3], positions: &[[f64; 3]], axis: usize| -> f64 {
                    vertices.iter().zip(weights).map(|(&at, weight)| weight * positions[at as usize][axis]).sum()
                };
                for axis in 0..3 {
                    let one = point(source.vertices, source.barycentric, &fine.positions, axis);
                    let other = point(before.vertices, before.barycentric, &mesh.positions, axis);
                    assert!((one - other).abs() < 1e-9, "{source:?} {before:?}");
                }
            }
        }
    }
}
