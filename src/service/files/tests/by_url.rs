//! Uploads by URL, with URLs that take nothing: a test stores in their place.

use async_trait::async_trait;
use object_store::path::Path as BlobPath;

use super::*;
use crate::service::blobs::{PutUrl, UploadUrls};

#[derive(Debug)]
struct NoUrls;

#[async_trait]
impl UploadUrls for NoUrls {
    async fn put_url(&self, path: &BlobPath, valid: Duration) -> Result<PutUrl> {
        Ok(PutUrl { url: format!("https://bucket.example/{path}"), valid })
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

#[tokio::test]
async fn what_is_stored_for_an_upload_that_was_given_up_goes_with_the_next_sweep() {
    let folder = tempfile::tempdir().expect("a folder");
    let (files, store) = (Files::with_urls(folder.path()), MemoryStore::new(RULES).expect("a store"));
    let mut ids = Vec::new();
    for _ in 0..3 {
        let (id, _) = files.reserve("local", 1).await.expect("reserved");
        files.put_by_url(id, b"x").await;
        ids.push(id);
    }
    let [reserved, given_up, job] = ids[..] else { panic!("three") };
    files.unreserve("local", given_up).await;
    store.create(NewJob { id: job, ..new_job() }).await.expect("created");
    files.unreserve("local", job).await;
    // comes in at another service, which the store does not know yet
    let sent = JobId::random();
    files.put_by_url(sent, b"x").await;
    let is_there = async |id| files.read(Folder::Upload(id), MESH, None).await.is_ok();
    assert_eq!(files.sweep(&store).await, Ok(1));
    for (id, expected) in [(reserved, true), (given_up, false), (job, true), (sent, true)] {
        assert_eq!(is_there(id).await, expected);
    }
    // its URL goes on taking uploads
    files.put_by_url(given_up, b"again").await;
    assert_eq!(files.sweep(&store).await, Ok(1));
    assert!(!is_there(given_up).await && is_there(reserved).await);
    assert_eq!(files.reserved("local").await, Ok(1));
}

#[tokio::test]
async fn a_mesh_that_the_bucket_does_not_show_is_refused_unless_it_shows_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = Files::with_urls(folder.path());
    let refused = async |url| {
        let forbidden = Error::new(Kind::Forbidden, "403");
        files.explain_forbidden(Err::<(), _>(forbidden), url).await.expect_err("forbidden")
    };
    let url = "s3://bucket/meshes/x.glb";
    let error = refused(Some(url)).await;
    assert_eq!(error.kind, Kind::InvalidParameter);
    assert!(error.message.contains("s3:GetObject") && error.message.contains(url), "{error}");
    assert_eq!(refused(None).await.kind, Kind::Unavailable, "a file of the service's own");
    drop(folder);
    assert_eq!(refused(Some(url)).await.kind, Kind::Unavailable, "as with a wrong key");
}
