//! A mesh a cluster.

use super::mesh::geometry;
use super::{Artifact, Choice, Content, Encoding, Flag, Form, Need};
use crate::error::Result;
use crate::export::Split;
use crate::export::submeshes::{self, Member};

/// The clusters as meshes of their own.
pub static SUBMESHES: Artifact = Artifact {
    name: "submeshes",
    about: "The clusters as meshes of their own, or as index buffers.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[
        Form {
            file: "submeshes.glb",
            media_type: "model/gltf-binary",
            is_stored: false,
            schema: None,
            encode: as_nodes,
        },
        Form {
            file: "submeshes.zip",
            media_type: "application/zip",
            is_stored: false,
            schema: None,
            encode: |content| as_archive(content, Member::Ply),
        },
        Form {
            file: "submeshes.stl.zip",
            media_type: "application/zip",
            is_stored: false,
            schema: None,
            encode: |content| as_archive(content, Member::Stl),
        },
        Form {
            file: "submeshes.obj.zip",
            media_type: "application/zip",
            is_stored: false,
            schema: None,
            encode: |content| as_archive(content, Member::Obj),
        },
        Form {
            file: "submeshes.npz",
            media_type: "application/x-npz",
            is_stored: false,
            schema: None,
            encode: as_buffers,
        },
    ],
    choices: &[Choice::Force],
    flags: &[Flag {
        name: "--submeshes",
        value: "OUT",
        help: "Where to write the clusters as meshes of their own: OUT.glb, a node each; OUT.zip, a PLY each; \
               OUT.stl.zip or OUT.obj.zip; or OUT.npz, index buffers",
    }],
    is_of_points: false,
    is_served: true,
};

fn as_nodes<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, clusters) = geometry(content)?;
    let split = Split::new(&geometry, geometry.clusters.numbers(), clusters as usize);
    let bytes = submeshes::nodes(&geometry, &split, content.choices.force)?;
    Ok(Box::new(move |out| out.write_all(&bytes)))
}

fn as_archive<'a>(content: &Content<'a>, member: Member) -> Result<Encoding<'a>> {
    let (geometry, clusters) = geometry(content)?;
    let split = Split::new(&geometry, geometry.clusters.numbers(), clusters as usize);
    Ok(Box::new(submeshes::archive(geometry, split, member)?))
}

fn as_buffers<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (geometry, clusters) = geometry(content)?;
    Ok(Box::new(move |out| {
        let split = Split::new(&geometry, geometry.clusters.numbers(), clusters as usize);
        submeshes::write_buffers(out, &geometry, &split)
    }))
}
