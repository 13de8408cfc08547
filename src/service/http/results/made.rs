//! Results that are made on request, from what is stored and without clustering again: labels in other forms, of an
//! iteration or of a cut; hierarchies; and what is made of a kept mesh or image and labels.
//!
//! The source is in memory only while a result is made, and a semaphore limits how many large ones are at a time. The
//! result streams to the client at the client's pace; a large one streams from a file without a name.

use std::io::{self, BufWriter, Read, Seek, Write};
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::response::{IntoResponse as _, IntoResponseParts, Response};
use object_store::GetRange;
use tempfile::{SpooledData, spooled_tempfile_in};
use tesserae_mesh::artifacts::{
    Choices, Content, Form, HIERARCHY_TSR, LABELS_NPY, Labels, SNAPSHOTS_JSON, SNAPSHOTS_NPY,
};
use tesserae_mesh::data::Format as PointsFormat;
use tesserae_mesh::data::image;
use tesserae_mesh::device::FREE;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::hierarchy::json::Limits;
use tesserae_mesh::hierarchy::stored::{self, Stored};
use tesserae_mesh::job::{InputFormat, PointsRequest, table_of_points};
use tesserae_mesh::mesh::Format;
use tokio::sync::OwnedSemaphorePermit;
use tokio_util::io::ReaderStream;

use super::DoneJob;
use super::checked::{self, Checked, HELD};
use super::stored::with_length;
use crate::files::kept_mesh;
use crate::http::state::Shared;
use crate::ops::blocking;
use crate::work::pipeline::Needed;

#[derive(Debug, Clone, Copy)]
pub(crate) enum WhichLabels {
    /// Those that it made.
    Last,
    /// Those after this iteration of a flat clustering.
    After(u32),
    /// Those of a hierarchy at this number of clusters.
    Cut(u64),
}

/// Reads labels, on a thread that may block.
type Load = Box<dyn FnOnce() -> Result<Loaded> + Send>;

struct Loaded {
    labels: Vec<u32>,
    clusters: u64,
    /// Of a cut, its kind and energy.
    cut: Option<(&'static str, f64)>,
}

impl Loaded {
    pub fn view(&self) -> Labels<'_> {
        let (cut, energy) = self.cut.unzip();
        Labels { clusters: self.clusters, cut, energy, labels: &self.labels }
    }
}

/// What labels belong to.
enum Source {
    Mesh(Checked, Format),
    Image(Bytes, PointsFormat),
}

/// The right to have a large result in memory; the semaphore is never closed.
async fn turn(shared: &Shared) -> Option<OwnedSemaphorePermit> {
    Arc::clone(&shared.encoding).acquire_owned().await.ok()
}

/// Labels in a form that is made of them, with headers that say what a cut is.
pub(crate) async fn labels(done: &Arc<DoneJob>, which: WhichLabels, form: &'static Form) -> Result<Response> {
    // few labels wait for no turn
    let is_small = done.summary.faces <= 1 << 16 && !matches!(which, WhichLabels::Cut(_));
    let turn = if is_small { None } else { turn(&done.shared).await };
    let load = load(done, which).await?;
    let shape = done.summary.shape();
    let write = move |out: &mut dyn Write| {
        let loaded = load()?;
        let shape = Some(&shape[..]).filter(|shape| !shape.is_empty());
        (form.encode)(&Content { labels: Some(loaded.view()), shape, ..Content::default() })?(out).map_err(cannot)?;
        let headers = |(cut, energy)| [("tesserae-cut", String::from(cut)), ("tesserae-energy", format!("{energy:e}"))];
        Ok(loaded.cut.map(headers))
    };
    encoded(&done.shared, turn, form.media_type, write).await
}

/// The hierarchy in a form that is made of it.
pub(crate) async fn hierarchy(done: &Arc<DoneJob>, form: &'static Form, limits: Limits) -> Result<Response> {
    let turn = turn(&done.shared).await;
    let blob = checked::open(done, HIERARCHY_TSR.file).await?;
    let (length, from, of) = (blob.length(), blob.into_hierarchy(), Arc::clone(done));
    let write = move |out: &mut dyn Write| {
        let tree = Stored::read(from, length, u64::MAX).map_err(|error| of_stored(&of, error))?;
        let check = limits.clusters.map_or(Ok(()), |clusters| tree.tree.check_cut(clusters));
        check.map_err(|error| of_cut(&of, error))?;
        (form.encode)(&Content { hierarchy: Some(&tree), limits, ..Content::default() })?(out).map_err(cannot)
    };
    encoded(&done.shared, turn, form.media_type, write).await
}

