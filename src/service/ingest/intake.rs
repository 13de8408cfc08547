//! The body of a request on its way in: timed, counted, decompressed, limited, and never held.
//!
//! ```text
//! body ─ Intake: bytes as sent, their number and pace ─ inflate: gzip, zstd ─ Content: bytes as meant, their number
//! ```

mod inflate;

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use axum::body::{Body, BodyDataStream, Bytes};
use futures_util::{Stream, StreamExt};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::time::Sleep;

pub(crate) use self::inflate::Coding;

/// Largest number of bytes between the contents of two parts: their headers, and what one read brings along.
const BETWEEN_PARTS: u64 = 4 << 20;

/// Most chunks between the contents of two parts: the multipart reader searches all that it gathered at each one.
const CHUNKS_BETWEEN_PARTS: u64 = 512;

/// Chunks that may come however small they are,
const ANY_CHUNKS: u64 = 4096;
/// and bytes that all chunks must have on average after that. A chunk takes some 2 µs.
const BYTES_PER_CHUNK: u64 = 64;

/// Bytes after which a stream gives way to other tasks.
const TURN: usize = 1 << 16;

/// Bytes that a compressed upload may become before its inflation counts: small meshes may be very regular.
const ANY_INFLATION: u64 = 1 << 20;

/// How many times as large as its compressed form an upload may be: more than text of meshes, a tenth of what DEFLATE
/// can reach.
const MAX_INFLATION: u64 = 100;

/// Bytes a second that an upload must bring on average: a GSM modem brings 1,200.
const MIN_RATE: u64 = 1024;

/// What a body may be like.
#[derive(Debug, Clone)]
pub(crate) struct Rules {
    /// Largest number of bytes, as sent and as meant.
    pub limit: u64,
    /// Time without a byte after which it is given up.
    pub patience: Duration,
}

impl Rules {
    /// The error for more bytes than allowed: `length` is how many, as far as is known.
    pub fn too_large(&self, length: u64) -> Error {
        Error::too_large(format_args!(
            "the upload has more bytes than the limit of {} (the service's --max-upload-bytes): {length}",
            self.limit
        ))
    }
}

/// The content of a body, decompressed: a stream that ends with an error when something about it is not as it must be.
pub(crate) struct Content {
    bytes: Paced<Pin<Box<dyn Stream<Item = Result<Bytes>> + Send>>>,
    rules: Rules,
    /// Bytes as sent, when they are compressed.
    sent: Option<Arc<AtomicU64>>,
    /// Bytes as meant.
    received: u64,
    allowance: Allowance,
}

/// Bytes that may still come before the next part of a form begins.
///
/// The multipart reader gathers the headers of a part in memory, however long; this bounds them.
#[derive(Debug, Clone)]
pub(crate) struct Allowance(Arc<AtomicU64>);

impl Allowance {
    /// From here on headers of a part are read.
    pub fn between_parts(&self) {
        self.0.store(BETWEEN_PARTS, Ordering::Relaxed);
    }

    /// From here on the content of a part is read, which does not gather.
    pub fn within_part(&self) {
        self.0.store(u64::MAX, Ordering::Relaxed);
    }

    /// Whether a chunk of `bytes` bytes is within it.
    fn spend(&self, bytes: u64) -> bool {
        let left = self.0.load(Ordering::Relaxed);
        if left == u64::MAX {
            return true;
        }
        let bytes = bytes.max(BETWEEN_PARTS / CHUNKS_BETWEEN_PARTS);
        self.0.store(left.saturating_sub(bytes), Ordering::Relaxed);
        left >= bytes
    }
}

/// Takes over a body, of `length` bytes where that is declared, compressed by `coding` if at all.
pub(crate) fn open(body: Body, coding: Option<Coding>, length: Option<u64>, rules: Rules) -> Result<Content> {
    let intake = Intake::new(body, rules.clone());
    if let Some(length) = length.filter(|length| *length > rules.limit) {
        return Err(rules.too_large(length));
    }
    let sent = coding.map(|_| Arc::clone(&intake.received));
    let bytes: Pin<Box<dyn Stream<Item = Result<Bytes>> + Send>> = match coding {
        None => Box::pin(intake),
        Some(coding) => Box::pin(inflate::inflate(Paced::new(intake), coding)),
    };
    let allowance = Allowance(Arc::new(AtomicU64::new(u64::MAX)));
    Ok(Content { bytes: Paced::new(bytes), rules, sent, received: 0, allowance })
}

impl Content {
    /// The allowance that the stream spends.
    pub fn allowance(&self) -> Allowance {
        self.allowance.clone()
    }

