//! Uploads by URL, with URLs that take nothing: a test stores in their place.

use std::sync::atomic::{AtomicUsize, Ordering};

use async_trait::async_trait;
use axum::body::Bytes;
use object_store::GetRange;
use object_store::memory::InMemory;
use object_store::path::Path as BlobPath;

use super::names::MESH_BY_URL;
use super::*;
use crate::service::blobs::{Blob, Blobs, Found, Parts, PutUrl, UploadUrls};
use crate::service::store::Reservations;
use crate::service::store::tests::reserve;

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
        let path = Folder::Upload(id).path().join(MESH_BY_URL);
        self.blobs.put(&path, mesh.to_vec().into()).await.expect("stored");
    }
}

/// Blobs in memory whose requests are counted.
#[derive(Debug, Default)]
struct Counted {
    blobs: InMemory,
    requests: Arc<AtomicUsize>,
}

macro_rules! counted {
    ($($name:ident($($argument:ident: $type:ty),*) -> $output:ty;)*) => {
        #[async_trait]
        impl Blobs for Counted {
            fn part_bytes(&self) -> usize {
                self.blobs.part_bytes()
            }

            $(async fn $name(&self, $($argument: $type),*) -> Result<$output> {
                self.requests.fetch_add(1, Ordering::Relaxed);
                Blobs::$name(&self.blobs, $($argument),*).await
            })*
        }
    };
}

counted! {
    put(path: &BlobPath, bytes: Bytes) -> ();
    start(path: &BlobPath) -> Parts;
    get(path: &BlobPath, range: Option<GetRange>) -> Blob;
    get_tagged(path: &BlobPath, range: Option<GetRange>, tag: Option<&str>) -> Blob;
    find(path: &BlobPath) -> Found;
    names(below: &BlobPath) -> Vec<String>;
    size(below: &BlobPath) -> u64;
    times(below: &BlobPath) -> Vec<(BlobPath, SystemTime)>;
    rename(from: &BlobPath, to: &BlobPath) -> ();
    remove(below: &BlobPath) -> u64;
}

#[tokio::test]
async fn urls_at_which_nothing_was_stored_cost_a_sweep_no_request() {
    let folder = tempfile::tempdir().expect("a folder");
    let (blobs, store) = (Counted::default(), MemoryStore::new(RULES).expect("a store"));
    let requests = Arc::clone(&blobs.requests);
    let mut files = Arc::into_inner(Files::with_urls(folder.path())).expect("the only one");
    files.blobs = Box::new(blobs);
    let sweep = async || {
        let before = requests.load(Ordering::Relaxed);
        assert_eq!(files.sweep(&store).await, Ok(0));
        requests.load(Ordering::Relaxed) - before
    };
    let without = sweep().await;
    for number in 0..100 {
        let id = reserve(&store, 1).await;
        files.put_url(id, 1).await.expect("given");
        if number % 2 == 0 {
            store.unreserve(id).await.expect("given up");
        }
    }
    assert_eq!(sweep().await, without);
    // each that came, and waits for its job, is listed once
    for _ in 0..10 {
        files.put_by_url(reserve(&store, 1).await, b"x").await;
    }
    assert_eq!(sweep().await, without + 10);
}

#[tokio::test]
async fn what_is_stored_for_an_upload_that_was_given_up_goes_with_the_next_sweep() {
    let folder = tempfile::tempdir().expect("a folder");
    let (files, store) = (Files::with_urls(folder.path()), MemoryStore::new(RULES).expect("a store"));
    let mut ids = Vec::new();
    for _ in 0..3 {
        let id = reserve(&store, 1).await;
        files.put_by_url(id, b"x").await;
        ids.push(id);
    }
    let [reserved, given_up, job] = ids[..] else { panic!("three") };
    store.unreserve(given_up).await.expect("given up");
    let referred = Some(Referred { url: None, tag: None, parts: None });
    let spec = Spec { referred, ..new_job().spec };
    store.create(NewJob { id: job, spec, ..new_job() }).await.expect("created");
    assert_eq!(store.reservation(job).await, Ok(None));
    // a request for its job, which came in time, may still be read
    let over = JobId::random();
    let reservation = store.reservation(reserved).await.expect("readable").expect("reserved");
    store.reserve(over, reservation, Duration::ZERO).await.expect("reserved");
    files.put_by_url(over, b"x").await;
    // comes in at another service, which the store does not know yet
    let sent = JobId::random();
    files.blobs.put(&Folder::Upload(sent).path().join(MESH), b"x"[..].into()).await.expect("stored");
    let is_there = async |id| files.blobs.newest(&Folder::Upload(id).path()).await.expect("listed").is_some();
    assert_eq!(files.sweep(&store).await, Ok(1));
    for (id, expected) in [(reserved, true), (given_up, false), (job, true), (over, true), (sent, true)] {
        assert_eq!(is_there(id).await, expected);
    }
    // its URL goes on taking uploads
    files.put_by_url(given_up, b"again").await;
    assert_eq!(files.sweep(&store).await, Ok(1));
    assert!(!is_there(given_up).await && is_there(reserved).await);
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
