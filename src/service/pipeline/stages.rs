//! The stages of one job.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use tokio::sync::{OwnedSemaphorePermit, mpsc, oneshot};
use tracing::Span;

use super::device_thread::Task;
use super::{Pipeline, caught};
use crate::device::Cancel;
use crate::error::{Error, Kind, Result};
use crate::job::{self, Outcome, Prepared, milliseconds};
use crate::mesh::Resources;
use crate::output::{LabelFormat, write_labels, write_snapshots};
use crate::report::Row;
use crate::service::files::{self, blocking};
use crate::service::store::{Job, JobStore, Progress, Summary, Ticket, What};

/// The place of a mesh in memory, shared by all that works on it.
pub(super) type Slot = Arc<OwnedSemaphorePermit>;

/// Rows that are appended to the job's events at once.
const ROWS_AT_ONCE: usize = 1024;

impl Pipeline {
    /// From the upload to labels, in memory. May be dropped in the middle.
    pub(super) async fn cluster(&self, slot: &Slot, ticket: Ticket, job: &Job, cancel: &Cancel) -> Result<Outcome> {
        let prepared = self.prepare(job, Arc::clone(slot)).await?;
        Span::current().record("faces", prepared.input.faces);
        if job.spec.parameters.clusters.is_none() {
            Span::current().record("clusters", prepared.parameters.clusters);
        }

        let (rows, inbox) = mpsc::unbounded_channel();
        let (reply, outcome) = oneshot::channel();
        let task = Task {
            prepared,
            cancel: cancel.clone(),
            // Unbounded, so that the device never waits; the report holds the same rows anyway.
            on_row: Box::new(move |row| drop(rows.send(row))),
            span: tracing::info_span!("cluster"),
            reply,
            slot: Arc::clone(slot),
        };
        let store = Arc::clone(&self.store);
        let log = tokio::spawn(tell(store, ticket, inbox));
        self.device.submit(task).await?;
        let outcome = outcome.await;
        let told = log.await;
        let outcome = outcome.map_err(|_| Error::new(Kind::Internal, "the thread of the device is gone"))??;
        told.map_err(|error| {
            Error::new(Kind::Internal, format_args!("the events of the job were not written: {error}"))
        })??;
        Ok(outcome)
    }

    /// From labels to files. Must not be dropped in the middle: it would go on, and leave files that nobody knows of.
    pub(super) async fn write(&self, slot: Slot, job: &Job, outcome: Outcome, started: Instant) -> Result<Summary> {
        let folder = self.files.result(job.id);
        blocking(move || {
            let _slot = slot;
            caught(|| write(outcome, &folder, started))
        })
        .await?
    }

    /// Reads the mesh.
    async fn prepare(&self, job: &Job, slot: Slot) -> Result<Prepared> {
        let folder = self.files.upload(job.id);
        let spec = job.spec.clone();
        let limits = self.limits;
        let span = tracing::info_span!("read");
        blocking(move || {
            let _slot = slot;
            let _entered = span.enter();
            caught(|| {
                let reading = Instant::now();
                let bytes = read(&folder.join(files::MESH))?;
                let seeds = match spec.listed_seeds {
                    true => Some(read(&folder.join(files::SEEDS))?),
                    false => None,
                };
                let weights = match spec.has_weights {
                    true => Some(read(&folder.join(files::WEIGHTS))?),
                    false => None,
                };
                let read = reading.elapsed();
                let mut prepared = job::prepare(&job::Request {
                    bytes: &bytes,
                    format: spec.format,
                    resources: &Parts::new(&folder, &spec.buffers),
                    limits,
                    parameters: &spec.parameters,
                    seeds: seeds.as_deref(),
                    weights: weights.as_deref(),
                })?;
                prepared.timings.read = milliseconds(read);
                Ok(prepared)
            })
        })
        .await?
    }
}

