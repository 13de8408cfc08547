//! Blobs: bytes under a path, which appear whole, never change, and are removed together with others below a path.
//!
//! [`Blobs`] is all that the service needs of a place that keeps them: an [`ObjectStore`], which is a `bucket` of S3,
//! or a [`folder`], which is listed and removed as such. [`place::BlobPlace`] is what `--blobs` says. One suite of
//! tests runs for each (`tests`). Nothing here knows of jobs, or of room on a disk: `files` does.

#[cfg(feature = "s3")]
mod bucket;
pub(crate) mod folder;
pub(crate) mod place;
#[cfg(test)]
pub(crate) mod tests;

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::iter;
use std::path::PathBuf;
use std::time::SystemTime;

use axum::body::{Body, Bytes};
use futures_util::{StreamExt as _, TryStreamExt as _, future, stream};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{
    GetOptions, GetRange, GetResult, GetResultPayload, MultipartUpload, ObjectMeta, ObjectStore, ObjectStoreExt as _,
};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::hierarchy::stored::Input;
use tokio::io::AsyncReadExt as _;
use tokio::runtime::Handle;
use tokio_util::io::{ReaderStream, StreamReader, SyncIoBridge};
use uuid::Uuid;

/// Where blobs of [`Blobs::probe`] lie.
const PROBES: &str = "probes";

#[derive(Debug)]
pub(crate) struct Blobs {
    store: Box<dyn ObjectStore>,
    /// Where they lie in a folder, which can be listed and removed as such.
    folder: Option<PathBuf>,
    /// Bytes of a part of a blob; the last one may have fewer.
    pub part: usize,
}

impl Blobs {
    #[cfg(any(test, feature = "s3"))]
    pub fn stored(store: impl ObjectStore) -> Self {
        // S3 takes no part below 5 MiB but the last, and at most 10,000
        Self { store: Box::new(store), folder: None, part: 8 << 20 }
    }

    /// Those below a folder that is there; with `is_kept`, a blob is on the disk when its writing returns.
    pub fn in_folder(root: &std::path::Path, is_kept: bool) -> io::Result<Self> {
        let store = LocalFileSystem::new_with_prefix(root).map_err(io::Error::other)?.with_fsync(is_kept);
        Ok(Self { store: Box::new(store), folder: Some(root.to_owned()), part: 1 << 20 })
    }

    /// Stores a blob, which stays when this returns.
    pub async fn put(&self, path: &Path, bytes: Bytes) -> Result<()> {
        self.store.put(path, bytes.into()).await.map(drop).map_err(cannot_store)
    }

    pub async fn start(&self, path: &Path) -> Result<Parts> {
        let upload = self.store.put_multipart(path).await.map_err(cannot_store)?;
        Ok(Parts { upload: Some(upload) })
    }

    /// Opens a blob, or a range of it. [`Kind::NotFound`] if it is not there.
    pub async fn get(&self, path: &Path, range: Option<GetRange>) -> Result<Blob> {
        let options = GetOptions { range, ..GetOptions::default() };
        let found = self.store.get_opts(path, options).await.map_err(cannot_read)?;
        Ok(Blob::Found(Box::new(found)))
    }

    /// The same of a blob outside the place of the service: [`Kind::Conflict`] if its tag, which changes with its
    /// content, is another one, and [`Kind::Forbidden`] if it may not be read.
    pub async fn get_tagged(&self, path: &Path, range: Option<GetRange>, tag: Option<&str>) -> Result<Blob> {
        let options = GetOptions { range, if_match: tag.map(str::to_owned), ..GetOptions::default() };
        let found = self.store.get_opts(path, options).await.map_err(may_not_read)?;
        Ok(Blob::Found(Box::new(found)))
    }

    /// What is known of a blob without opening it. Errors as of [`Self::get_tagged`].
    pub async fn find(&self, path: &Path) -> Result<ObjectMeta> {
        self.store.head(path).await.map_err(may_not_read)
    }