/// An output of a job whose mesh or image was kept, of its labels or of those at a number of clusters.
pub(crate) async fn of_input(
    done: &Arc<DoneJob>,
    clusters: Option<u64>,
    choices: Choices,
    form: &'static Form,
) -> Result<Response> {
    let (format, faces) = (done.job.spec.format, done.summary.faces);
    let name = if format.is_of_points() { kept_mesh::IMAGE } else { kept_mesh::NAME };
    let kept = checked::open(done, name).await?;
    // what is in memory meanwhile counts like the mesh or the image of a job
    let memory = done.shared.memory.read(kept.length()).await?;
    let (kept, memory) = match format {
        InputFormat::Mesh(format) => (Source::Mesh(kept, format), memory.build(Needed::of_faces(faces, None)).await?),
        InputFormat::Points(format) => {
            let bytes = kept.bytes().await?;
            let size = of_image(done, &bytes, format).size().map_err(|refusal| refusal.error)?;
            (Source::Image(bytes, format), memory.build(Needed::of_points(size, false)).await?)
        }
    };
    // after the memory, which jobs may hold for long: other results need no more than a turn
    let turn = turn(&done.shared).await;
    let load = load(done, clusters.map_or(WhichLabels::Last, WhichLabels::Cut)).await?;
    let of = Arc::clone(done);
    let write = move |out: &mut dyn Write| {
        let _memory = memory;
        let loaded = load()?;
        let labels = loaded.view();
        let content = Content { labels: Some(labels), choices, ..Content::default() };
        match kept {
            Source::Mesh(mesh, format) => {
                let mesh = mesh.read(|mesh| kept_mesh::read(mesh, faces, format))?;
                (form.encode)(&Content { mesh: Some(&mesh), ..content })?(out)
            }
            Source::Image(bytes, format) => {
                let table = table_of_points(&of_image(&of, &bytes, format), labels.labels, labels.clusters);
                let table = table.map_err(|refusal| refusal.error)?;
                let compactness = Some(image::compactness(of.job.spec.parameters.compactness));
                let shape = of.summary.shape();
                (form.encode)(&Content { points: Some(&table), compactness, shape: Some(&shape), ..content })?(out)
            }
        }
        .map_err(cannot)
    };
    encoded(&done.shared, turn, form.media_type, write).await
}

fn of_image<'a>(done: &'a DoneJob, bytes: &'a [u8], format: PointsFormat) -> PointsRequest<'a> {
    let (limits, parameters) = (done.shared.settings.limits(), &done.job.spec.parameters);
    PointsRequest { bytes, format, limits, parameters, graph: None, seeds: None, weights: None, outputs: &[] }
}

/// Opens what labels are read from.
async fn load(done: &Arc<DoneJob>, which: WhichLabels) -> Result<Load> {
    let (of, faces) = (Arc::clone(done), done.summary.faces);
    Ok(match which {
        WhichLabels::Last => {
            let blob = checked::open(done, LABELS_NPY.file).await?;
            let head = blob.length().saturating_sub(4 * faces);
            Box::new(move || read(&of, LABELS_NPY.file, blob.read(|rows| numbers(rows, head, faces))?))
        }
        WhichLabels::After(iteration) => {
            let kept = iterations(done).await?;
            let row = kept.iter().position(|&kept| kept == iteration).ok_or_else(|| none_of(&kept, iteration))?;
            let range = GetRange::Suffix(4 * faces * (kept.len() - row) as u64);
            let mut rows = checked::part(done, SNAPSHOTS_NPY.file, range).await?.into_reader();
            Box::new(move || read(&of, SNAPSHOTS_NPY.file, numbers(&mut rows, 0, faces)?))
        }
        WhichLabels::Cut(clusters) => {
            let blob = checked::open(done, HIERARCHY_TSR.file).await?;
            let (length, from) = (blob.length(), blob.into_hierarchy());
            Box::new(move || {
                let (_, cut) = stored::cut(from, length, u64::MAX, clusters).map_err(|error| of_cut(&of, error))?;
                Ok(Loaded { clusters, cut: Some((cut.kind(), cut.energy)), labels: cut.labels })
            })
        }
    })
}

