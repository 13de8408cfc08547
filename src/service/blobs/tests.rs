//! What every place for blobs does, what happens to the parts of a blob, and what errors become.

use std::time::Duration;

use async_trait::async_trait;
use object_store::memory::InMemory;
use object_store::path::Path;
use object_store::{PutPayload, PutResult, UploadPart};
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};

#[cfg(feature = "s3")]
use super::place::BlobPlace;
use super::*;
use crate::ops::blocking;

pub(crate) fn content(bytes: usize) -> Bytes {
    (0..bytes).map(|at| (at % 251) as u8).collect()
}

async fn read(blobs: &Blobs, path: &str, range: Option<GetRange>) -> Result<Bytes> {
    blobs.get(&Path::from(path), range).await?.bytes().await
}

async fn sorted_names(blobs: &Blobs, below: &str) -> Vec<String> {
    let mut names = blobs.names(&Path::from(below)).await.expect("listed");
    names.sort();
    names
}

/// Blobs of every size come back whole and in ranges, as bytes, as a body and to a thread that blocks.
async fn reading(blobs: &Blobs) {
    for size in [0, 1, 1000, 3 << 20] {
        let (path, bytes) = (format!("read/{size}"), content(size));
        blobs.put(&Path::from(path.as_str()), bytes.clone()).await.expect("stored");
        assert_eq!(read(blobs, &path, None).await, Ok(bytes.clone()));
        if size < 1000 {
            continue;
        }
        let end = size as u64;
        for (range, expected) in [
            (None, 0..end),
            (Some(GetRange::Bounded(3..9)), 3..9),
            (Some(GetRange::Suffix(7)), end - 7..end),
            (Some(GetRange::Offset(end - 1)), end - 1..end),
        ] {
            let slice = bytes.slice(expected.start as usize..expected.end as usize);
            let open = async || blobs.get(&Path::from(path.as_str()), range.clone()).await.expect("there");
            let blob = open().await;
            assert_eq!((blob.whole_length(), blob.length()), (bytes.len() as u64, slice.len() as u64));
            assert_eq!(blob.bytes().await, Ok(slice.clone()));
            let body = axum::body::to_bytes(open().await.into_body(), usize::MAX).await;
            assert!(body.expect("readable") == slice, "{range:?}");
            let mut reader = open().await.into_reader();
            let to_thread = blocking(move || {
                let mut bytes = Vec::new();
                reader.read_to_end(&mut bytes).map(|_| bytes)
            });
            assert!(to_thread.await.expect("ran").expect("readable") == slice, "{range:?}");
        }
    }
    assert_eq!(read(blobs, "read/none", None).await.expect_err("none").kind, Kind::NotFound);
}

/// A blob in parts appears when it is complete; one that is dropped never does.
async fn parts(blobs: &Blobs) {
    let bytes = content((12 << 20) + 1);
    for is_completed in [true, false] {
        let path = format!("parts/{is_completed}");
        let mut parts = blobs.start(&Path::from(path.as_str())).await.expect("started");
        for at in (0..bytes.len()).step_by(6 << 20) {
            parts.add(bytes.slice(at..bytes.len().min(at + (6 << 20)))).await.expect("stored");
        }
        assert_eq!(read(blobs, &path, None).await.expect_err("not complete").kind, Kind::NotFound);
        if is_completed {
            parts.complete().await.expect("completed");
            assert!(read(blobs, &path, None).await == Ok(bytes.clone()));
        } else {
            drop(parts);
            assert_eq!(read(blobs, &path, None).await.expect_err("dropped").kind, Kind::NotFound);
        }
    }
}

/// Names are those directly below a path; removing is about all that lies below it.
async fn listing_and_removing(blobs: &Blobs) {
    for (path, size) in [("a/1/x", 5), ("a/1/y/z", 7), ("a/10/x", 11), ("a/b", 13)] {
        blobs.put(&Path::from(path), content(size)).await.expect("stored");
    }
    assert_eq!(sorted_names(blobs, "a").await, ["1", "10", "b"]);
    assert_eq!(sorted_names(blobs, "a/1").await, ["x", "y"]);
    assert!(sorted_names(blobs, "nothing").await.is_empty());
    assert_eq!(blobs.remove(&Path::from("a/1")).await, Ok(12));
    assert_eq!(sorted_names(blobs, "a").await, ["10", "b"]);
    for gone in ["a/1/x", "a/1/y/z"] {
        assert_eq!(read(blobs, gone, None).await.expect_err("removed").kind, Kind::NotFound);
    }
    assert_eq!(read(blobs, "a/10/x", None).await, Ok(content(11)));
    assert_eq!(blobs.remove(&Path::from("a/1")).await, Ok(0));
    blobs.put(&Path::from("a/1/x"), content(1)).await.expect("stored again");
    assert_eq!(blobs.remove(&Path::from("a")).await, Ok(25));
    assert!(sorted_names(blobs, "a").await.is_empty());
    // nothing is left of a path without blobs
    blobs.put(&Path::from("a/2/3/x"), content(1)).await.expect("stored");
    assert_eq!(blobs.remove(&Path::from("a/2/3")).await, Ok(1));
    assert!(sorted_names(blobs, "a").await.is_empty());
}

