//! The writing of blobs: as their bytes come, never all of them in memory. Those of an upload that is coming in, or of
//! a result, are kept by the store when they are small together.

use std::io::{self, Write};
use std::sync::Arc;

use axum::body::Bytes;
use futures_util::future::join_all;
use object_store::GetRange;
use object_store::path::Path as BlobPath;
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::runtime::Handle;

use super::folder::Files;
use super::root::Folder;
use crate::blobs::{Blob, Parts};
use crate::ops::faults::FaultPoint;
use crate::store::{Contents, JobId, SMALL_BLOBS, SmallBlob};

/// A blob in the making; without [`finish`](Self::finish) nothing is left of it.
pub(crate) struct BlobWriter {
    files: Arc<Files>,
    folder: Folder,
    name: String,
    buffer: Vec<u8>,
    parts: Option<Parts>,
    written: u64,
    /// Of all bytes so far; of a result only.
    sha256: Sha256,
}

impl BlobWriter {
    fn new(files: &Arc<Files>, folder: Folder, name: &str) -> Self {
        let (files, name, buffer, sha256) = (Arc::clone(files), name.to_owned(), Vec::new(), Sha256::new());
        Self { files, folder, name, buffer, parts: None, written: 0, sha256 }
    }

    fn is_upload(&self) -> bool {
        matches!(self.folder, Folder::Upload(_))
    }

    fn bytes(&self) -> u64 {
        self.written + self.buffer.len() as u64
    }

    pub fn contents(&self) -> (String, Contents) {
        let sha256 = self.sha256.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        (self.name.clone(), Contents { bytes: self.bytes(), sha256 })
    }

    /// The blob, of which nothing was written to the disk yet, as one for the store.
    fn into_small(mut self) -> Result<SmallBlob> {
        Ok(SmallBlob { bytes: self.take_buffer()?, name: std::mem::take(&mut self.name) })
    }

    fn path(&self) -> BlobPath {
        self.folder.path().join(self.name.as_str())
    }

    pub async fn write(&mut self, bytes: &[u8]) -> Result<()> {
        if !self.is_upload() {
            self.sha256.update(bytes);
        }
        // a smaller blob is written at once
        let (mut rest, part) = (bytes, self.files.blobs.part);
        while self.buffer.len() + rest.len() >= part {
            let (now, later) = rest.split_at(part - self.buffer.len());
            self.buffer.extend_from_slice(now);
            self.write_part().await?;
            rest = later;
        }
        self.buffer.extend_from_slice(rest);
        Ok(())
    }

    /// Takes what `content` writes, on a blocking thread of the runtime.
    pub fn fill(mut self, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<Self> {
        let mut filling = Filling { writer: &mut self, runtime: Handle::current(), failed: None };
        let mut out = io::BufWriter::with_capacity(1 << 16, &mut filling);
        let written = content(&mut out).and_then(|()| out.flush());
        // what it still holds after a failure is not to be written
        drop(out.into_parts());
        match (filling.failed, written) {
            (Some(error), _) => Err(error),
            (None, Err(error)) => Err(Error::io("a result cannot be written", error)),
            (None, Ok(())) => Ok(self),
        }
    }

    /// Makes the blob appear, whole. It is on the disk when this returns.
    pub async fn finish(mut self) -> Result<()> {
        if self.parts.is_some() && !self.buffer.is_empty() {
            self.write_part().await?;
        }
        let stored = match self.parts.take() {
            Some(parts) => parts.complete().await,
            None => {
                let bytes = self.take_buffer()?;
                self.files.blobs.put(&self.path(), bytes).await
            }
        };
        stored.map_err(|error| self.files.noted(error))?;
        self.files.check_owned().await?;
        // they stay
        self.written = 0;
        Ok(())
    }

    async fn write_part(&mut self) -> Result<()> {
        let bytes = self.take_buffer()?;
        let path = self.path();
        let writing = async {
            let parts = match &mut self.parts {
                Some(parts) => parts,
                none => none.insert(self.files.blobs.start(&path).await?),
            };
            parts.add(bytes).await
        };
        writing.await.map_err(|error| self.files.noted(error))
    }

    /// What is held, if it may be written.
    fn take_buffer(&mut self) -> Result<Bytes> {
        if self.is_upload() {
            self.files.check_room(self.buffer.len() as u64, self.written).map_err(|error| self.files.noted(error))?;
        }
        self.files.hit(FaultPoint::WriteBlob, "a file cannot be stored")?;
        let bytes = self.buffer.len() as u64;
        self.written += bytes;
        if self.is_upload() {
            self.files.disk.uploaded(bytes);
        }
        Ok(std::mem::take(&mut self.buffer).into())
    }
}

impl Drop for BlobWriter {
    fn drop(&mut self) {
        if self.is_upload() {
            self.files.disk.removed(self.written);
        }
    }
}

/// What a thread that may block writes to a blob.
struct Filling<'w> {
    writer: &'w mut BlobWriter,
    runtime: Handle,
    /// Why a write failed: [`io::Error`] does not carry it.
    failed: Option<Error>,
}

