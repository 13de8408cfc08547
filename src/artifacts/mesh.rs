//! The mesh with its clusters in colour, to look at.

use super::{Artifact, Content, Encoding, Flag, Form, Need, given};
use crate::error::{Error, Kind, Result};
use crate::export::glb::{self, Column, Values};
use crate::export::{Clusters, Geometry, obj, ply, vtp};

/// The mesh with its clusters.
pub static MESH: Artifact = Artifact {
    name: "mesh",
    about: "The mesh with its clusters in colour.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[
        Form { file: "mesh.glb", media_type: "model/gltf-binary", is_stored: false, schema: None, encode: as_glb },
        Form { file: "mesh.ply", media_type: "model/ply", is_stored: false, schema: None, encode: as_ply },
        Form { file: "mesh.vtp", media_type: "application/x-vtp", is_stored: false, schema: None, encode: as_vtp },
        Form { file: "mesh.obj", media_type: "model/obj", is_stored: false, schema: None, encode: as_obj },
    ],
    choices: &[],
    flags: &[Flag {
        name: "--mesh",
        value: "OUT",
        help: "Where to write the mesh with its clusters in colour: OUT.glb, OUT.ply or OUT.vtp, or with a group a \
               cluster: OUT.obj",
    }],
    is_served: true,
};

/// The mesh as it was read, with one cluster a face, and the number of clusters.
pub(super) fn geometry<'a>(content: &Content<'a>) -> Result<(Geometry<'a>, u64)> {
    let (mesh, labels) = (given(content.mesh)?, given(content.labels)?);
    if labels.labels.len() != mesh.faces.len() {
        return Err(Error::new(
            Kind::Internal,
            format_args!("there are {} labels of {} faces", labels.labels.len(), mesh.faces.len()),
        ));
    }
    let clusters = Clusters::OfFaces(labels.labels);
    Ok((Geometry { points: &mesh.positions, faces: &mesh.faces, clusters }, labels.clusters))
}

/// Number of faces of each cluster.
fn faces_of_clusters(labels: &[u32], clusters: u64) -> Vec<u32> {
    let mut faces = vec![0; clusters as usize];
    for &label in labels {
        faces[label as usize] += 1;
    }
    faces
}

fn as_glb<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, clusters) = geometry(content)?;
    let faces = faces_of_clusters(geometry.clusters.numbers(), clusters);
    let bytes = glb::mesh(&geometry, clusters, &[Column { name: "faces", values: Values::U32(faces) }])?;
    Ok(Box::new(move |out| out.write_all(&bytes)))
}

fn as_ply<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, _) = geometry(content)?;
    Ok(Box::new(move |out| ply::write(out, &geometry)))
}

fn as_vtp<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, _) = geometry(content)?;
    Ok(Box::new(move |out| vtp::write(out, &geometry)))
}

fn as_obj<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, _) = geometry(content)?;
    Ok(Box::new(move |out| obj::write(out, &geometry)))
}
