//! Uploads that are coming in, and blobs that are kept by the store when they are small together.

use std::sync::Arc;

use futures_util::future::try_join_all;
use tesserae_mesh::error::Result;

use super::blob::BlobWriter;
use super::folder::Files;
use super::names::Folder;
use crate::store::{JobId, SMALL_BLOBS, SmallBlob};

/// The blobs of an upload that is coming in; gone when dropped, as when the client hangs up, unless they are kept.
pub(crate) struct Incoming {
    files: Arc<Files>,
    id: JobId,
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

    pub fn id(&self) -> JobId {
        self.id
    }

    /// Starts a blob, to be [added](Self::add) when it is whole.
    pub fn blob(&self, name: &str) -> BlobWriter {
        BlobWriter::new(Arc::clone(&self.files), Folder::Upload(self.id), name, true)
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

    /// Ends the upload: gives its blobs if they are small, or else makes files of them and gives none.
    pub async fn settle(&mut self) -> Result<Vec<SmallBlob>> {
        settle(std::mem::take(&mut self.held)).await
    }

    /// The job was accepted: the blobs are its upload.
    pub fn keep(mut self) {
        self.kept = true;
    }
}

/// Ends blobs that belong together: gives them if they are small, or else makes files of them, which wait for the disk
/// together, and gives none.
pub(crate) async fn settle(blobs: Vec<BlobWriter>) -> Result<Vec<SmallBlob>> {
    if are_small(&blobs) {
        return blobs.into_iter().map(BlobWriter::into_small).collect();
    }
    try_join_all(blobs.into_iter().map(BlobWriter::finish)).await?;
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
            return;
        }
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            runtime.spawn(async move {
                files.remove_upload(id).await;
                files.incoming.lock().remove(&id);
            });
        }
    }
}

impl Files {
    /// Starts an upload, under the name of the job that it will be.
    pub fn incoming(self: &Arc<Self>) -> Incoming {
        let id = JobId::random();
        self.incoming.lock().insert(id);
        Incoming { files: Arc::clone(self), id, held: Vec::new(), has_files: false, kept: false }
    }
}
