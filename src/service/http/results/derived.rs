//! What is made of a kept mesh and labels on request.

use std::io::Write;
use std::sync::Arc;

use axum::response::Response;
use tesserae_mesh::artifacts::{Artifact, Choices, Content, Form, HIERARCHY_TSR, LABELS_NPY, Labels};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::hierarchy::stored::{self, Input};
use tesserae_mesh::job::InputFormat;

use super::checked::{self, CheckedReader};
use super::encoded::{self, encoded};
use super::labels;
use crate::files::kept_mesh;
use crate::http::state::Shared;
use crate::store::{Job, Summary};
use crate::work::pipeline::Needed;

/// What labels are read from, and their number of clusters.
enum Source {
    Labels(CheckedReader, u64),
    Cut(Box<dyn Input + Send>, u64),
}

/// An output of a job whose mesh was kept, of its labels or of those at a number of clusters.
pub(crate) async fn made(
    shared: &Shared,
    job: &Job,
    summary: &Summary,
    clusters: Option<u64>,
    choices: Choices,
    form: &'static Form,
) -> Result<Response> {
    let turn = encoded::turn(shared).await?;
    let mesh = checked::open(shared, job, kept_mesh::NAME).await?;
    let InputFormat::Mesh(format) = job.spec.format else {
        return Err(Error::new(Kind::Internal, "points keep no mesh"));
    };
    let faces = summary.faces;
    // what is in memory meanwhile counts like the mesh of a job
    let memory = shared.memory.read(mesh.length()).await?.build(Needed::of_faces(faces, None)).await?;
    let source = match clusters {
        Some(_) => HIERARCHY_TSR.file,
        None => LABELS_NPY.file,
    };
    let blob = checked::open(shared, job, source).await?;
    let length = blob.length();
    let from = match clusters {
        Some(clusters) => Source::Cut(blob.into_hierarchy(), clusters),
        None => Source::Labels(blob.into_reader(), summary.clusters),
    };
    let (mesh, files, job) = (mesh.into_reader(), Arc::clone(&shared.files), job.id);
    let write = move |out: &mut dyn Write| {
        let _memory = memory;
        let mesh = mesh.read(|mesh| kept_mesh::read(mesh, faces, format))?;
        let (labels, clusters) = match from {
            Source::Labels(blob, clusters) => {
                let head = length.saturating_sub(4 * faces);
                let numbers = blob.read(|rows| labels::read(rows, head, faces))?;
                labels::check(numbers.iter().copied(), clusters, &files, job, source)?;
                (numbers, clusters)
            }
            Source::Cut(hierarchy, clusters) => {
                let cut = stored::cut(hierarchy, length, u64::MAX, clusters);
                let (_, cut) = cut.map_err(|error| super::hierarchy::of_cut(&files, job, error))?;
                (cut.labels, clusters)
            }
        };
        let labels = Labels::new(clusters, &labels);
        let content = Content { labels: Some(labels), mesh: Some(&mesh), choices, ..Content::default() };
        (form.encode)(&content)?(out).map_err(encoded::cannot)
    };
    Ok(encoded(shared, Some(turn), form.media_type, write).await?.0)
}

/// Refuses outputs that are made of something else than the job was on.
pub(crate) fn check_input(job: &Job, artifact: &Artifact, form: &Form) -> Result<()> {
    match job.spec.format.lacks(artifact) {
        Some(what) => Err(Error::new(Kind::Conflict, format_args!("{} is made of {what}", form.file))),
        None => Ok(()),
    }
}

/// The error of an output that is not stored and cannot be made.
pub(crate) fn not_made(job: &Job, form: &Form) -> Error {
    if job.spec.format.is_of_points() {
        return Error::new(
            Kind::MeshNotKept,
            format_args!("it was not made of the points: submit them again with outputs={}", form.file),
        );
    }
    Error::new(
        Kind::MeshNotKept,
        format_args!(
            "the mesh of this job was not kept: submit it again with keep_mesh=true, which keeps it with the result, \
             or name what to make of it with outputs={}",
            form.file
        ),
    )
}
