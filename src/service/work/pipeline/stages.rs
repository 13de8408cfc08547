//! The stages of one job: its files are read, opened once there is memory for what they hold, clustered, and written.

use std::collections::HashMap;
use std::iter;
use std::pin::pin;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use axum::body::Bytes;
use parking_lot::Mutex;
use tesserae_mesh::artifacts::{self, Artifact, Content};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::{self, InputFile, InputFormat, Outcome, PointsRequest, Prepared, Refusal, milliseconds};
use tesserae_mesh::mesh::{Limits, Resources};
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::report::Input;
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;
use tracing::Span;

use super::bounds::{AGAIN, Patience, caught};
use super::device_thread::Task;
use super::memory::{Needed, Reading, Slot};
use super::rows::Inbox;
use super::run::{Attempt, Pipeline, Verdict, judge};
use crate::blobs::Blob;
use crate::files::{self, BlobWriter, job_blobs, kept_mesh, settle};
use crate::ops::blocking;
use crate::store::kept::Kept;
use crate::store::{End, Ending, Spec, Summary, live};

/// What the files of an upload hold.
struct Contents {
    /// The mesh, then its buffers; or the points.
    mesh: Vec<Bytes>,
    seeds: Option<Bytes>,
    weights: Option<Bytes>,
    graph: Option<Bytes>,
}

impl Attempt {
    /// From the upload to labels, in memory. May be dropped in the middle; `broken_off` then stops what still waits.
    pub(super) async fn cluster(&self, slot: &Slot, cancel: &Cancel, broken_off: CancellationToken) -> Result<Outcome> {
        let Self { pipeline, ticket, job, .. } = self;
        let mut prepared = self.prepare(slot.clone(), broken_off).await?;
        // the labels of divided faces are not those of the mesh, nor those of some points those of all
        let are_all = prepared.subject.points().is_none_or(|points| points.members.len() == points.members.items());
        if prepared.input.items() <= live::MOST_FACES && prepared.origin.is_none() && are_all {
            prepared.viewer = Some(Arc::new(pipeline.live.job(job.id)));
        }
        Span::current().record("faces", prepared.input.items());
        if job.spec.parameters.clusters.is_none() {
            Span::current().record("clusters", prepared.spec.clustering.clusters());
        }

        // the order of magnitude; measured on 20,000 to 1,000,000 faces
        let factor = match &prepared.spec.clustering {
            clustering if clustering.is_sequential() => 16,
            clustering if clustering.is_hierarchical() => 4,
            _ => 1,
        };
        let cost = factor * prepared.subject.items() as u64;
        let (on_row, inbox) = Inbox::open();
        let task = Task {
            prepared: Arc::new(prepared),
            cancel: cancel.clone(),
            cost,
            is_retry: ticket.attempt > 1,
            on_row,
            span: tracing::info_span!("cluster"),
            slot: slot.clone(),
        };
        let telling = tokio::spawn(inbox.tell(pipeline.store.clone(), *ticket, Arc::clone(&self.log)));
        let outcome = pipeline.device.run(task, pipeline.time).await?;
        telling
            .await
            .map_err(|error| Error::internal(format_args!("the events of the job were not written: {error}")))??;
        Ok(outcome)
    }