    fn check(&mut self, data: &Bytes) -> Result<()> {
        let bytes = data.len() as u64;
        self.received += bytes;
        if self.received > self.rules.limit {
            return Err(self.rules.too_large(self.received));
        }
        if let Some(sent) = &self.sent {
            let sent = sent.load(Ordering::Relaxed);
            if self.received > ANY_INFLATION.saturating_add(sent.saturating_mul(MAX_INFLATION)) {
                return Err(Error::too_large(format_args!(
                    "the compressed upload becomes more than {MAX_INFLATION} times as large: send it without \
                     compression, or less compressed; it was at {} bytes after {sent}",
                    self.received
                )));
            }
        }
        if !self.allowance.spend(bytes) {
            return Err(Error::new(
                Kind::BadRequest,
                format_args!(
                    "the headers of a part, or what stands before the first one, take more than {BETWEEN_PARTS} \
                     bytes or come in more than {CHUNKS_BETWEEN_PARTS} chunks; send larger chunks"
                ),
            ));
        }
        Ok(())
    }
}

impl Stream for Content {
    type Item = Result<Bytes>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        // The multipart reader polls until nothing is ready and keeps everything; turns bound that.
        self.bytes.poll_next_unpin(context).map(|item| Some(item?.and_then(|data| self.check(&data).map(|()| data))))
    }
}

/// A stream that gives way to other tasks after each [`TURN`].
struct Paced<S> {
    stream: S,
    /// Bytes that it gave since it gave way.
    given: usize,
}

impl<S> Paced<S> {
    fn new(stream: S) -> Self {
        Self { stream, given: 0 }
    }
}

impl<S: Stream<Item = Result<Bytes>> + Unpin> Stream for Paced<S> {
    type Item = Result<Bytes>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.given >= TURN {
            self.given = 0;
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        let polled = self.stream.poll_next_unpin(context);
        if let Poll::Ready(Some(Ok(data))) = &polled {
            self.given += data.len();
        }
        polled
    }
}

/// A body as it is sent.
struct Intake {
    body: Option<BodyDataStream>,
    rules: Rules,
    received: Arc<AtomicU64>,
    chunks: u64,
    began: Instant,
    /// Ends when nothing came for too long.
    quiet: Pin<Box<Sleep>>,
}

impl Intake {
    fn new(body: Body, rules: Rules) -> Self {
        Self {
            body: Some(body.into_data_stream()),
            quiet: Box::pin(tokio::time::sleep(rules.patience)),
            rules,
            received: Arc::default(),
            chunks: 0,
            began: Instant::now(),
        }
    }

    fn check(&mut self, data: &Bytes) -> Result<()> {
        let bytes = data.len() as u64;
        let received = self.received.fetch_add(bytes, Ordering::Relaxed) + bytes;
        if received > self.rules.limit {
            return Err(self.rules.too_large(received));
        }
        self.chunks += 1;
        if self.chunks > ANY_CHUNKS && received < self.chunks * BYTES_PER_CHUNK {
            return Err(Error::new(
                Kind::BadRequest,
                format_args!(
                    "the body comes in chunks of fewer than {BYTES_PER_CHUNK} bytes on average: send larger chunks; \
                     chunks: {}, bytes: {received}",
                    self.chunks
                ),
            ));
        }
        let now = tokio::time::Instant::now();
        self.quiet.as_mut().reset(now + self.rules.patience);
        let elapsed = self.began.elapsed().saturating_sub(self.rules.patience).as_secs_f64();
        if (received as f64) < elapsed * MIN_RATE as f64 {
            return Err(Error::new(
                Kind::Timeout,
                format_args!("the upload comes at less than {MIN_RATE} bytes a second: {received} bytes so far"),
            ));
        }
        Ok(())
    }
}

impl Stream for Intake {
    type Item = Result<Bytes>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let Some(body) = &mut self.body else {
            return Poll::Ready(None);
        };
        match body.poll_next_unpin(context) {
            Poll::Pending => match self.quiet.as_mut().poll(context) {
                Poll::Pending => Poll::Pending,
                Poll::Ready(()) => Poll::Ready(Some(Err(Error::new(
                    Kind::Timeout,
                    format_args!(
                        "nothing of the upload came for {} s, after bytes: {}",
                        self.rules.patience.as_secs(),
                        self.received.load(Ordering::Relaxed)
                    ),
                )))),
            },
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
            Poll::Ready(Some(Ok(data))) => Poll::Ready(Some(self.check(&data).map(|()| data))),
        }
    }
}
