//! Blobs of results, compared with what the store of jobs says that they held: no answer is made of a damaged one.
//!
//! | what is read | checked | when |
//! |---|---|---|
//! | a whole blob | length, SHA-256 | before the answer |
//! | a part of one of up to [`HELD`] bytes | length, SHA-256 | before the answer |
//! | a hierarchy that is cut | length; what is read of it, by checksums of its own | before the answer |
//! | a part of a larger one | length | before the answer |
//!
//! A larger blob that is streamed is read twice: to be compared, and to be sent.

use std::io::{self, Read};
use std::sync::Arc;

use axum::body::Bytes;
use object_store::GetRange;
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::hierarchy::stored::Input;

use super::encoded::HELD;
use crate::blobs::Blob;
use crate::files::Files;
use crate::files::job_blobs;
use crate::http::state::Shared;
use crate::ops::blocking::blocking;
use crate::store::{Contents, Job, JobId};

/// A whole blob of a result, whose length is right.
pub(crate) struct Checked {
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

/// What a blob of the result of a job holds, without a look at it. [`Kind::NotFound`] if the job has none of this name.
pub(crate) fn expected<'j>(job: &'j Job, name: &str) -> Result<&'j Contents> {
    let found = job.summary.as_ref().and_then(|summary| summary.blobs.get(name));
    found.ok_or_else(|| Error::new(Kind::NotFound, "the job has no such result"))
}

/// Opens a blob of the result of a job. [`Kind::NotFound`] if the job has none of this name.
pub(crate) async fn open(shared: &Shared, job: &Job, name: &str) -> Result<Checked> {
    let mut check = Check::of(shared, job, name)?;
    let blob =
        check.found(shared, job_blobs::result(&shared.files, shared.store.as_ref(), job, name, None).await).await?;
    if check.expected.bytes > HELD as u64 {
        return Ok(Checked { blob, check });
    }
    let bytes = blob.bytes().await?;
    check.sha256.update(&bytes);
    check.digest()?;
    Ok(Checked { blob: Blob::held(&bytes, None)?, check })
}

/// Opens a blob of the result of a job from one of its bytes on, after all of them were compared.
pub(crate) async fn whole(shared: &Shared, job: &Job, name: &str, from: u64) -> Result<Blob> {
    let opened = open(shared, job, name).await?;
    match opened.length() > HELD as u64 {
        true => {
            let reader = opened.into_reader();
            blocking(move || reader.read(|_| Ok(()))).await??;
            part(shared, job, name, GetRange::Offset(from)).await
        }
        false => Blob::held(&opened.blob.bytes().await?, Some(GetRange::Offset(from))),
    }
}

pub(crate) async fn part(shared: &Shared, job: &Job, name: &str, range: GetRange) -> Result<Blob> {
    let check = Check::of(shared, job, name)?;
    if check.expected.bytes <= HELD as u64 {
        return Blob::held(&open(shared, job, name).await?.blob.bytes().await?, Some(range));
    }
    let found = job_blobs::result(&shared.files, shared.store.as_ref(), job, name, Some(range)).await;
    check.found(shared, found).await
}

impl Checked {
    pub fn length(&self) -> u64 {
        self.check.expected.bytes
    }

    pub async fn bytes(mut self) -> Result<Bytes> {
        let bytes = self.blob.bytes().await?;
        self.check.sha256.update(&bytes);
        self.check.digest()?;
        Ok(bytes)
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

pub(crate) struct CheckedReader {
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
        self.check.sha256.update(&into[..count]);
        Ok(count)
    }
}

impl Check {
    fn of(shared: &Shared, job: &Job, name: &str) -> Result<Self> {
        let expected = expected(job, name)?.clone();
        let (name, files) = (name.to_owned(), Arc::clone(&shared.files));
        Ok(Self { job: job.id, name, expected, sha256: Sha256::new(), files })
    }

    /// A blob of the right length. One that is not there although its job is, is damaged.
    async fn found(&self, shared: &Shared, found: Result<Blob>) -> Result<Blob> {
        let blob = match found {
            Err(error) if error.kind == Kind::NotFound && shared.store.get(self.job).await?.is_some() => {
                return Err(self.files.damaged(self.job, &self.name, "it is not there"));
            }
            found => found?,
        };
        let (found, expected) = (blob.whole_length(), self.expected.bytes);
        match found == expected {
            true => Ok(blob),
            false => {
                Err(self.files.damaged(self.job, &self.name, format_args!("it has {found} bytes, not {expected}")))
            }
        }
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
