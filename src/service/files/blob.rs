//! One blob: written as it comes, read as it is wanted, never held.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::Arc;

use axum::body::{Body, Bytes};
use object_store::path::Path as BlobPath;
use object_store::{
    GetOptions, GetRange, GetResult, GetResultPayload, MultipartUpload, ObjectStore, ObjectStoreExt as _,
};
use tokio::io::AsyncReadExt as _;
use tokio::runtime::Handle;
use tokio_util::io::{ReaderStream, SyncIoBridge};

use super::failure::storage_error;
use super::folder::{Files, Folder};
use crate::error::{Error, Kind, Result};
use crate::hierarchy::stored::Input;
use crate::service::faults::FaultPoint;
use crate::service::store::{JobId, SmallBlob};

/// Bytes that are held before they are written: a smaller blob is written at once.
const PART: usize = 1 << 20;

/// Bytes that are read at once.
const CHUNK: usize = 1 << 16;

/// A blob in the making; without [`finish`](Self::finish) nothing is left of it.
pub(in crate::service) struct BlobWriter {
    files: Arc<Files>,
    folder: Folder,
    name: String,
    /// Whether it is refused when there is no room to spare.
    is_upload: bool,
    buffer: Vec<u8>,
    parts: Option<Box<dyn MultipartUpload>>,
    written: u64,
}

impl BlobWriter {
    pub(super) fn new(files: Arc<Files>, folder: Folder, name: &str, is_upload: bool) -> Self {
        Self { files, folder, name: name.to_owned(), is_upload, buffer: Vec::new(), parts: None, written: 0 }
    }

    /// Bytes so far.
    pub(super) fn bytes(&self) -> u64 {
        self.written + self.buffer.len() as u64
    }

    /// The blob, of which nothing was written to the disk yet, as one for the store.
    pub(super) fn into_small(mut self) -> Result<SmallBlob> {
        let bytes = self.take_buffer().map_err(|error| self.files.noted(error))?;
        Ok(SmallBlob { name: self.name, bytes })
    }

    fn path(&self) -> BlobPath {
        self.folder.blob(&self.name)
    }

    /// Takes the next bytes.
    pub async fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.take(bytes).await.map_err(|error| self.files.noted(error))
    }

    async fn take(&mut self, bytes: &[u8]) -> Result<()> {
        let mut rest = bytes;
        while self.buffer.len() + rest.len() >= PART {
            let (now, later) = rest.split_at(PART - self.buffer.len());
            self.buffer.extend_from_slice(now);
            self.write_part().await?;
            rest = later;
        }
        self.buffer.extend_from_slice(rest);
        Ok(())
    }

    /// Makes the blob appear, whole. It is on the disk when this returns.
    pub async fn finish(mut self) -> Result<()> {
        self.complete().await.map_err(|error| self.files.noted(error))
    }

    async fn complete(&mut self) -> Result<()> {
        if self.parts.is_some() && !self.buffer.is_empty() {
            self.write_part().await?;
        }
        if let Some(parts) = &mut self.parts {
            parts.complete().await.map_err(cannot_store)?;
        } else {
            let bytes = self.take_buffer()?;
            self.files.blobs.put(&self.path(), bytes.into()).await.map_err(cannot_store)?;
        }
        self.files.disk.written(self.written);
        Ok(())
    }

    async fn write_part(&mut self) -> Result<()> {
        let bytes = self.take_buffer()?;
        let path = self.path();
        let parts = match &mut self.parts {
            Some(parts) => parts,
            none => none.insert(self.files.blobs.put_multipart(&path).await.map_err(cannot_store)?),
        };
        parts.put_part(bytes.into()).await.map_err(cannot_store)
    }

    /// What is held, if it may be written.
    fn take_buffer(&mut self) -> Result<Bytes> {
        if self.is_upload {
            self.files.check_room(self.written + self.buffer.len() as u64)?;
        }
        self.files
            .faults
            .hit(FaultPoint::WriteBlob)
            .map_err(|error| storage_error("a file cannot be stored", error))?;
        self.written += self.buffer.len() as u64;
        Ok(std::mem::take(&mut self.buffer).into())
    }
}

/// A [`BlobWriter`] for a thread that may block.
pub(in crate::service) struct BlockingWriter {
    runtime: Handle,
    writer: BlobWriter,
    /// Why a write failed: [`io::Error`] does not carry it.
    failed: Option<Error>,
}

impl BlockingWriter {
    /// To be used on a blocking thread of the runtime.
    pub fn new(writer: BlobWriter) -> Self {
        Self { runtime: Handle::current(), writer, failed: None }
    }

    /// Takes what `content` writes. The blob is still to be [finished](BlobWriter::finish).
    pub fn fill(mut self, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<BlobWriter> {
        let mut out = io::BufWriter::with_capacity(CHUNK, &mut self);
        let written = content(&mut out).and_then(|()| out.flush());
        // what it still holds after a failure is not to be written
        drop(out.into_parts());
        match (self.failed, written) {
            (Some(error), _) => Err(error),
            (None, Err(error)) => Err(Error::io("a result cannot be written", error)),
            (None, Ok(())) => Ok(self.writer),
        }
    }
}

impl Write for BlockingWriter {
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

/// A blob that is there, or a range of it.
#[derive(Debug)]
pub(in crate::service) struct Blob(Source);

#[derive(Debug)]
enum Source {
    Found(Box<GetResult>),
    Held { bytes: Bytes, start: u64 },
}

impl Files {
    /// Starts a blob of a result.
    pub fn result(self: &Arc<Self>, job: JobId, attempt: u32, name: &str) -> BlobWriter {
        BlobWriter::new(Arc::clone(self), Folder::Result(job, attempt), name, false)
    }

