//! Uploads by URL, with URLs that take nothing: a test stores in their place.

use async_trait::async_trait;
use object_store::path::Path as BlobPath;

use super::*;
use crate::service::blobs::UploadUrls;

#[derive(Debug)]
struct NoUrls;

#[async_trait]
impl UploadUrls for NoUrls {
    async fn put_url(&self, path: &BlobPath, _: Duration) -> Result<String> {
        Ok(format!("https://bucket.example/{path}"))
    }
}

impl Files {
    /// The files of a service among several, all of which have theirs in a folder.
    pub(in crate::service) fn with_urls(folder: &Path) -> Arc<Self> {
        let place = folder.to_str().expect("a name").parse().expect("a place");
        let mut files = Self::open(None, Some(&place), DiskLimits::default(), Faults::default()).expect("it opens");
        files.references.urls = Some(Box::new(NoUrls));
        Arc::new(files)
    }

    /// Stores a mesh as a client does at the URL of an upload.
    pub(in crate::service) async fn put_by_url(&self, id: JobId, mesh: &[u8]) {
        let path = Folder::Upload(id).path().join(MESH);
        self.blobs.put(&path, mesh.to_vec().into()).await.expect("stored");
    }
}
