//! The stages of one job.

use std::iter;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use parking_lot::Mutex;
use tesserae_mesh::artifacts::{self, Content};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::{Clustering, Outcome, Prepared, milliseconds};
use tesserae_mesh::report::Input;
use tokio_util::sync::CancellationToken;
use tracing::Span;

use super::bounds::{AGAIN, caught};
use super::memory::{Reading, Slot};
use super::opening::{Admits, Contents, open, open_with};
use super::parts::Pipeline;
use super::patience::Patience;
use super::rows::{Inbox, Log};
use super::task::Task;
use crate::blobs::Blob;
use crate::files::{self, BlobWriter, settle};
use crate::files::{job_blobs, kept_mesh};
use crate::ops::blocking::blocking;
use crate::store::kept::Kept;
use crate::store::live;
use crate::store::{Job, SmallBlob, Summary, Ticket};

impl Pipeline {
    /// From the upload to labels, in memory. May be dropped in the middle; `broken_off` then stops what still waits.
    pub(super) async fn cluster(
        &self,
        slot: &Slot,
        ticket: Ticket,
        job: &Job,
        cancel: &Cancel,
        log: &Arc<Log>,
        broken_off: CancellationToken,
    ) -> Result<Outcome> {
        let mut prepared = self.prepare(ticket, job, slot.clone(), broken_off).await?;
        // the labels of divided faces are not those of the mesh, nor those of some points those of all
        let are_all = prepared.subject.points().is_none_or(|points| points.members.len() == points.members.items());
        if prepared.input.items() <= live::MOST_FACES && prepared.origin.is_none() && are_all {
            prepared.viewer = Some(Arc::new(self.live.job(job.id)));
        }
        Span::current().record("faces", prepared.input.items());
        if job.spec.parameters.clusters.is_none() {
            Span::current().record("clusters", prepared.spec.clustering.clusters());
        }

        let cost = cost(prepared.subject.items() as u64, &prepared.spec.clustering);
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
        let telling = tokio::spawn(inbox.tell(self.store.clone(), ticket, Arc::clone(log)));
        let outcome = self.device.run(task, &self.small, self.time).await?;
        telling.await.map_err(|error| {
            Error::new(Kind::Internal, format_args!("the events of the job were not written: {error}"))
        })??;
        Ok(outcome)
    }

    /// From labels to files, or to blobs where all of the result is small. They mean nothing until the job has ended
    /// with them. Must not be dropped in the middle: it would go on, and leave files of no job.
    pub(super) async fn write(
        &self,
        slot: &Slot,
        job: &Job,
        outcome: &Arc<Mutex<Outcome>>,
        started: Instant,
    ) -> Result<(Summary, Vec<SmallBlob>)> {
        let image = match job.spec.kept.mesh && job.spec.format.is_image() {
            true => Some(self.open_file(job, files::MESH).await?.bytes().await?),
            false => None,
        };
        let (files, slot, outcome) = (Arc::clone(&self.files), slot.clone(), Arc::clone(outcome));
        let (id, attempt, kept) = (job.id, job.attempt, job.spec.kept.clone());
        let (mut summary, blobs) = blocking(move || {
            let (_slot, outcome) = (slot, &mut *outcome.lock());
            let blob = |name: &str| files.result(id, attempt, name);
            caught(|| write(outcome, &kept, image.as_deref(), blob, started))
        })
        .await??;
        let small = settle(blobs).await?;
        summary.is_small = !small.is_empty();
        Ok((summary, small))
    }

    /// Reads the files of an upload, when there is memory for them; gives the time in milliseconds, too. The wait for
    /// memory is no failure.
    async fn read(&self, ticket: Ticket, job: &Job) -> Result<(Reading, Contents, f64)> {
        let spec = &job.spec;
        let mut patience = Patience::new(&self.files, self.patience);
        let uploads = loop {
            match self.open(job).await {
                Ok(uploads) => break uploads,
                Err(error) => patience.wait(error).await?,
            }
        };
        drop(patience);
        // a buffer is there twice while the mesh is read: as it was sent, and as the reader has it
        let bytes = uploads.iter().enumerate().map(|(at, upload)| upload.length() * if at > 0 { 2 } else { 1 }).sum();
        let memory = self.memory.read(bytes).await?;
        let mut patience = Patience::new(&self.files, self.patience);
        // a small upload began with its claim
        while !spec.is_small
            && let Err(error) = self.store.begin(ticket).await
        {
            // a database that is away is waited for, room for its row no longer than for a file
            match error.kind {
                Kind::Unavailable => tokio::time::sleep(AGAIN).await,
                _ => patience.wait(error).await?,
            }
        }
        self.faults.abort_at(spec.file_name.as_deref());
        let reading = Instant::now();
        let mut opened = Some(uploads);
        let contents = loop {
            match self.contents(job, opened.take()).await {
                Ok(read) => break read,
                Err(error) => patience.wait(error).await?,
            }
        };
        Ok((memory, contents, milliseconds(reading.elapsed())))
    }

