//! The body of a request on its way in: counted, limited, and never held.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, BodyDataStream, Bytes};
use axum::http::{HeaderMap, header};
use futures_util::{Stream, StreamExt};

use crate::error::{Error, Kind, Result};

/// For how long the rest of a refused body is read and thrown away, so that the answer reaches a client that is still
/// sending: closing at once would reset the connection, and the answer with it.
const LINGER: Duration = Duration::from_secs(2);

/// Largest number of bytes between the contents of two parts: their headers, and what one read brings along.
const BETWEEN_PARTS: u64 = 4 << 20;

/// A body as a stream that ends with an error when it has more bytes than it may.
#[derive(Debug)]
pub(super) struct Intake {
    body: Option<BodyDataStream>,
    limit: u64,
    received: u64,
    allowance: Allowance,
    /// Nothing may be read from a client that waits for leave to send (`Expect: 100-continue`) just to throw it away.
    drain: bool,
    /// Whether the last poll gave data: the next one gives way first.
    gave: bool,
}

/// How many more bytes may come before someone has to say that things are going well.
///
/// The multipart reader gathers the headers of a part in memory, however long; this bounds them.
#[derive(Debug, Clone)]
pub(super) struct Allowance(Arc<AtomicU64>);

impl Allowance {
    /// From here on headers of a part are read.
    pub fn between_parts(&self) {
        self.0.store(BETWEEN_PARTS, Ordering::Relaxed);
    }

    /// From here on the content of a part is read, which does not gather.
    pub fn within_part(&self) {
        self.0.store(u64::MAX, Ordering::Relaxed);
    }

    /// Whether `bytes` more are within it.
    fn spend(&self, bytes: u64) -> bool {
        let left = self.0.load(Ordering::Relaxed);
        if left == u64::MAX {
            return true;
        }
        self.0.store(left.saturating_sub(bytes), Ordering::Relaxed);
        left >= bytes
    }
}

impl Intake {
    /// Takes over a body of at most `limit` bytes.
    pub fn new(body: Body, headers: &HeaderMap, limit: u64) -> Self {
        Self {
            body: Some(body.into_data_stream()),
            limit,
            received: 0,
            allowance: Allowance(Arc::new(AtomicU64::new(u64::MAX))),
            drain: !headers.contains_key(header::EXPECT),
            gave: false,
        }
    }

    /// The allowance that the stream spends.
    pub fn allowance(&self) -> Allowance {
        self.allowance.clone()
    }

    /// The error for more bytes than allowed: `length` is how many, as far as is known.
    pub fn too_large(limit: u64, length: u64) -> Error {
        Error::too_large(format_args!(
            "the upload has more bytes than the limit of {limit} (the service's --max-upload-bytes): {length}"
        ))
    }
}

impl Stream for Intake {
    type Item = Result<Bytes>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        // The multipart reader polls until nothing is ready and keeps everything; one chunk at a time bounds that.
        if std::mem::take(&mut self.gave) {
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        self.drain = true;
        let Some(body) = &mut self.body else {
            return Poll::Ready(None);
        };
        match body.poll_next_unpin(context) {
            Poll::Pending => Poll::Pending,
            Poll::Ready(None) => {
                self.body = None;
                Poll::Ready(None)
            }
            Poll::Ready(Some(Err(error))) => {
                self.body = None;
                Poll::Ready(Some(Err(Error::new(
                    Kind::BadRequest,
                    format_args!("the body ended before it was whole: {error}"),
                ))))
            }
            Poll::Ready(Some(Ok(data))) => {
                self.gave = true;
                self.received += data.len() as u64;
                if self.received > self.limit {
                    return Poll::Ready(Some(Err(Self::too_large(self.limit, self.received))));
                }
                if !self.allowance.spend(data.len() as u64) {
                    return Poll::Ready(Some(Err(Error::new(
                        Kind::BadRequest,
                        format_args!(
                            "the headers of a part, or what stands before the first one, take more than {BETWEEN_PARTS} bytes"
                        ),
                    ))));
                }
                Poll::Ready(Some(Ok(data)))
            }
        }
    }
}

impl Drop for Intake {
    fn drop(&mut self) {
        let Some(mut body) = self.body.take().filter(|_| self.drain) else {
            return;
        };
        let Ok(runtime) = tokio::runtime::Handle::try_current() else {
            return;
        };
        runtime.spawn(async move {
            let rest = async { while let Some(Ok(_)) = body.next().await {} };
            let _ = tokio::time::timeout(LINGER, rest).await;
        });
    }
}