    /// From labels to files, or to blobs where all of the result is small. They mean nothing until the job has ended
    /// with them. Goes on until that works, takes too long, or is broken off between two attempts: one that was dropped
    /// in the middle would go on, and leave files of no job.
    pub(super) async fn write(&self, slot: Slot, outcome: Outcome) -> Verdict {
        let Self { pipeline, job, started, .. } = self;
        let outcome = Arc::new(Mutex::new(outcome));
        let written = async || {
            let keeps_image = job.spec.kept.mesh && job.spec.format.is_image();
            let image = if keeps_image { Some(self.open_file(files::MESH).await?.bytes().await?) } else { None };
            let (files, slot, outcome) = (Arc::clone(&pipeline.files), slot.clone(), Arc::clone(&outcome));
            let (id, attempt, kept, started) = (job.id, job.attempt, job.spec.kept.clone(), *started);
            let work = move || {
                let (_slot, outcome) = (slot, &mut *outcome.lock());
                let blob = |name: &str| files.result(id, attempt, name);
                caught(|| write(outcome, &kept, image.as_deref(), blob, started))
            };
            let (mut summary, blobs) = blocking(work).await??;
            let result = settle(blobs).await?;
            summary.is_small = !result.is_empty();
            Ok(Ending { end: End::Succeeded(summary), rest: None, result })
        };
        let mut patience = Patience::new(&pipeline.files, pipeline.patience);
        let mut broken_off = pin!(self.broken_off());
        loop {
            let error = match written().await {
                Ok(ending) => return Verdict::Ended(ending),
                Err(error) => error,
            };
            tokio::select! {
                biased;
                verdict = &mut broken_off => return verdict,
                waited = patience.wait(error) => if let Err(error) = waited { return judge(error) },
            }
        }
    }

    /// Reads the files of an upload, when there is memory for them; gives the time in milliseconds, too.
    async fn read(&self) -> Result<(Reading, Contents, f64)> {
        let Self { pipeline, job, .. } = self;
        let Pipeline { store, files, .. } = &**pipeline;
        let mut patience = Patience::new(files, pipeline.patience);
        let uploads = patience.repeat(|| self.open()).await?;
        drop(patience);
        // a buffer is there twice while the mesh is read: as it was sent, and as the reader has it
        let bytes = uploads.iter().enumerate().map(|(at, upload)| upload.length() * if at > 0 { 2 } else { 1 }).sum();
        let memory = pipeline.memory.read(bytes).await?;
        let mut patience = Patience::new(files, pipeline.patience);
        // a small upload began with its claim
        while !job.spec.is_small
            && let Err(error) = store.begin(self.ticket).await
        {
            // a database that is away is waited for, room for its row no longer than for a file
            match error.kind {
                Kind::Unavailable => tokio::time::sleep(AGAIN).await,
                _ => patience.wait(error).await?,
            }
        }
        files.faults.abort_at(job.spec.file_name.as_deref());
        let reading = Instant::now();
        let beside = async |name: &str, is_there: bool| {
            if is_there { self.open_file(name).await?.bytes().await.map(Some) } else { Ok(None) }
        };
        // the mesh and its buffers, opened again where they were not, then what came beside them
        let read = async |opened: Option<Vec<Blob>>| {
            let uploads = if let Some(uploads) = opened { uploads } else { self.open().await? };
            let mut mesh = Vec::new();
            for upload in uploads {
                mesh.push(upload.bytes().await.map_err(upload_is_gone)?);
            }
            let seeds = beside(files::SEEDS, job.spec.listed_seeds).await?;
            let weights = beside(files::WEIGHTS, job.spec.has_weights).await?;
            Ok(Contents { mesh, seeds, weights, graph: beside(files::GRAPH, job.spec.has_graph).await? })
        };
        let mut opened = Some(uploads);
        let contents = patience.repeat(|| read(opened.take())).await?;
        Ok((memory, contents, milliseconds(reading.elapsed())))
    }

    async fn open(&self) -> Result<Vec<Blob>> {
        let mut uploads = Vec::new();
        for name in iter::once(files::MESH.to_owned()).chain((0..self.job.spec.buffers.len()).map(files::buffer)) {
            uploads.push(self.open_file(&name).await?);
        }
        Ok(uploads)
    }

    async fn open_file(&self, name: &str) -> Result<Blob> {
        let Pipeline { store, files, .. } = &*self.pipeline;
        job_blobs::upload(files, store, &self.job, name, None).await.map_err(upload_is_gone)
    }

