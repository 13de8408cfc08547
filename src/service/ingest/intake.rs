//! The body of a request on its way in: timed, counted, decompressed, limited, and never held.
//!
//! ```text
//! body ─ arriving: bytes as sent, their number and pace ─ inflate: gzip, zstd ─ Content: bytes as meant, their number
//! ```

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use async_compression::tokio::bufread::{GzipDecoder, ZstdDecoder};
use async_compression::zstd::DParameter;
use axum::body::{Body, Bytes};
use futures_util::stream::{self, BoxStream};
use futures_util::{Stream, StreamExt as _, TryStreamExt as _};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::io::{AsyncBufRead, AsyncBufReadExt as _, AsyncReadExt as _};
use tokio::task::yield_now;
use tokio::time::timeout;
use tokio_util::either::Either;
use tokio_util::io::StreamReader;

/// Largest number of bytes between the contents of two parts: their headers, and what one read brings along.
const BETWEEN_PARTS: u64 = 4 << 20;

/// Most chunks between the contents of two parts: the multipart reader searches all that it gathered at each one.
const CHUNKS_BETWEEN_PARTS: u64 = 512;

/// Chunks that may have any length.
const ANY_CHUNKS: u64 = 4096;

/// Bytes that chunks must have on average after [`ANY_CHUNKS`]. A chunk takes some 2 µs.
const BYTES_PER_CHUNK: u64 = 64;

/// Bytes that a compressed upload may become before its inflation counts: small meshes may be very regular.
const ANY_INFLATION: u64 = 1 << 20;

/// How many times its compressed size an upload may have: more than text of meshes, a tenth of what DEFLATE reaches.
const MAX_INFLATION: u64 = 100;

/// Bytes that a compressed body may have before it must have content,
const ANY_SENT: u64 = 1 << 16;
/// and how many times as many as its content it may have beyond that. No compressor makes content much larger; empty
/// blocks, each with tables of its own, take time and give nothing.
const SENT_PER_BYTE: u64 = 2;

/// Bytes a second that an upload must bring on average: a GSM modem brings 1,200.
const MIN_RATE: u64 = 1024;

type Decoder<R> = Either<GzipDecoder<R>, ZstdDecoder<R>>;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coding {
    /// RFC 1952
    Gzip,
    /// RFC 8878
    Zstd,
}

#[derive(Debug, Clone)]
pub(crate) struct Rules {
    /// Largest number of bytes, as sent and as meant.
    pub limit: u64,
    /// Time without a byte after which it is given up.
    pub patience: Duration,
}

impl Rules {
    /// Refuses more bytes than allowed: `length` is how many, as far as is known.
    pub fn check(&self, length: u64) -> Result<()> {
        match length > self.limit {
            true => Err(Error::too_large(format_args!(
                "the upload has more bytes than the limit of {} (the service's --max-upload-bytes): {length}",
                self.limit
            ))),
            false => Ok(()),
        }
    }
}

/// The content of a body, decompressed.
pub(crate) struct Content {
    /// The bytes as meant. An error comes where they pass a limit of length, inflation or time.
    pub bytes: BoxStream<'static, Result<Bytes>>,
    pub counts: Arc<Counts>,
}

/// Bytes so far, and what may still come.
pub(crate) struct Counts {
    sent: AtomicU64,
    meant: AtomicU64,
    /// Bytes before the next part of a form begins: the multipart reader gathers the headers of a part in memory.
    left: AtomicU64,
}

impl Counts {
    /// From here on headers of a part are read.
    pub fn between_parts(&self) {
        self.left.store(BETWEEN_PARTS, Ordering::Relaxed);
    }

    /// From here on the content of a part is read, which does not gather.
    pub fn within_part(&self) {
        self.left.store(u64::MAX, Ordering::Relaxed);
    }

    /// Refuses a chunk of `bytes` bytes beyond what may come.
    fn spend(&self, bytes: u64) -> Result<()> {
        let left = self.left.load(Ordering::Relaxed);
        let bytes = bytes.max(BETWEEN_PARTS / CHUNKS_BETWEEN_PARTS);
        if left < bytes {
            let message = format_args!(
                "the headers of a part, or what stands before the first one, take more than {BETWEEN_PARTS} bytes or \
                 come in more than {CHUNKS_BETWEEN_PARTS} chunks; send larger chunks"
            );
            return Err(Error::new(Kind::BadRequest, message));
        }
        if left < u64::MAX {
            self.left.store(left - bytes, Ordering::Relaxed);
        }
        Ok(())
    }
}

/// Takes over a body, of `length` bytes where that is declared, compressed by `coding` if at all.
pub(crate) fn open(body: Body, coding: Option<Coding>, length: Option<u64>, rules: Rules) -> Result<Content> {
    rules.check(length.unwrap_or(0))?;
    let counts = Arc::new(Counts { sent: 0.into(), meant: 0.into(), left: u64::MAX.into() });
    let body = paced(arriving(body, coding.is_some(), rules.clone(), Arc::clone(&counts)));
    let bytes = match coding {
        None => body,
        Some(coding) => paced(inflate(body, coding)),
    };
    let counted = Arc::clone(&counts);
    let bytes = bytes.map(move |item| {
        let data = item?;
        let length = data.len() as u64;
        let meant = counted.meant.fetch_add(length, Ordering::Relaxed) + length;
        rules.check(meant)?;
        let sent = counted.sent.load(Ordering::Relaxed);
        if meant > ANY_INFLATION.saturating_add(sent.saturating_mul(MAX_INFLATION)) {
            return Err(Error::too_large(format_args!(
                "the compressed upload becomes more than {MAX_INFLATION} times as large: send it without compression, \
                 or less compressed; it was at {meant} bytes after {sent}"
            )));
        }
        counted.spend(length)?;
        Ok(data)
    });
    Ok(Content { bytes: bytes.boxed(), counts })
}

