//! The mesh with its clusters in colour, to look at.

use super::{Artifact, Choice, Content, Encoding, Flag, Form, Need, given};
use crate::complex::{Cluster, Graph};
use crate::error::{Error, Kind, Result};
use crate::export::glb::{self, Column, Values};
use crate::export::{Clusters, Geometry, Split, obj, ply, vtp};
use crate::mesh::PolygonMesh;

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
    choices: &[Choice::PlyVertexColours, Choice::Colours],
    flags: &[Flag {
        name: "--mesh",
        value: "OUT",
        help: "Where to write the mesh with its clusters in colour: OUT.glb, OUT.ply or OUT.vtp, or with a group a \
               cluster: OUT.obj",
    }],
    is_of_points: false,
    is_served: true,
};

/// The mesh as it was read, with one cluster a face, and the number of clusters.
pub(super) fn geometry<'a>(content: &Content<'a>) -> Result<(Geometry<'a>, u64)> {
    let (mesh, labels) = (given(content.mesh)?, given(content.labels)?);
    if labels.labels.len() != mesh.faces.len() {
        return Err(Error::internal(format_args!(
            "there are {} labels of {} faces",
            labels.labels.len(),
            mesh.faces.len()
        )));
    }
    let clusters = Clusters::OfFaces(labels.labels);
    Ok((Geometry { points: &mesh.positions, faces: &mesh.faces, clusters }, labels.clusters))
}

/// [`geometry`] for a format that always has clusters.
fn coloured<'a>(content: &Content<'a>) -> Result<(Geometry<'a>, u64)> {
    match content.choices.is_plain {
        true => Err(Error::new(Kind::InvalidParameter, "colours=none goes with glb only: take format=glb")),
        false => geometry(content),
    }
}

/// What viewers can say about a cluster.
fn table(mesh: &PolygonMesh, labels: &[u32], clusters: u64) -> Result<[Column; 5]> {
    let rows = Graph::new(mesh, labels, clusters)?.nodes;
    let f64s = |of: fn(&Cluster) -> f64| Values::F64(rows.iter().map(of).collect());
    let u32s = |of: fn(&Cluster) -> u64| Values::U32(rows.iter().map(|row| of(row) as u32).collect());
    let centroids = rows.iter().map(|row| row.centroid.unwrap_or_default()).collect();
    Ok([
        Column { name: "faces", values: u32s(|row| row.faces) },
        Column { name: "neighbours", values: u32s(|row| row.neighbours) },
        Column { name: "area", values: f64s(|row| row.area) },
        Column { name: "perimeter", values: f64s(|row| row.perimeter) },
        Column { name: "centroid", values: Values::Vec3(centroids) },
    ])
}

fn as_glb<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, clusters) = geometry(content)?;
    let labels = geometry.clusters.numbers();
    let bytes = match content.choices.is_plain {
        true => glb::plain(geometry.points, geometry.faces)?,
        false => glb::mesh(&geometry, clusters, &table(given(content.mesh)?, labels, clusters)?)?,
    };
    Ok(Box::new(move |out| out.write_all(&bytes)))
}

fn as_ply<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, clusters) = coloured(content)?;
    if !content.choices.ply_vertex_colours {
        return Ok(Box::new(move |out| ply::write(out, &geometry)));
    }
    let split = Split::new(&geometry, geometry.clusters.numbers(), clusters as usize);
    Ok(Box::new(move |out| {
        let (points, faces) = (split.positions(&geometry), split.cut_faces(&geometry));
        let clusters = split.cluster_of_vertex();
        ply::write(out, &Geometry { points: &points, faces: &faces, clusters: Clusters::OfPoints(&clusters) })
    }))
}

fn as_vtp<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, _) = coloured(content)?;
    Ok(Box::new(move |out| vtp::write(out, &geometry)))
}

fn as_obj<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, _) = coloured(content)?;
    Ok(Box::new(move |out| obj::write(out, &geometry)))
}
