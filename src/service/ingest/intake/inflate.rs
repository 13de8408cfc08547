//! Decompression of bodies: in bounded steps, of one member or frame.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use async_compression::tokio::bufread::{GzipDecoder, ZstdDecoder};
use async_compression::zstd::DParameter;
use axum::body::Bytes;
use futures_util::{Stream, StreamExt as _, TryStreamExt as _, stream};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::io::{AsyncBufRead, AsyncBufReadExt as _, AsyncReadExt as _};
use tokio_util::either::Either;
use tokio_util::io::StreamReader;

/// Bytes that are decompressed at once.
const CHUNK: usize = 1 << 16;

/// Bytes that a body may have before it must have content,
const ANY_SENT: u64 = 1 << 16;
/// and how many times as many as its content it may have beyond that. No compressor makes content much larger; empty
/// blocks, each with tables of its own, take time and give nothing.
const SENT_PER_BYTE: u64 = 2;

/// Binary logarithm of the largest window of zstd, in bytes: 8 MiB, which every decoder must have (RFC 8878
/// §3.1.1.1.2).
const ZSTD_WINDOW_LOG: u32 = 23;

type Decoder<R> = Either<GzipDecoder<R>, ZstdDecoder<R>>;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coding {
    /// RFC 1952
    Gzip,
    /// RFC 8878
    Zstd,
}

/// Decompresses a body, which must give way to other tasks while it is read.
pub(super) fn inflate(
    body: impl Stream<Item = Result<Bytes>> + Send + Unpin,
    coding: Coding,
) -> impl Stream<Item = Result<Bytes>> + Send {
    let content = Arc::<AtomicU64>::default();
    let (so_far, mut sent) = (Arc::clone(&content), 0);
    let body = body.map(move |item| {
        let data = item.map_err(io::Error::other)?;
        // what was sent before was decompressed before more is read
        check_work(sent, so_far.load(Ordering::Relaxed))?;
        sent += data.len() as u64;
        io::Result::Ok(data)
    });
    let body = StreamReader::new(body);
    let decoder = match coding {
        Coding::Gzip => Either::Left(GzipDecoder::new(body)),
        Coding::Zstd => Either::Right(ZstdDecoder::with_params(body, &[DParameter::window_log_max(ZSTD_WINDOW_LOG)])),
    };
    stream::try_unfold(decoder, next)
        .map_err(unreadable)
        .inspect_ok(move |data| _ = content.fetch_add(data.len() as u64, Ordering::Relaxed))
}

/// Refuses a body that is read and gives too little.
fn check_work(sent: u64, content: u64) -> io::Result<()> {
    if sent <= ANY_SENT.saturating_add(content.saturating_mul(SENT_PER_BYTE)) {
        return Ok(());
    }
    let message = format!(
        "the compressed body is more than {SENT_PER_BYTE} times as large as its content; send it without compression; \
         {content} bytes of content after {sent}"
    );
    Err(io::Error::other(Error::new(Kind::BadRequest, message)))
}

/// The next chunk, and what reads the one after it; none at the end of the body. A body has one member or frame: empty
/// ones take time and give nothing.
async fn next<R: AsyncBufRead + Unpin>(mut decoder: Decoder<R>) -> io::Result<Option<(Bytes, Decoder<R>)>> {
    let mut chunk = Vec::with_capacity(CHUNK);
    if decoder.read_buf(&mut chunk).await? > 0 {
        return Ok(Some((Bytes::from(chunk), decoder)));
    }
    let mut rest = match decoder {
        Either::Left(gzip) => gzip.into_inner(),
        Either::Right(zstd) => zstd.into_inner(),
    };
    match rest.fill_buf().await?.is_empty() {
        true => Ok(None),
        false => {
            let message = "the compressed body has more than one member or frame, or other bytes after the first; \
                           compress the upload as a whole";
            Err(io::Error::other(Error::new(Kind::BadRequest, message)))
        }
    }
}

/// The error of a compressed body: one of this crate from further in, or what is wrong with the compression.
fn unreadable(error: io::Error) -> Error {
    let ours = error.get_ref().and_then(|cause| cause.downcast_ref::<Error>()).cloned();
    ours.unwrap_or_else(|| {
        Error::new(Kind::BadRequest, format_args!("the body is not as its Content-Encoding says: {error}"))
    })
}