impl Write for Filling<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.runtime.block_on(self.writer.write(bytes)) {
            Ok(()) => Ok(bytes.len()),
            Err(error) => {
                self.failed = Some(error);
                Err(io::Error::other("the blob cannot be written"))
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The blobs of an upload that is coming in; gone when dropped, as when the client hangs up, unless they are kept.
pub(crate) struct Incoming {
    files: Arc<Files>,
    pub id: JobId,
    /// Whole blobs, as long as all are small together.
    held: Vec<BlobWriter>,
    /// Whether they were not, and are files.
    has_files: bool,
    kept: bool,
}

impl Incoming {
    /// The mesh lies in a bucket: what comes with it lies in files.
    pub fn is_referred(&mut self) {
        self.has_files = true;
    }

    /// Starts a blob, to be [added](Self::add) when it is whole.
    pub fn blob(&self, name: &str) -> BlobWriter {
        BlobWriter::new(&self.files, Folder::Upload(self.id), name)
    }

    pub async fn add(&mut self, blob: BlobWriter) -> Result<()> {
        self.held.push(blob);
        if self.has_files || !are_small(&self.held) {
            self.has_files = true;
            for blob in self.held.drain(..) {
                blob.finish().await?;
            }
        }
        Ok(())
    }

    pub async fn settle(&mut self) -> Result<Vec<SmallBlob>> {
        settle(std::mem::take(&mut self.held)).await
    }

    /// The job was accepted: the blobs are its upload.
    pub fn keep(mut self) {
        self.kept = true;
    }
}

/// Ends blobs that belong together: gives them if they are small; else makes files of them all at once, and gives none.
pub(crate) async fn settle(blobs: Vec<BlobWriter>) -> Result<Vec<SmallBlob>> {
    if are_small(&blobs) {
        return blobs.into_iter().map(BlobWriter::into_small).collect();
    }
    // all of them, also when one fails: what is still written would appear after the others are removed
    join_all(blobs.into_iter().map(BlobWriter::finish)).await.into_iter().collect::<Result<()>>()?;
    Ok(Vec::new())
}

fn are_small(blobs: &[BlobWriter]) -> bool {
    blobs.iter().map(BlobWriter::bytes).sum::<u64>() <= SMALL_BLOBS
}

impl Drop for Incoming {
    fn drop(&mut self) {
        let (files, id) = (Arc::clone(&self.files), self.id);
        if self.kept {
            files.incoming.lock().remove(&id);
        } else if let Ok(runtime) = Handle::try_current() {
            runtime.spawn(async move {
                files.remove_upload(id).await;
                files.incoming.lock().remove(&id);
            });
        }
    }
}

impl Files {
    pub fn incoming(self: &Arc<Self>) -> Incoming {
        let id = JobId::random();
        self.incoming.lock().insert(id);
        Incoming { files: Arc::clone(self), id, held: Vec::new(), has_files: false, kept: false }
    }

    pub fn result(self: &Arc<Self>, job: JobId, attempt: u32, name: &str) -> BlobWriter {
        BlobWriter::new(self, Folder::Result(job, attempt), name)
    }

    pub async fn read(&self, folder: Folder, name: &str, range: Option<GetRange>) -> Result<Blob> {
        self.hit(FaultPoint::ReadBlob, "a file cannot be read")?;
        match self.blobs.get(&folder.path().join(name), range).await {
            // that a blob is not there means nothing while the folder is not there
            Err(error) if error.kind == Kind::NotFound => Err(self.check_place().await.err().unwrap_or(error)),
            found => found.map_err(|error| self.noted(error)),
        }
    }

    pub fn held(&self, bytes: &Bytes, range: Option<GetRange>) -> Result<Blob> {
        self.hit(FaultPoint::ReadBlob, "a file cannot be read")?;
        Blob::held(bytes, range)
    }

    fn hit(&self, point: FaultPoint, what: &str) -> Result<()> {
        self.faults.hit(point).map_err(|error| self.noted(Error::storage(what, error)))
    }
}
