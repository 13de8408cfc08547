//! Blobs of results, compared with what the store of jobs says that they held: no answer is made of a damaged one.
//!
//! | what is read | checked | when |
//! |---|---|---|
//! | a blob of up to [`HELD`] bytes | length, SHA-256 | before the answer |
//! | a larger one that an answer is made of | length, SHA-256 | before the answer |
//! | a larger one that is streamed | length; SHA-256 | before the answer; before its last bytes, which are not sent |
//! | a larger hierarchy | length; what is read of it, by checksums of its own | before the answer |
//! | a part of another larger one | length | before the answer |

use std::io::{self, Read};
use std::sync::Arc;

use axum::body::{Body, Bytes};
use futures_util::stream::{self, BoxStream};
use futures_util::{StreamExt as _, TryStreamExt as _};
use object_store::GetRange;
use sha2::{Digest, Sha256};

use super::encoded::HELD;
use crate::error::{Error, Kind, Result};
use crate::hierarchy::stored::Input;
use crate::service::blobs::Blob;
use crate::service::files::Files;
use crate::service::job_blobs;
use crate::service::state::Shared;
use crate::service::store::{Contents, Job, JobId};

/// A whole blob of a result, whose length is right.
pub(in crate::service) struct Checked {
    blob: Blob,
    check: Check,
}

/// What the bytes of a blob must be, and what they are so far.
struct Check {
    job: JobId,
    name: String,
    expected: Contents,
    sha256: Sha256,
    files: Arc<Files>,
}

/// Opens a blob of the result of a job. [`Kind::NotFound`] if the job has none of this name.
pub(in crate::service) async fn open(shared: &Shared, job: &Job, name: &str) -> Result<Checked> {
    let mut check = Check::of(shared, job, name)?;
    let blob = job_blobs::result(&shared.files, shared.store.as_ref(), job, name, None).await?;
    check.length(&blob)?;
    if check.expected.bytes > HELD as u64 {
        return Ok(Checked { blob, check });
    }
    let bytes = blob.bytes().await?;
    check.add(&bytes);
    check.digest()?;
    Ok(Checked { blob: Blob::held(&bytes, None)?, check })
}

/// Opens a part of a blob of the result of a job.
pub(in crate::service) async fn part(shared: &Shared, job: &Job, name: &str, range: GetRange) -> Result<Blob> {
    let check = Check::of(shared, job, name)?;
    if check.expected.bytes <= HELD as u64 {
        return Blob::held(&open(shared, job, name).await?.blob.bytes().await?, Some(range));
    }
    let blob = job_blobs::result(&shared.files, shared.store.as_ref(), job, name, Some(range)).await?;
    check.length(&blob)?;
    Ok(blob)
}

impl Checked {
    /// Number of its bytes.
    pub fn length(&self) -> u64 {
        self.check.expected.bytes
    }

    /// All bytes.
    pub async fn bytes(mut self) -> Result<Bytes> {
        let bytes = self.blob.bytes().await?;
        self.check.add(&bytes);
        self.check.digest()?;
        Ok(bytes)
    }

    /// The bytes from one on as the body of an answer, which breaks off before its last bytes if the blob is damaged.
    pub fn into_body(self, from: u64) -> Body {
        let Self { blob, check } = self;
        let chunks = blob.into_body().into_data_stream().map_err(|error| Error::new(Kind::Io, error)).boxed();
        Body::from_stream(stream::try_unfold(Streamed { chunks, check, left_out: from, last: None }, Streamed::next))
    }

    /// The bytes for a thread that may block; to be called on the runtime.
    pub fn into_reader(self) -> CheckedReader {
        CheckedReader { from: self.blob.into_reader(), check: self.check }
    }

    /// The bytes of a hierarchy, whose file has checksums of its own, so that a cut need not read all of it.
    pub fn into_hierarchy(self) -> Box<dyn Input + Send> {
        self.blob.into_reader()
    }
}

/// Reads a blob.
pub(in crate::service) struct CheckedReader {
    from: Box<dyn Input + Send>,
    check: Check,
}

impl CheckedReader {
    /// What `read` makes of the bytes; of those that are damaged, an error whatever it makes of them.
    pub fn read<T>(mut self, read: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let made = read(&mut self);
        match io::copy(&mut self, &mut io::sink()) {
            Ok(_) => self.check.digest().and(made),
            Err(error) => made.and(Err(Error::io("a stored result cannot be read", error))),
        }
    }
}

impl Read for CheckedReader {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.from.read(into)?;
        self.check.add(&into[..count]);
        Ok(count)
    }
}

/// A blob on its way to a client.
struct Streamed {
    chunks: BoxStream<'static, Result<Bytes>>,
    check: Check,
    /// Bytes of the beginning that are still to be left out.
    left_out: u64,
    /// The last chunk that was read: it goes when another one follows, or when all were compared.
    last: Option<Bytes>,
}

impl Streamed {
    /// The next chunk to be sent.
    async fn next(mut self) -> Result<Option<(Bytes, Self)>> {
        while let Some(mut chunk) = self.chunks.try_next().await? {
            self.check.add(&chunk);
            let left_out = self.left_out.min(chunk.len() as u64);
            self.left_out -= left_out;
            let chunk = chunk.split_off(left_out as usize);
            if let Some(before) = self.last.replace(chunk).filter(|before| !before.is_empty()) {
                return Ok(Some((before, self)));
            }
        }
        let Some(last) = self.last.take() else { return Ok(None) };
        // the head of the answer has gone: what is left is to break off
        self.check.digest()?;
        Ok(Some((last, self)))
    }
}

impl Check {
    fn of(shared: &Shared, job: &Job, name: &str) -> Result<Self> {
        let expected = job.summary.as_ref().and_then(|summary| summary.blobs.get(name)).cloned();
        let expected = expected.ok_or_else(|| Error::new(Kind::NotFound, "the job has no such result"))?;
        let (name, files) = (name.to_owned(), Arc::clone(&shared.files));
        Ok(Self { job: job.id, name, expected, sha256: Sha256::new(), files })
    }

    fn length(&self, blob: &Blob) -> Result<()> {
        let (found, expected) = (blob.whole_length(), self.expected.bytes);
        match found == expected {
            true => Ok(()),
            false => {
                Err(self.files.damaged(self.job, &self.name, format_args!("it has {found} bytes, not {expected}")))
            }
        }
    }

    fn add(&mut self, bytes: &[u8]) {
        self.sha256.update(bytes);
    }

    /// Compares the digest of all bytes that were added since it did so last.
    fn digest(&mut self) -> Result<()> {
        let sha256: String = self.sha256.finalize_reset().iter().map(|byte| format!("{byte:02x}")).collect();
        match sha256 == self.expected.sha256 {
            true => Ok(()),
            false => Err(self.files.damaged(self.job, &self.name, "its SHA-256 is another")),
        }
    }
}