/// Appends rows to the events of a job as they come, many at once when they come fast.
async fn tell(store: Arc<dyn JobStore>, ticket: Ticket, mut inbox: mpsc::UnboundedReceiver<Row>) -> Result<()> {
    let mut rows = Vec::new();
    let mut progress = Progress::default();
    while inbox.recv_many(&mut rows, ROWS_AT_ONCE).await > 0 {
        let events = rows
            .drain(..)
            .map(|row| match row {
                Row::Iteration(row) => {
                    progress.iterations = row.iteration;
                    progress.phase = Some(row.phase);
                    progress.energy = row.energy;
                    serde_json::to_string(&row).map(What::Iteration)
                }
                Row::Round(row) => {
                    progress.rounds = row.round;
                    progress.clusters_left = Some(row.clusters);
                    progress.energy = row.energy;
                    serde_json::to_string(&row).map(What::Round)
                }
            })
            .collect::<Result<_, _>>()
            .map_err(not_json)?;
        store.append(ticket, events, progress).await?;
    }
    Ok(())
}

/// Writes the result of a job: into a folder of another name, which is then renamed, so that it is whole or not there.
fn write(outcome: Outcome, folder: &Path, started: Instant) -> Result<Summary> {
    let Outcome { labels, hierarchy, snapshots, mut report } = outcome;
    let cannot = |error| Error::io("the result cannot be stored", error);
    let writing = Instant::now();
    let parent = folder.parent().unwrap_or(folder);
    let unfinished = tempfile::Builder::new().prefix("unfinished-").tempdir_in(parent).map_err(cannot)?;
    let path = |name: &str| unfinished.path().join(name);
    if let Some(labels) = &labels {
        for (format, name) in [(LabelFormat::Npy, files::LABELS_NPY), (LabelFormat::Json, files::LABELS_JSON)] {
            create(&path(name), |out| write_labels(out, format, report.clusters, labels)).map_err(cannot)?;
        }
    }
    if !report.snapshots.is_empty() {
        let faces = report.input.faces;
        create(&path(files::SNAPSHOTS), |out| write_snapshots(out, &snapshots, faces)).map_err(cannot)?;
        create(&path(files::SNAPSHOT_LIST), |out| Ok(serde_json::to_writer(out, &report.snapshots)?))
            .map_err(cannot)?;
    }
    if let Some(hierarchy) = &hierarchy {
        create(&path(files::HIERARCHY), |out| hierarchy.write(out)).map_err(cannot)?;
    }
    report.timings_ms.write = milliseconds(writing.elapsed());
    report.timings_ms.total = milliseconds(started.elapsed());
    let summary = Summary { faces: report.input.faces, clusters: report.clusters, has_labels: labels.is_some() };
    create(&path(files::REPORT), |out| {
        serde_json::to_writer(&mut *out, &report)?;
        out.write_all(b"\n")
    })
    .map_err(cannot)?;
    std::fs::rename(unfinished.path(), folder).map_err(cannot)?;
    drop(unfinished.keep());
    Ok(summary)
}

fn create(path: &Path, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 18, File::create_new(path)?);
    content(&mut out)?;
    out.flush()
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|error| Error::io("an upload cannot be read", error))
}

fn not_json(error: serde_json::Error) -> Error {
    Error::new(Kind::Internal, format_args!("a report cannot be written as JSON: {error}"))
}

/// The buffers that came with a mesh: the only files that it can refer to, by exactly their names.
struct Parts {
    paths: HashMap<String, PathBuf>,
}

impl Parts {
    fn new(folder: &Path, names: &[String]) -> Self {
        let paths =
            names.iter().enumerate().map(|(index, name)| (name.clone(), folder.join(files::buffer(index)))).collect();
        Self { paths }
    }
}

impl Resources for Parts {
    fn load(&self, uri: &str, max_bytes: u64) -> Result<Vec<u8>> {
        let path = self.paths.get(uri).ok_or_else(|| {
            Error::mesh(format_args!(
                "the mesh refers to a buffer that did not come with it (send it as a part named buffer with this file \
                 name): {uri:?}"
            ))
        })?;
        let cannot = |error| Error::io("an upload cannot be read", error);
        let bytes = std::fs::metadata(path).map_err(cannot)?.len();
        if bytes > max_bytes {
            return Err(Error::too_large(format_args!(
                "a buffer has more bytes than the limit of {max_bytes}, {bytes}: {uri:?}"
            )));
        }
        read(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_gets_at_the_parts_by_their_names_and_at_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join(files::buffer(0)), b"first").expect("written");
        std::fs::write(folder.path().join(files::buffer(1)), b"second").expect("written");
        let parts = Parts::new(folder.path(), &["a/b c.bin".into(), "../x".into()]);
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
