//! The body of a request on its way in: timed, counted, decompressed, limited, and never held.
//!
//! ```text
//! body ─ arriving: bytes as sent, their number and pace ─ inflate: gzip, zstd ─ Content: bytes as meant, their number
//! ```

mod inflate;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use futures_util::stream::{self, BoxStream};
use futures_util::{Stream, StreamExt as _};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::task::yield_now;
use tokio::time::timeout;

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
    /// Refuses more bytes than allowed.
    fn check(&self, bytes: u64) -> Result<()> {
        if bytes > self.limit { Err(self.too_large(bytes)) } else { Ok(()) }
    }

    /// The error for more bytes than allowed: `length` is how many, as far as is known.
    pub fn too_large(&self, length: u64) -> Error {
        Error::too_large(format_args!(
            "the upload has more bytes than the limit of {} (the service's --max-upload-bytes): {length}",
            self.limit
        ))
    }
}

/// The content of a body, decompressed.
pub(crate) struct Content {
    /// The bytes as meant. An error comes where they pass a limit of length, inflation or time.
    pub bytes: BoxStream<'static, Result<Bytes>>,
    pub allowance: Allowance,
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

    /// Refuses a chunk of `bytes` bytes beyond it.
    fn spend(&self, bytes: u64) -> Result<()> {
        let left = self.0.load(Ordering::Relaxed);
        let bytes = bytes.max(BETWEEN_PARTS / CHUNKS_BETWEEN_PARTS);
        if left < bytes {
            return Err(Error::new(
                Kind::BadRequest,
                format_args!(
                    "the headers of a part, or what stands before the first one, take more than {BETWEEN_PARTS} \
                     bytes or come in more than {CHUNKS_BETWEEN_PARTS} chunks; send larger chunks"
                ),
            ));
        }
        if left < u64::MAX {
            self.0.store(left - bytes, Ordering::Relaxed);
        }
        Ok(())
    }
}

/// Takes over a body, of `length` bytes where that is declared, compressed by `coding` if at all.
pub(crate) fn open(body: Body, coding: Option<Coding>, length: Option<u64>, rules: Rules) -> Result<Content> {
    rules.check(length.unwrap_or(0))?;
    let sent = Arc::<AtomicU64>::default();
    let body = paced(arriving(body, rules.clone(), Arc::clone(&sent)).boxed());
    let bytes = match coding {
        None => body,
        Some(coding) => paced(inflate::inflate(body, coding).boxed()),
    };
    let allowance = Allowance(Arc::new(AtomicU64::new(u64::MAX)));
    let (spent, mut meant) = (allowance.clone(), 0);
    let check = move |data: &Bytes| {
        let bytes = data.len() as u64;
        meant += bytes;
        rules.check(meant)?;
        let sent = sent.load(Ordering::Relaxed);
        if meant > ANY_INFLATION.saturating_add(sent.saturating_mul(MAX_INFLATION)) {
            return Err(Error::too_large(format_args!(
                "the compressed upload becomes more than {MAX_INFLATION} times as large: send it without compression, \
                 or less compressed; it was at {meant} bytes after {sent}"
            )));
        }
        spent.spend(bytes)
    };
    Ok(Content { bytes: checked(bytes, check).boxed(), allowance })
}

fn checked(
    bytes: impl Stream<Item = Result<Bytes>> + Send,
    mut check: impl FnMut(&Bytes) -> Result<()> + Send,
) -> impl Stream<Item = Result<Bytes>> + Send {
    bytes.map(move |item| item.and_then(|data| check(&data).map(|()| data)))
}

/// The bytes of a body as they are sent, which `sent` counts.
fn arriving(body: Body, rules: Rules, sent: Arc<AtomicU64>) -> impl Stream<Item = Result<Bytes>> + Send {
    let (patience, began, mut chunks) = (rules.patience, Instant::now(), 0);
    let silent =
        move |_| Error::new(Kind::Timeout, format_args!("nothing of the upload came for {} s", patience.as_secs()));
    let broken = |error| Error::new(Kind::BadRequest, format_args!("the body ended before it was whole: {error}"));
    let body = stream::try_unfold(body.into_data_stream(), move |mut body| async move {
        let data = timeout(patience, body.next()).await.map_err(silent)?;
        Ok(data.transpose().map_err(broken)?.map(|data| (data, body)))
    });
    checked(body, move |data| {
        let bytes = data.len() as u64;
        let received = sent.fetch_add(bytes, Ordering::Relaxed) + bytes;
        rules.check(received)?;
        chunks += 1;
        if chunks > ANY_CHUNKS && received < chunks * BYTES_PER_CHUNK {
            return Err(Error::new(
                Kind::BadRequest,
                format_args!(
                    "the body comes in chunks of fewer than {BYTES_PER_CHUNK} bytes on average: send larger chunks; \
                     chunks: {chunks}, bytes: {received}"
                ),
            ));
        }
        let elapsed = began.elapsed().saturating_sub(patience).as_secs_f64();
        if (received as f64) < elapsed * MIN_RATE as f64 {
            return Err(Error::new(
                Kind::Timeout,
                format_args!("the upload comes at less than {MIN_RATE} bytes a second: {received} bytes so far"),
            ));
        }
        Ok(())
    })
}

/// A stream that gives way to other tasks after each [`TURN`]: the multipart reader polls until nothing is ready, and
/// keeps everything.
fn paced(bytes: BoxStream<'static, Result<Bytes>>) -> BoxStream<'static, Result<Bytes>> {
    let next = |(mut bytes, mut given): (BoxStream<'static, Result<Bytes>>, usize)| async move {
        if given >= TURN {
            yield_now().await;
            given = 0;
        }
        let item = bytes.next().await?;
        given += item.as_ref().map_or(0, Bytes::len);
        Some((item, (bytes, given)))
    };
    stream::unfold((bytes, 0), next).boxed()
}
