//! What is made of a kept mesh and labels on request.

use std::io::{Read, Write};

use axum::response::Response;
use object_store::GetRange;

use super::encoded::{self, encoded};
use super::snapshots::read_labels;
use crate::artifacts::{Choices, Content, Form, HIERARCHY_TSR, LABELS_NPY, Labels};
use crate::error::{Error, Kind, Result};
use crate::hierarchy::stored;
use crate::service::state::Shared;
use crate::service::store::{Job, Summary};
use crate::service::{job_blobs, kept_mesh};

/// An output of a job whose mesh was kept, of its labels or of those at a number of clusters.
pub(in crate::service) async fn made(
    shared: &Shared,
    job: &Job,
    summary: &Summary,
    clusters: Option<u64>,
    choices: Choices,
    form: &'static Form,
) -> Result<Response> {
    let turn = encoded::turn(shared).await?;
    let blob =
        async |name: &str, range| job_blobs::result(&shared.files, shared.store.as_ref(), job, name, range).await;
    let mesh = blob(kept_mesh::NAME, None).await?;
    let (faces, format) = (summary.faces, job.spec.format);
    // what is in memory meanwhile counts like the mesh of a job
    let memory = shared.memory.read(mesh.length()).await?.build(faces, false).await?;
    let labels = match clusters {
        Some(_) => blob(HIERARCHY_TSR.file, None).await?,
        None => blob(LABELS_NPY.file, Some(GetRange::Suffix(4 * faces))).await?,
    };
    let length = labels.length();
    let (mesh, labels) = (mesh.into_reader(), labels.into_reader());
    let of_job = summary.clusters;
    let write = move |out: &mut dyn Write| {
        let _memory = memory;
        let mesh = kept_mesh::read(mesh as Box<dyn Read>, faces, format)?;
        let (labels, clusters) = match clusters {
            None => (read_labels(labels, faces)?, of_job),
            Some(clusters) => {
                let cut = stored::cut(labels, length, u64::MAX, clusters);
                let (_, cut) = cut.map_err(super::hierarchy::of_cut)?;
                (cut.labels, clusters)
            }
        };
        let labels = Labels::new(clusters, &labels);
        let content = Content { labels: Some(labels), mesh: Some(&mesh), choices, ..Content::default() };
        (form.encode)(&content)?(out).map_err(encoded::cannot)
    };
    Ok(encoded(shared, Some(turn), form.media_type, write).await?.0)
}

/// The error of an output that is not stored and cannot be made.
pub(in crate::service) fn mesh_not_kept(form: &Form) -> Error {
    Error::new(
        Kind::MeshNotKept,
        format_args!(
            "the mesh of this job was not kept: submit it again with keep_mesh=true, which keeps it with the result, \
             or name what to make of it with outputs={}",
            form.file
        ),
    )
}