    /// Reads the mesh: a small one on a thread for small meshes, others on all threads, once there is memory for it. A
    /// small file with too many faces is opened twice: a job that holds the memory may wait for such a thread.
    async fn prepare(&self, slot: Slot, broken_off: CancellationToken) -> Result<Prepared> {
        let (mut memory, contents, milliseconds) = self.read().await?;
        let (spec, limits, span) = (self.job.spec.clone(), self.pipeline.limits, tracing::info_span!("read"));
        let files = Arc::new((spec, contents, span));
        let mut prepared = None;
        if memory.may_be_small() {
            // held by the thread, which goes on when this is dropped
            let (files, held) = (Arc::clone(&files), slot.clone());
            let work = move || {
                let (_slot, (spec, contents, span)) = (held, &*files);
                let mut is_small = true;
                let admits = |need: Needed| {
                    is_small = need.is_small();
                    is_small.then_some(()).ok_or_else(Error::cancelled)
                };
                match span.in_scope(|| open(spec, contents, limits, admits)) {
                    Err(_) if !is_small => Ok((None, memory)),
                    opened => Ok((Some(opened?), memory)),
                }
            };
            (prepared, memory) = self.pipeline.device.small.run(None, work).await?;
        }
        let mut prepared = match prepared {
            Some(prepared) => {
                slot.holds(memory.held);
                prepared
            }
            None => {
                let work = move || {
                    let (spec, contents, span) = &*files;
                    let admits = |need| {
                        let built = Handle::current().block_on(broken_off.run_until_cancelled(memory.build(need)));
                        slot.holds(built.unwrap_or_else(|| Err(Error::cancelled()))?);
                        Ok(())
                    };
                    caught(|| span.in_scope(|| open(spec, contents, limits, admits)))
                };
                blocking(work).await??
            }
        };
        prepared.timings.read = milliseconds;
        Ok(prepared)
    }
}

/// The error of an upload that cannot be read: it belongs to a job, so it must be there.
fn upload_is_gone(error: Error) -> Error {
    match error.kind {
        Kind::NotFound => Error::new(Kind::Io, "the upload of the job is gone from the data folder"),
        _ => error,
    }
}

/// Reads the mesh or the points of a job, once `admits` got memory for them.
fn open(
    spec: &Spec,
    contents: &Contents,
    limits: Limits,
    admits: impl FnOnce(Needed) -> Result<()>,
) -> Result<Prepared> {
    let Contents { mesh, seeds, weights, graph } = contents;
    let [seeds, weights, graph] = [seeds, weights, graph].map(Option::as_deref);
    let (bytes, buffers) = mesh.split_first().map_or((&[][..], &[][..]), |(mesh, buffers)| (&mesh[..], buffers));
    let parameters = &spec.parameters;
    let outputs: Vec<&Artifact> = spec.kept.artifacts(spec.format).collect();
    let outputs = &outputs[..];
    match spec.format {
        InputFormat::Mesh(format) => {
            let resources = &MeshBuffers(spec.buffers.iter().cloned().zip(buffers.iter().cloned()).collect());
            let request = job::Request { bytes, format, resources, limits, parameters, seeds, weights, outputs };
            let build = |opened: job::Opened<'_>| {
                admits(Needed::of_faces(opened.faces(), Some(&opened.spec().clustering)))?;
                opened.prepare().map_err(naming_part)
            };
            job::open(&request, build).map_err(naming_part).flatten()
        }
        InputFormat::Points(format) => {
            let request = PointsRequest { bytes, format, limits, parameters, graph, seeds, weights, outputs };
            let size = request.size().map_err(naming_part)?;
            let merges_items = parameters.algorithm.is_hierarchical() || parameters.seeds == Seeds::Merged;
            admits(Needed::of_points(size, merges_items))?;
            job::prepare_points(&request).map_err(naming_part)
        }
    }
}

/// The error of a refusal; it names the part that it is about, other than the mesh or the points.
fn naming_part(Refusal { file, error }: Refusal) -> Error {
    let part = match file {
        Some(InputFile::Seeds) => files::SEEDS,
        Some(InputFile::Weights) => files::WEIGHTS,
        Some(InputFile::Graph) => files::GRAPH,
        Some(InputFile::Mesh) | None => return error,
    };
    Error::new(error.kind, format_args!("the part {part}: {}", error.message))
}

