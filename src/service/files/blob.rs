//! The writing of a blob: as its bytes come, never all of them in memory.

use std::io::{self, Write};
use std::sync::Arc;

use axum::body::Bytes;
use object_store::GetRange;
use object_store::path::Path as BlobPath;
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::runtime::Handle;

use super::folder::Files;
use super::names::Folder;
use super::root::storage_error;
use crate::blobs::{Blob, Parts};
use crate::ops::faults::FaultPoint;
use crate::store::{Contents, JobId, SmallBlob};

const CHUNK: usize = 1 << 16;

/// A blob in the making; without [`finish`](Self::finish) nothing is left of it.
pub(crate) struct BlobWriter {
    files: Arc<Files>,
    folder: Folder,
    name: String,
    /// Whether it is refused when there is no room to spare.
    is_upload: bool,
    buffer: Vec<u8>,
    parts: Option<Parts>,
    written: u64,
    /// Of all bytes so far; of a result only.
    sha256: Sha256,
}

impl BlobWriter {
    pub(super) fn new(files: Arc<Files>, folder: Folder, name: &str, is_upload: bool) -> Self {
        let (name, buffer, sha256) = (name.to_owned(), Vec::new(), Sha256::new());
        Self { files, folder, name, is_upload, buffer, parts: None, written: 0, sha256 }
    }

    pub(super) fn bytes(&self) -> u64 {
        self.written + self.buffer.len() as u64
    }

    /// What the blob of a result holds, by its name.
    pub fn contents(&self) -> (String, Contents) {
        let sha256 = self.sha256.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        (self.name.clone(), Contents { bytes: self.bytes(), sha256 })
    }

    /// The blob, of which nothing was written to the disk yet, as one for the store.
    pub(super) fn into_small(mut self) -> Result<SmallBlob> {
        let bytes = self.take_buffer().map_err(|error| self.files.noted(error))?;
        Ok(SmallBlob { name: std::mem::take(&mut self.name), bytes })
    }

    fn path(&self) -> BlobPath {
        self.folder.path().join(self.name.as_str())
    }

    pub async fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.take(bytes).await.map_err(|error| self.files.noted(error))
    }

    async fn take(&mut self, bytes: &[u8]) -> Result<()> {
        if !self.is_upload {
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
        let mut out = io::BufWriter::with_capacity(CHUNK, &mut filling);
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
        self.complete().await.map_err(|error| self.files.noted(error))
    }

    async fn complete(&mut self) -> Result<()> {
        if self.parts.is_some() && !self.buffer.is_empty() {
            self.write_part().await?;
        }
        match self.parts.take() {
            Some(parts) => parts.complete().await?,
            None => {
                let bytes = self.take_buffer()?;
                self.files.blobs.put(&self.path(), bytes).await?;
            }
        }
        // they stay
        self.written = 0;
        Ok(())
    }

    async fn write_part(&mut self) -> Result<()> {
        let bytes = self.take_buffer()?;
        let path = self.path();
        let parts = match &mut self.parts {
            Some(parts) => parts,
            none => none.insert(self.files.blobs.start(&path).await?),
        };
        parts.add(bytes).await
    }

    /// What is held, if it may be written.
    fn take_buffer(&mut self) -> Result<Bytes> {
        if self.is_upload {
            self.files.check_room(self.buffer.len() as u64, self.written)?;
        }
        self.files
            .faults
            .hit(FaultPoint::WriteBlob)
            .map_err(|error| storage_error("a file cannot be stored", error))?;
        let bytes = self.buffer.len() as u64;
        self.written += bytes;
        if self.is_upload {
            self.files.disk.uploaded(bytes);
        }
        Ok(std::mem::take(&mut self.buffer).into())
    }
}

impl Drop for BlobWriter {
    fn drop(&mut self) {
        if self.is_upload {
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

impl Files {
    pub fn result(self: &Arc<Self>, job: JobId, attempt: u32, name: &str) -> BlobWriter {
        BlobWriter::new(Arc::clone(self), Folder::Result(job, attempt), name, false)
    }

    /// Opens a blob, or a range of one.
    pub async fn read(&self, folder: Folder, name: &str, range: Option<GetRange>) -> Result<Blob> {
        self.may_read()?;
        let found = self.blobs.get(&folder.path().join(name), range).await;
        match found {
            // that a blob is not there means nothing while the folder is not there
            Err(error) if error.kind == Kind::NotFound => Err(self.check_place().await.err().unwrap_or(error)),
            found => found.map_err(|error| self.noted(error)),
        }
    }

    /// A small blob that the store kept, or a range of it.
    pub fn held(&self, bytes: &Bytes, range: Option<GetRange>) -> Result<Blob> {
        self.may_read()?;
        Blob::held(bytes, range)
    }

    fn may_read(&self) -> Result<()> {
        let hit = self.faults.hit(FaultPoint::ReadBlob).map_err(|error| storage_error("a file cannot be read", error));
        hit.map_err(|error| self.noted(error))
    }
}
