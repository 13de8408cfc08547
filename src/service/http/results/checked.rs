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

use super::DoneJob;
use crate::blobs::Blob;
use crate::files::job_blobs;
use crate::ops::blocking;
use crate::store::Contents;

/// Bytes up to which a blob, or an answer, is held in memory.
pub(super) const HELD: usize = 1 << 18;

/// A whole blob of a result, whose length is right.
pub(super) struct Checked {
    blob: Blob,
    done: Arc<DoneJob>,
    name: &'static str,
}

/// What a blob of a result holds, without a look at it. [`Kind::NotFound`] if the job has none of this name.
pub(super) fn expected<'d>(done: &'d DoneJob, name: &str) -> Result<&'d Contents> {
    done.summary.blobs.get(name).ok_or_else(|| Error::not_found("the job has no such result"))
}

/// Opens a blob of a result, after it was compared if it is small. [`Kind::NotFound`] if the job has none of this name.
pub(super) async fn open(done: &Arc<DoneJob>, name: &'static str) -> Result<Checked> {
    let checked = |blob| Checked { blob, done: Arc::clone(done), name };
    let opened = checked(found(done, name, None).await?);
    match opened.length() > HELD as u64 {
        true => Ok(opened),
        false => Ok(checked(Blob::held(&opened.bytes().await?, None)?)),
    }
}

/// Opens a blob of a result from one of its bytes on, after all of them were compared.
pub(super) async fn whole(done: &Arc<DoneJob>, name: &'static str, from: u64) -> Result<Blob> {
    let opened = open(done, name).await?;
    if opened.length() > HELD as u64 {
        blocking(move || opened.read(|_| Ok(()))).await??;
    }
    part(done, name, GetRange::Offset(from)).await
}

pub(super) async fn part(done: &Arc<DoneJob>, name: &'static str, range: GetRange) -> Result<Blob> {
    match expected(done, name)?.bytes > HELD as u64 {
        true => found(done, name, Some(range)).await,
        false => Blob::held(&open(done, name).await?.blob.bytes().await?, Some(range)),
    }
}

/// A blob of the right length, or a range of it. One that is not there although its job is, is damaged.
async fn found(done: &DoneJob, name: &str, range: Option<GetRange>) -> Result<Blob> {
    let (shared, expected) = (&done.shared, expected(done, name)?.bytes);
    let blob = match job_blobs::result(&shared.files, &shared.store, &done.job, name, range).await {
        Err(error) if error.kind == Kind::NotFound && shared.store.get(done.job.id).await?.is_some() => {
            return Err(done.damaged(name, "it is not there"));
        }
        found => found?,
    };
    match blob.whole_length() {
        found if found != expected => Err(done.damaged(name, format_args!("it has {found} bytes, not {expected}"))),
        _ => Ok(blob),
    }
}

fn compare(done: &DoneJob, name: &str, sha256: Sha256) -> Result<()> {
    let sha256: String = sha256.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    match sha256 == expected(done, name)?.sha256 {
        true => Ok(()),
        false => Err(done.damaged(name, "its SHA-256 is another")),
    }
}

impl Checked {
    pub fn length(&self) -> u64 {
        self.blob.length()
    }

    pub async fn bytes(self) -> Result<Bytes> {
        let bytes = self.blob.bytes().await?;
        compare(&self.done, self.name, Sha256::new_with_prefix(&bytes))?;
        Ok(bytes)
    }

    /// What `read` makes of the bytes; of those that are damaged, an error whatever it makes of them. Blocks.
    pub fn read<T>(self, read: impl FnOnce(&mut Hashing) -> Result<T>) -> Result<T> {
        let mut bytes = Hashing { from: self.blob.into_reader(), sha256: Sha256::new() };
        let made = read(&mut bytes);
        match io::copy(&mut bytes, &mut io::sink()) {
            Ok(_) => compare(&self.done, self.name, bytes.sha256).and(made),
            Err(error) => made.and(Err(Error::io("a stored result cannot be read", error))),
        }
    }

    /// The bytes of a hierarchy, whose file has checksums of its own, so that a cut need not read all of it.
    pub fn into_hierarchy(self) -> Box<dyn Input + Send> {
        self.blob.into_reader()
    }
}

pub(super) struct Hashing {
    from: Box<dyn Input + Send>,
    sha256: Sha256,
}

impl Read for Hashing {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.from.read(into)?;
        self.sha256.update(&into[..count]);
        Ok(count)
    }
}