/// The buffers that came with a mesh: the only files that it can refer to, by exactly their names.
struct MeshBuffers(HashMap<String, Bytes>);

impl Resources for MeshBuffers {
    fn load(&self, uri: &str, max_bytes: u64) -> Result<Vec<u8>> {
        let content = self.0.get(uri).ok_or_else(|| {
            Error::mesh(format_args!(
                "the mesh refers to a buffer that did not come with it (send it as a part named buffer with this file \
                 name): {uri:?}"
            ))
        })?;
        let bytes = content.len() as u64;
        let why = format_args!("a buffer has more bytes than the limit of {max_bytes}, {bytes}: {uri:?}");
        if bytes > max_bytes { Err(Error::too_large(why)) } else { Ok(content.to_vec()) }
    }
}

/// Writes the result of a job to blobs, which are still to be settled.
fn write(
    outcome: &mut Outcome,
    kept: &Kept,
    image: Option<&[u8]>,
    blob: impl Fn(&str) -> BlobWriter,
    started: Instant,
) -> Result<(Summary, Vec<BlobWriter>)> {
    let writing = Instant::now();
    let mut blobs = Vec::new();
    let mut warnings = Vec::new();
    let remesh = OnceLock::new();
    for form in kept.forms() {
        match (form.encode)(&Content { remesh: Some(&remesh), ..outcome.content() }) {
            Ok(encoding) => blobs.push(blob(form.file).fill(encoding)?),
            // the clustering is worth keeping without it
            Err(error) => warnings.push(format!("{} was not written: {}", form.file, error.message)),
        }
    }
    // there already where the writing is repeated
    warnings.retain(|warning| !outcome.report.warnings.contains(warning));
    outcome.report.warnings.extend(warnings);
    outcome.report.remesh = remesh.get().map(|remesh| remesh.summary);
    if let Some(mesh) = outcome.mesh.as_ref().filter(|_| kept.mesh) {
        blobs.push(blob(kept_mesh::NAME).fill(|out| kept_mesh::write(out, mesh))?);
    }
    if let Some(image) = image {
        blobs.push(blob(kept_mesh::IMAGE).fill(|out| out.write_all(image))?);
    }
    for form in artifacts::stored(&outcome.report.parameters) {
        // the report comes last, and has the times
        outcome.report.timings_ms.write = milliseconds(writing.elapsed());
        outcome.report.timings_ms.total = milliseconds(started.elapsed());
        let encoding = (form.encode)(&outcome.content())?;
        blobs.push(blob(form.file).fill(encoding)?);
    }
    let report = &outcome.report;
    let summary = Summary {
        faces: report.input.items(),
        clusters: report.clusters,
        shape: match &report.input {
            Input::Points(points) => points.shape.clone(),
            Input::Mesh(_) => Vec::new(),
        },
        labels_sha256: report.labels_sha256.clone(),
        is_small: false,
        blobs: blobs.iter().map(BlobWriter::contents).collect(),
    };
    Ok((summary, blobs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_gets_at_the_parts_by_their_names_and_at_nothing_else() {
        let contents = [("a/b c.bin", "first"), ("../x", "second")];
        let parts = MeshBuffers(contents.map(|(name, content)| (name.to_owned(), Bytes::from(content))).into());
        assert_eq!(parts.load("a/b c.bin", 5).as_deref(), Ok(&b"first"[..]));
        // a name is a name, whatever it looks like
        assert_eq!(parts.load("../x", 9).as_deref(), Ok(&b"second"[..]));
        assert_eq!(parts.load("a/b c.bin", 4).map_err(|error| error.kind), Err(Kind::TooLarge));
        for uri in ["buffer-0", "mesh", "/etc/passwd", "../buffer-0", "b c.bin", ""] {
            let error = parts.load(uri, 100).expect_err(uri);
            assert_eq!(error.kind, Kind::InvalidMesh);
        }
    }
}