    /// The next segment of every path below a path, once each, in no order.
    pub async fn names(&self, below: &Path) -> Result<Vec<String>> {
        if let Some(root) = &self.folder {
            return folder::names(root, below).await;
        }
        let found = self.store.list_with_delimiter(Some(below)).await.map_err(cannot_read)?;
        let paths = found.common_prefixes.into_iter().chain(found.objects.into_iter().map(|blob| blob.location));
        Ok(paths.filter_map(|path| path.filename().map(str::to_owned)).collect())
    }

    /// When the newest blob below a path was stored, by the clock of the place; none without blobs.
    pub async fn newest(&self, below: &Path) -> Result<Option<SystemTime>> {
        if let Some(root) = &self.folder {
            return folder::newest(root, below).await;
        }
        let times = self.store.list(Some(below)).map_ok(|blob| blob.last_modified.into());
        times.try_fold(None, |newest, time| future::ready(Ok(newest.max(Some(time))))).await.map_err(cannot_read)
    }

    /// Removes all blobs below a path, and returns the number of their bytes.
    pub async fn remove(&self, below: &Path) -> Result<u64> {
        if let Some(root) = &self.folder {
            return folder::remove(root, below).await;
        }
        let found: Vec<ObjectMeta> = self.store.list(Some(below)).try_collect().await.map_err(cannot_read)?;
        let bytes = found.iter().map(|blob| blob.size).sum();
        let paths = stream::iter(found.into_iter().map(|blob| Ok(blob.location))).boxed();
        self.store.delete_stream(paths).try_for_each(|_| future::ready(Ok(()))).await.map_err(cannot_store)?;
        Ok(bytes)
    }

    /// Stores a blob, finds it, and removes it; returns the time by the clock of the place.
    pub async fn probe(&self) -> Result<SystemTime> {
        let below = Path::from_iter([PROBES, &Uuid::new_v4().to_string()]);
        self.put(&below.clone().join("probe"), Bytes::from_static(b"probe")).await?;
        let time = self.newest(&below).await?;
        self.remove(&below).await?;
        time.ok_or_else(|| Error::unavailable("a file that was stored cannot be found"))
    }

    /// Removes what killed processes left of probes, before a time by the clock of the place.
    pub async fn sweep_probes(&self, before: SystemTime) -> Result<()> {
        for name in self.names(&Path::from(PROBES)).await? {
            let below = Path::from_iter([PROBES, &name]);
            if self.newest(&below).await?.is_some_and(|newest| newest <= before) {
                self.remove(&below).await?;
            }
        }
        Ok(())
    }
}

/// A blob that is stored in parts. It is there when [complete](Self::complete); dropped before, its parts are removed.
#[derive(Debug)]
pub(crate) struct Parts {
    /// None once it is complete.
    upload: Option<Box<dyn MultipartUpload>>,
}

impl Parts {
    pub async fn add(&mut self, bytes: Bytes) -> Result<()> {
        self.upload()?.put_part(bytes.into()).await.map_err(cannot_store)
    }

    /// Makes the blob appear. It stays when this returns.
    pub async fn complete(mut self) -> Result<()> {
        self.upload()?.complete().await.map_err(cannot_store)?;
        self.upload = None;
        Ok(())
    }

    fn upload(&mut self) -> Result<&mut Box<dyn MultipartUpload>> {
        self.upload.as_mut().ok_or_else(|| Error::internal("a part came after the end of a file"))
    }
}

impl Drop for Parts {
    fn drop(&mut self) {
        if let (Some(mut upload), Ok(runtime)) = (self.upload.take(), Handle::try_current()) {
            runtime.spawn(async move {
                if let Err(error) = upload.abort().await {
                    tracing::debug!(%error, "the parts of a file that was given up cannot be removed");
                }
            });
        }
    }
}

/// A blob that is there, or a range of it.
#[derive(Debug)]
pub(crate) enum Blob {
    Found(Box<GetResult>),
    Held { bytes: Bytes, whole: u64 },
}