/// The bytes of a body as they are sent.
fn arriving(
    body: Body,
    is_compressed: bool,
    rules: Rules,
    counts: Arc<Counts>,
) -> impl Stream<Item = Result<Bytes>> + Send {
    let (patience, began, mut chunks) = (rules.patience, Instant::now(), 0);
    let silent =
        move |_| Error::new(Kind::Timeout, format_args!("nothing of the upload came for {} s", patience.as_secs()));
    let broken = |error| Error::new(Kind::BadRequest, format_args!("the body ended before it was whole: {error}"));
    let body = stream::try_unfold(body.into_data_stream(), move |mut body| async move {
        let data = timeout(patience, body.next()).await.map_err(silent)?;
        Ok(data.transpose().map_err(broken)?.map(|data| (data, body)))
    });
    body.map(move |item| {
        let data = item?;
        let before = counts.sent.fetch_add(data.len() as u64, Ordering::Relaxed);
        let received = before + data.len() as u64;
        rules.check(received)?;
        // what was sent before was decompressed before more is read
        let meant = counts.meant.load(Ordering::Relaxed);
        if is_compressed && before > ANY_SENT.saturating_add(meant.saturating_mul(SENT_PER_BYTE)) {
            let message = format_args!(
                "the compressed body is more than {SENT_PER_BYTE} times as large as its content; send it without \
                 compression; {meant} bytes of content after {before}"
            );
            return Err(Error::new(Kind::BadRequest, message));
        }
        chunks += 1;
        if chunks > ANY_CHUNKS && received < chunks * BYTES_PER_CHUNK {
            let message = format_args!(
                "the body comes in chunks of fewer than {BYTES_PER_CHUNK} bytes on average: send larger chunks; \
                 chunks: {chunks}, bytes: {received}"
            );
            return Err(Error::new(Kind::BadRequest, message));
        }
        let elapsed = began.elapsed().saturating_sub(patience).as_secs_f64();
        if (received as f64) < elapsed * MIN_RATE as f64 {
            let message =
                format_args!("the upload comes at less than {MIN_RATE} bytes a second: {received} bytes so far");
            return Err(Error::new(Kind::Timeout, message));
        }
        Ok(data)
    })
}

/// Decompresses a body, in bounded steps; it must give way to other tasks while it is read. The window of zstd is 8 MiB
/// at most, as every decoder must have (RFC 8878 §3.1.1.1.2).
fn inflate(
    body: impl Stream<Item = Result<Bytes>> + Send + Unpin,
    coding: Coding,
) -> impl Stream<Item = Result<Bytes>> + Send {
    let body = StreamReader::new(body.map_err(io::Error::other));
    let decoder = match coding {
        Coding::Gzip => Either::Left(GzipDecoder::new(body)),
        Coding::Zstd => Either::Right(ZstdDecoder::with_params(body, &[DParameter::window_log_max(23)])),
    };
    stream::try_unfold(decoder, next).map_err(unreadable)
}

/// The next chunk, and what reads the one after it. A body has one member or frame: empty ones only take time.
async fn next<R: AsyncBufRead + Unpin>(mut decoder: Decoder<R>) -> io::Result<Option<(Bytes, Decoder<R>)>> {
    let mut chunk = Vec::with_capacity(1 << 16);
    if decoder.read_buf(&mut chunk).await? > 0 {
        return Ok(Some((Bytes::from(chunk), decoder)));
    }
    let mut rest = match decoder {
        Either::Left(gzip) => gzip.into_inner(),
        Either::Right(zstd) => zstd.into_inner(),
    };
    if rest.fill_buf().await?.is_empty() {
        return Ok(None);
    }
    let message = "the compressed body has more than one member or frame, or other bytes after the first; compress the \
                   upload as a whole";
    Err(io::Error::other(Error::new(Kind::BadRequest, message)))
}

/// The error of a compressed body: one of this crate from further in, or what is wrong with the compression.
fn unreadable(error: io::Error) -> Error {
    error.get_ref().and_then(|cause| cause.downcast_ref::<Error>()).cloned().unwrap_or_else(|| {
        Error::new(Kind::BadRequest, format_args!("the body is not as its Content-Encoding says: {error}"))
    })
}

/// A stream that gives way to other tasks now and then: the multipart reader polls until nothing is ready.
fn paced(bytes: impl Stream<Item = Result<Bytes>> + Send + 'static) -> BoxStream<'static, Result<Bytes>> {
    let next = |(mut bytes, mut given): (BoxStream<'static, Result<Bytes>>, usize)| async move {
        if given >= 1 << 16 {
            yield_now().await;
            given = 0;
        }
        let item = bytes.next().await?;
        given += item.as_ref().map_or(0, Bytes::len);
        Some((item, (bytes, given)))
    };
    stream::unfold((bytes.boxed(), 0), next).boxed()
}