    /// Reads the mesh and its buffers, opened again where they were not, then what came beside them.
    async fn contents(&self, job: &Job, opened: Option<Vec<Blob>>) -> Result<Contents> {
        let uploads = match opened {
            Some(uploads) => uploads,
            None => self.open(job).await?,
        };
        let mut mesh = Vec::new();
        for upload in uploads {
            mesh.push(upload.bytes().await.map_err(upload_is_gone)?);
        }
        let beside = async |name: &str, is_there: bool| match is_there {
            true => self.open_file(job, name).await?.bytes().await.map(Some),
            false => Ok(None),
        };
        let seeds = beside(files::SEEDS, job.spec.listed_seeds).await?;
        let weights = beside(files::WEIGHTS, job.spec.has_weights).await?;
        Ok(Contents { mesh, seeds, weights, graph: beside(files::GRAPH, job.spec.has_graph).await? })
    }

    async fn open(&self, job: &Job) -> Result<Vec<Blob>> {
        let mut uploads = Vec::new();
        for name in iter::once(files::MESH.to_owned()).chain((0..job.spec.buffers.len()).map(files::buffer)) {
            uploads.push(self.open_file(job, &name).await?);
        }
        Ok(uploads)
    }

    async fn open_file(&self, job: &Job, name: &str) -> Result<Blob> {
        job_blobs::upload(&self.files, self.store.as_ref(), job, name, None).await.map_err(upload_is_gone)
    }

    /// Reads the mesh, when there is memory for it: a small one on a thread for small meshes, others on all threads.
    /// A file that is small and has too many faces is opened twice.
    async fn prepare(&self, ticket: Ticket, job: &Job, slot: Slot, broken_off: CancellationToken) -> Result<Prepared> {
        let (memory, contents, milliseconds) = self.read(ticket, job).await?;
        let (spec, limits) = (job.spec.clone(), self.limits);
        let span = tracing::info_span!("read");
        let open = move |admits: &mut Admits<'_>| span.in_scope(|| open(&spec, &contents, limits, admits));
        let (open, memory, prepared) = match memory.may_be_small() {
            true => {
                let slot = slot.clone();
                let work = move || open_with(open, memory, None, &slot);
                self.small.thread().await?.run(work).await?
            }
            false => (open, Some(memory), None),
        };
        let mut prepared = match (prepared, memory) {
            (None, Some(memory)) => {
                blocking(move || caught(|| open_with(open, memory, Some(&broken_off), &slot))).await??.2
            }
            (prepared, _) => prepared,
        }
        .ok_or_else(|| Error::new(Kind::Internal, "a mesh was not read"))?;
        prepared.timings.read = milliseconds;
        Ok(prepared)
    }
}

/// About how much work a job is, to tell short ones from long ones: faces, times what hierarchies and sequential
/// algorithms take longer (the order of magnitude; measured on 20,000 to 1,000,000 faces).
fn cost(faces: u64, clustering: &Clustering) -> u64 {
    let factor = match clustering {
        clustering if clustering.is_sequential() => 16,
        clustering if clustering.is_hierarchical() => 4,
        _ => 1,
    };
    faces.saturating_mul(factor)
}

/// The error of an upload that cannot be read: it belongs to a job, so it must be there.
fn upload_is_gone(error: Error) -> Error {
    match error.kind {
        Kind::NotFound => Error::new(Kind::Io, "the upload of the job is gone from the data folder"),
        _ => error,
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
    let contents = blobs.iter().map(BlobWriter::contents).collect();
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
        blobs: contents,
    };
    Ok((summary, blobs))
}