impl Blob {
    /// A blob that is held in memory, or a range of it.
    pub fn held(bytes: &Bytes, range: Option<GetRange>) -> Result<Self> {
        let range = range.map_or(Ok(0..bytes.len() as u64), |range| range.as_range(bytes.len() as u64));
        let range = range.map_err(|error| Error::new(Kind::Io, format_args!("a file is too short: {error}")))?;
        let (whole, bytes) = (bytes.len() as u64, bytes.slice(range.start as usize..range.end as usize));
        Ok(Self::Held { bytes, whole })
    }

    pub fn length(&self) -> u64 {
        match self {
            Self::Found(found) => found.range.end - found.range.start,
            Self::Held { bytes, .. } => bytes.len() as u64,
        }
    }

    pub fn whole_length(&self) -> u64 {
        match self {
            Self::Found(found) => found.meta.size,
            Self::Held { whole, .. } => *whole,
        }
    }

    /// The bytes as the body of an answer.
    pub fn into_body(self) -> Body {
        let length = self.length();
        match self {
            Self::Held { bytes, .. } => Body::from(bytes),
            Self::Found(found) => match file(found) {
                Ok(file) => {
                    let file = tokio::fs::File::from_std(file).take(length);
                    Body::from_stream(ReaderStream::with_capacity(file, 1 << 16))
                }
                Err(found) => Body::from_stream(found.into_stream()),
            },
        }
    }

    /// The bytes for a thread that may block; to be called where there is a runtime.
    pub fn into_reader(self) -> Box<dyn Input + Send> {
        let length = self.length();
        match self {
            Self::Held { bytes, .. } => Box::new(io::Cursor::new(bytes)),
            Self::Found(found) => match file(found) {
                Ok(file) => Box::new(file.take(length)),
                Err(found) => {
                    let stream = found.into_stream().map_err(|error| io::Error::other(cannot_read(error)));
                    Box::new(Arriving(SyncIoBridge::new(StreamReader::new(stream))))
                }
            },
        }
    }

    pub async fn bytes(self) -> Result<Bytes> {
        match self {
            Self::Held { bytes, .. } => Ok(bytes),
            Self::Found(found) => found.bytes().await.map_err(cannot_read),
        }
    }
}

/// Bytes that arrive while a thread waits for them.
struct Arriving<R>(R);

impl<R: Read> Read for Arriving<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl<R: Read> Input for Arriving<R> {}

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

fn cannot_store(error: object_store::Error) -> Error {
    failed("a file cannot be stored", error)
}

fn cannot_read(error: object_store::Error) -> Error {
    match error {
        object_store::Error::NotFound { .. } => Error::not_found("the file is gone: its job was deleted"),
        object_store::Error::Precondition { .. } => Error::conflict("the file was replaced by another one"),
        error => failed("a file cannot be read", error),
    }
}

/// The error of a blob that cannot be read, outside the place of the service.
fn may_not_read(error: object_store::Error) -> Error {
    match error {
        object_store::Error::PermissionDenied { .. } | object_store::Error::Unauthenticated { .. } => {
            tracing::debug!(%error, "a file may not be read");
            Error::new(Kind::Forbidden, "a file may not be read; the log of the service says why")
        }
        error => cannot_read(error),
    }
}

/// The error of a blob, for clients: the first error of the system among its causes, which names no path.
fn failed(what: &str, error: object_store::Error) -> Error {
    tracing::warn!(%error, "{what}");
    let first: &(dyn std::error::Error + 'static) = &error;
    let mut causes = iter::successors(Some(first), |error| error.source());
    if let Some(error) = causes.find_map(|error| error.downcast_ref::<io::Error>()) {
        return Error::new(Kind::of_storage(error), format_args!("{what}: {error}"));
    }
    Error::unavailable(format_args!("{what}; the log of the service says why"))
}