/// Labels that were read from a blob. Refuses those that are no clusters.
fn read(done: &DoneJob, blob: &str, labels: Vec<u32>) -> Result<Loaded> {
    let clusters = done.summary.clusters;
    // a mask leaves points out
    let is_free = |label| label == FREE && done.job.spec.format.is_of_points();
    match labels.iter().find(|&&label| u64::from(label) >= clusters && !is_free(label)) {
        Some(label) => Err(done.damaged(blob, format_args!("a label is {label}, of {clusters} clusters"))),
        None => Ok(Loaded { labels, clusters, cut: None }),
    }
}

/// A number a face, behind a head of some bytes.
fn numbers(rows: &mut impl Read, head: u64, faces: u64) -> Result<Vec<u32>> {
    let mut bytes = vec![0; 4 * faces as usize];
    io::copy(&mut rows.take(head), &mut io::sink())
        .and_then(|_| rows.read_exact(&mut bytes))
        .map_err(|error| Error::internal(format_args!("the labels cannot be read: {error}")))?;
    Ok(bytes.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect())
}

/// The iterations whose labels were kept: a row each.
async fn iterations(done: &Arc<DoneJob>) -> Result<Vec<u32>> {
    let json = match checked::open(done, SNAPSHOTS_JSON.file).await {
        Ok(list) => list.bytes().await?,
        Err(error) if error.kind == Kind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    serde_json::from_slice(&json)
        .map_err(|error| Error::internal(format_args!("the list of snapshots is damaged: {error}")))
}

/// The error for an iteration that is not among those that were kept.
fn none_of(kept: &[u32], iteration: u32) -> Error {
    let list: Vec<String> = kept.iter().take(100).map(u32::to_string).collect();
    Error::not_found(match list.is_empty() {
        true => format!(
            "this job kept the labels of no iteration: ask for them with the parameter snapshots; there are none of \
             {iteration}"
        ),
        false => format!("this job kept the labels of iterations {}, not of {iteration}", list.join(", ")),
    })
}

/// The error of a number of clusters that a stored hierarchy cannot be cut at, for clients.
fn of_cut(done: &DoneJob, error: Error) -> Error {
    match error.kind {
        // the number is sound, this hierarchy has no such state
        Kind::InvalidParameter => Error::conflict(error.message),
        _ => of_stored(done, error),
    }
}

/// The error of a stored hierarchy that cannot be read: this service wrote it.
fn of_stored(done: &DoneJob, error: Error) -> Error {
    match error.kind {
        // what keeps it failed in the middle
        Kind::Io => Error::unavailable(error.message),
        _ => done.damaged(HIERARCHY_TSR.file, error.message),
    }
}

/// What `write` makes, on a thread that may block, with the headers that it returns. Small results need no turn.
async fn encoded<H: IntoResponseParts + Send + 'static>(
    shared: &Shared,
    turn: Option<OwnedSemaphorePermit>,
    media_type: &'static str,
    write: impl FnOnce(&mut dyn Write) -> Result<H> + Send + 'static,
) -> Result<Response> {
    let folder = shared.files.scratch();
    let (headers, length, body) = blocking(move || {
        let _turn = turn;
        let mut out = BufWriter::with_capacity(1 << 16, spooled_tempfile_in(HELD, folder));
        let headers = write(&mut out)?;
        let mut file = out.into_inner().map_err(|error| cannot(error.into_error()))?;
        let length = file.stream_position().map_err(cannot)?;
        file.rewind().map_err(cannot)?;
        let body = match file.into_inner() {
            SpooledData::InMemory(bytes) => Body::from(bytes.into_inner()),
            SpooledData::OnDisk(file) => {
                Body::from_stream(ReaderStream::with_capacity(tokio::fs::File::from_std(file), 1 << 16))
            }
        };
        Ok::<_, Error>((headers, length, body))
    })
    .await??;
    Ok((headers, with_length(length, body, media_type)).into_response())
}

fn cannot(error: io::Error) -> Error {
    Error::storage("the result cannot be written", error)
}
