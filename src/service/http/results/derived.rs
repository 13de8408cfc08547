//! What is made of a kept mesh or image and labels on request.

use std::io::Write;
use std::sync::Arc;

use axum::body::Bytes;
use axum::response::Response;
use tesserae_mesh::artifacts::{Choices, Content, Form, HIERARCHY_TSR, LABELS, LABELS_NPY, Labels, Need};
use tesserae_mesh::data::Format as PointsFormat;
use tesserae_mesh::data::image;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::hierarchy::stored::{self, Input};
use tesserae_mesh::job::{InputFormat, PointsRequest, table_of_points};
use tesserae_mesh::mesh::{Format, Limits};
use tesserae_mesh::parameters::Parameters;

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

/// What labels belong to.
enum Of {
    Mesh(CheckedReader, Format),
    Image(Bytes, PointsFormat),
}

/// An output of a job whose mesh or image was kept, of its labels or of those at a number of clusters.
pub(crate) async fn made(
    shared: &Shared,
    job: &Job,
    summary: &Summary,
    clusters: Option<u64>,
    choices: Choices,
    form: &'static Form,
) -> Result<Response> {
    let kept = match job.spec.format {
        InputFormat::Mesh(_) => kept_mesh::NAME,
        InputFormat::Points(_) => kept_mesh::IMAGE,
    };
    let kept = checked::open(shared, job, kept).await?;
    let faces = summary.faces;
    // what is in memory meanwhile counts like the mesh or the image of a job
    let memory = shared.memory.read(kept.length()).await?;
    let (kept, memory) = match job.spec.format {
        InputFormat::Mesh(format) => {
            (Of::Mesh(kept.into_reader(), format), memory.build(Needed::of_faces(faces, None)).await?)
        }
        InputFormat::Points(format) => {
            let bytes = kept.bytes().await?;
            let parameters = &job.spec.parameters;
            let size = of_image(&bytes, format, shared.settings.limits(), parameters).size();
            let size = size.map_err(|refusal| refusal.error)?;
            (Of::Image(bytes, format), memory.build(Needed::of_points(size, false)).await?)
        }
    };
    // after the memory, which jobs may hold for long: other results need no more than a turn
    let turn = encoded::turn(shared).await?;
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
    let (files, limits, shape) = (Arc::clone(&shared.files), shared.settings.limits(), summary.shape());
    let (parameters, job) = (job.spec.parameters.clone(), job.id);
    let write = move |out: &mut dyn Write| {
        let _memory = memory;
        let (labels, clusters) = match from {
            Source::Labels(blob, clusters) => {
                let head = length.saturating_sub(4 * faces);
                let numbers = blob.read(|rows| labels::read(rows, head, faces))?;
                labels::check(&numbers, matches!(kept, Of::Image(..)), clusters, &files, job, source)?;
                (numbers, clusters)
            }
            Source::Cut(hierarchy, clusters) => {
                let cut = stored::cut(hierarchy, length, u64::MAX, clusters);
                let (_, cut) = cut.map_err(|error| super::hierarchy::of_cut(&files, job, error))?;
                (cut.labels, clusters)
            }
        };
        let labels = Labels::new(clusters, &labels);
        let content = Content { labels: Some(labels), choices, ..Content::default() };
        match kept {
            Of::Mesh(mesh, format) => {
                let mesh = mesh.read(|mesh| kept_mesh::read(mesh, faces, format))?;
                (form.encode)(&Content { mesh: Some(&mesh), ..content })?(out)
            }
            Of::Image(bytes, format) => {
                let table = table_of_points(&of_image(&bytes, format, limits, &parameters), labels.labels, clusters);
                let table = table.map_err(|refusal| refusal.error)?;
                let compactness = Some(image::compactness(parameters.compactness));
                let shape = Some(&shape[..]);
                (form.encode)(&Content { points: Some(&table), compactness, shape, ..content })?(out)
            }
        }
        .map_err(encoded::cannot)
    };
    Ok(encoded(shared, Some(turn), form.media_type, write).await?.0)
}

fn of_image<'a>(
    bytes: &'a [u8],
    format: PointsFormat,
    limits: Limits,
    parameters: &'a Parameters,
) -> PointsRequest<'a> {
    PointsRequest { bytes, format, limits, parameters, graph: None, seeds: None, weights: None, outputs: &[] }
}

pub(crate) fn not_made(job: &Job, form: &Form) -> Error {
    let (format, is_whole) = (job.spec.format, LABELS.lacks(&job.spec.parameters) == Some(Need::Labels));
    if format.is_of_points() {
        let with = match (format.is_image(), is_whole) {
            (true, true) => "keep_mesh=true, which keeps the image".to_owned(),
            (true, false) => format!("keep_mesh=true, which keeps the image, or outputs={}", form.file),
            (false, true) => format!("clusters and outputs={}: a whole hierarchy has no labels of its own", form.file),
            (false, false) => format!("outputs={}", form.file),
        };
        return Error::new(
            Kind::MeshNotKept,
            format_args!("it was not made of the points: submit them again with {with}"),
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