/// Times are those of the place, and a probe leaves nothing.
async fn times(blobs: &Blobs) {
    let before = blobs.probe().await.expect("it works");
    let below = Path::from("times");
    assert_eq!(blobs.newest(&below).await, Ok(None));
    for path in ["times/a/x", "times/b"] {
        blobs.put(&Path::from(path), content(1)).await.expect("stored");
    }
    let newest = async |below: &str| blobs.newest(&Path::from(below)).await.expect("listed").expect("there");
    let after = blobs.probe().await.expect("it works");
    assert!(before <= newest("times/a").await && newest("times/a").await <= newest("times").await);
    assert!(newest("times").await <= after);
    blobs.put(&Path::from("probes/left/probe"), content(1)).await.expect("stored");
    let left = newest("probes/left").await;
    for (before, is_there) in [(left - Duration::from_secs(60), true), (left, false)] {
        blobs.sweep_probes(before).await.expect("swept");
        let found = blobs.newest(&Path::from("probes/left")).await.expect("listed");
        assert_eq!(found.is_some(), is_there);
    }
    // object stores have no empty folders
    for left in sorted_names(blobs, "probes").await {
        assert!(sorted_names(blobs, &format!("probes/{left}")).await.is_empty());
    }
}

/// A blob that was replaced is not read by the tag of the one before.
async fn replaced(blobs: &Blobs) {
    let path = Path::from("replaced/x");
    assert_eq!(blobs.find(&path).await.expect_err("none").kind, Kind::NotFound);
    blobs.put(&path, content(9)).await.expect("stored");
    let found = blobs.find(&path).await.expect("there");
    assert!(found.size == 9 && found.e_tag.is_some(), "{found:?}");
    let tag = found.e_tag.as_deref();
    let range = Some(GetRange::Bounded(2..5));
    let read = async || blobs.get_tagged(&path, range.clone(), tag).await?.bytes().await;
    assert_eq!(read().await, Ok(content(9).slice(2..5)));
    blobs.put(&path, content(10)).await.expect("stored");
    assert_eq!(read().await.expect_err("another one").kind, Kind::Conflict);
}

async fn check(blobs: &Blobs) {
    reading(blobs).await;
    parts(blobs).await;
    listing_and_removing(blobs).await;
    times(blobs).await;
    replaced(blobs).await;
}

#[tokio::test]
async fn a_folder_conforms() {
    for is_kept in [false, true] {
        let folder = tempfile::tempdir().expect("a folder");
        let blobs = Blobs::in_folder(folder.path(), is_kept).expect("opened");
        check(&blobs).await;
        drop(folder);
        assert!(blobs.names(&Path::from("a")).await.is_err(), "a folder that is away is not an empty one");
    }
}

#[tokio::test]
async fn an_object_store_in_memory_conforms() {
    check(&Blobs::stored(InMemory::new())).await;
}

/// The bucket is one of a server that `tests/scripts/s3.py` runs, which sets this variable to its URL.
#[cfg(feature = "s3")]
#[tokio::test]
async fn a_bucket_conforms() {
    let Ok(bucket) = std::env::var("TESSERAE_TEST_S3") else {
        println!("not tried: TESSERAE_TEST_S3 names no bucket (`make bucket`)");
        return;
    };
    let _ = rustls::crypto::ring::default_provider().install_default();
    for below in [String::new(), format!("/{}/x", Uuid::new_v4())] {
        let place: BlobPlace = format!("{bucket}{below}").parse().expect("a bucket");
        check(&place.open().expect("opened")).await;
    }
    // one that is away is not an empty one
    let place: BlobPlace = format!("{bucket}-away").parse().expect("a bucket");
    let away = place.open().expect("opened");
    assert!(away.names(&Path::default()).await.is_err());
    assert!(away.probe().await.is_err());
}

/// An upload that reports when it is aborted.
#[derive(Debug)]
struct Watched {
    aborted: UnboundedSender<()>,
    /// Whether it can be completed.
    completes: bool,
}

#[async_trait]
impl MultipartUpload for Watched {
    fn put_part(&mut self, _: PutPayload) -> UploadPart {
        Box::pin(future::ready(Ok(())))
    }

    async fn complete(&mut self) -> object_store::Result<PutResult> {
        let failed = object_store::Error::Generic { store: "a test", source: "it fails".into() };
        let result = PutResult { e_tag: None, version: None, extensions: Default::default() };
        if self.completes { Ok(result) } else { Err(failed) }
    }

    async fn abort(&mut self) -> object_store::Result<()> {
        let _ = self.aborted.send(());
        Ok(())
    }
}

#[tokio::test]
async fn parts_that_become_no_blob_are_removed_at_their_place() {
    for (is_completed, completes, aborts) in [(true, true, 0), (true, false, 1), (false, true, 1)] {
        let (aborted, mut told) = unbounded_channel();
        let mut parts = Parts { upload: Some(Box::new(Watched { aborted, completes })) };
        parts.add(Bytes::from_static(b"x")).await.expect("stored");
        match is_completed {
            true => assert_eq!(parts.complete().await.is_ok(), completes),
            false => drop(parts),
        }
        let mut count = 0;
        // ends when the upload is gone
        while told.recv().await.is_some() {
            count += 1;
        }
        assert_eq!(count, aborts, "{is_completed} {completes}");
    }
}

#[test]
fn a_file_of_another_that_may_not_be_read_is_forbidden_and_one_of_the_service_unavailable() {
    let denied = || object_store::Error::PermissionDenied { path: "x".into(), source: "403".into() };
    let unknown = || object_store::Error::Unauthenticated { path: "x".into(), source: "401".into() };
    for error in [denied, unknown] as [fn() -> object_store::Error; 2] {
        assert_eq!(may_not_read(error()).kind, Kind::Forbidden);
        assert_eq!((cannot_read(error()).kind, cannot_store(error()).kind), (Kind::Unavailable, Kind::Unavailable));
    }
    let away = object_store::Error::Generic { store: "a test", source: "away".into() };
    assert_eq!(may_not_read(away).kind, Kind::Unavailable);
}
