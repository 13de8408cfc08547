//! What happens to the parts of a blob, and what errors become.

use async_trait::async_trait;
use object_store::{PutPayload, PutResult, UploadPart};
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};

use super::*;

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