    /// Opens a blob, or a range of one.
    pub async fn read(&self, folder: Folder, name: &str, range: Option<GetRange>) -> Result<Blob> {
        self.may_read()?;
        let options = GetOptions { range, ..GetOptions::default() };
        let found = self.blobs.get_opts(&folder.blob(name), options).await;
        found.map(|found| Blob(Source::Found(Box::new(found)))).map_err(|error| self.noted(self.cannot_read(error)))
    }

    /// The error of a blob that cannot be opened. That it is not there means nothing while the folder is not there.
    fn cannot_read(&self, error: object_store::Error) -> Error {
        match (&error, self.check_reachable()) {
            (object_store::Error::NotFound { .. }, Err(away)) => away,
            _ => cannot_read(error),
        }
    }

    /// A small blob that the store kept, or a range of it.
    pub fn held(&self, bytes: &Bytes, range: Option<GetRange>) -> Result<Blob> {
        self.may_read()?;
        let range = range.map_or(Ok(0..bytes.len() as u64), |range| range.as_range(bytes.len() as u64));
        let range = range.map_err(|error| Error::new(Kind::Io, format_args!("a file is too short: {error}")))?;
        let bytes = bytes.slice(range.start as usize..range.end as usize);
        Ok(Blob(Source::Held { bytes, start: range.start }))
    }

    fn may_read(&self) -> Result<()> {
        let hit = self.faults.hit(FaultPoint::ReadBlob).map_err(|error| storage_error("a file cannot be read", error));
        hit.map_err(|error| self.noted(error))
    }
}

impl Blob {
    /// Number of bytes that will be read.
    pub fn length(&self) -> u64 {
        match &self.0 {
            Source::Found(found) => found.range.end - found.range.start,
            Source::Held { bytes, .. } => bytes.len() as u64,
        }
    }

    /// Where they begin in the whole blob.
    pub fn start(&self) -> u64 {
        match &self.0 {
            Source::Found(found) => found.range.start,
            Source::Held { start, .. } => *start,
        }
    }

    /// The bytes as the body of an answer.
    pub fn into_body(self) -> Body {
        let length = self.length();
        match self.0 {
            Source::Held { bytes, .. } => Body::from(bytes),
            Source::Found(found) => match file(found) {
                Ok(file) => {
                    let file = tokio::fs::File::from_std(file).take(length);
                    Body::from_stream(ReaderStream::with_capacity(file, CHUNK))
                }
                Err(found) => Body::from_stream(found.into_stream()),
            },
        }
    }

    /// The bytes for a thread that may block; to be called on the runtime.
    pub fn into_reader(self) -> Box<dyn Input + Send> {
        let length = self.length();
        match self.0 {
            Source::Held { bytes, .. } => Box::new(io::Cursor::new(bytes)),
            Source::Found(found) => match file(found) {
                Ok(file) => Box::new(file.take(length)),
                Err(found) => {
                    let stream =
                        futures_util::StreamExt::map(found.into_stream(), |chunk| chunk.map_err(io::Error::other));
                    Box::new(SyncIoBridge::new(tokio_util::io::StreamReader::new(stream)))
                }
            },
        }
    }

    /// All bytes.
    pub async fn bytes(self) -> Result<Bytes> {
        match self.0 {
            Source::Held { bytes, .. } => Ok(bytes),
            Source::Found(found) => found.bytes().await.map_err(cannot_read),
        }
    }
}

impl<T> Input for SyncIoBridge<T> where SyncIoBridge<T>: Read {}

/// A file where the bytes begin, for a blob that is one.
fn file(found: Box<GetResult>) -> Result<File, Box<GetResult>> {
    match found.payload {
        GetResultPayload::File(mut file, path) => match file.seek(SeekFrom::Start(found.range.start)) {
            Ok(_) => Ok(file),
            Err(_) => Err(Box::new(GetResult { payload: GetResultPayload::File(file, path), ..*found })),
        },
        GetResultPayload::Stream(_) => Err(found),
    }
}

/// The error of a blob that cannot be stored.
fn cannot_store(error: object_store::Error) -> Error {
    failed("a file cannot be stored", error)
}

/// The error of a blob that cannot be read.
fn cannot_read(error: object_store::Error) -> Error {
    match error {
        object_store::Error::NotFound { .. } => Error::new(Kind::NotFound, "the file is gone: its job was deleted"),
        error => failed("a file cannot be read", error),
    }
}

/// The error of a blob, for clients: the first error of the system among its causes, which names no path. The log gets
/// all of them.
fn failed(what: &str, error: object_store::Error) -> Error {
    tracing::warn!(%error, "{what}");
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
    while let Some(error) = cause {
        if let Some(error) = error.downcast_ref::<io::Error>() {
            return Error::new(Kind::of_storage(error), format_args!("{what}: {error}"));
        }
        cause = error.source();
    }
    Error::new(Kind::Io, format_args!("{what}; the log of the service says why"))
}
