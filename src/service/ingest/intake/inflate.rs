//! Decompression of bodies: in bounded steps, of a bounded number of frames.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use async_compression::tokio::bufread::{GzipDecoder, ZstdDecoder};
use async_compression::zstd::DParameter;
use axum::body::Bytes;
use futures_util::{Stream, StreamExt as _, TryStreamExt as _, stream};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::io::{AsyncBufRead, AsyncBufReadExt as _, AsyncReadExt as _};
use tokio_util::io::StreamReader;

/// Bytes that are decompressed at once.
const CHUNK: usize = 1 << 16;

/// Bytes that a body may have before it must have content,
const ANY_SENT: u64 = 1 << 16;
/// and how many times as many as its content it may have beyond that. No compressor makes content much larger; empty
/// blocks, each with tables of its own, take time and give nothing.
const SENT_PER_BYTE: u64 = 2;

/// Most frames of a zstd body: compressors of several threads write one for each piece of a file.
const MAX_FRAMES: u32 = 64;

/// Binary logarithm of the largest window of zstd, in bytes: 8 MiB, which every decoder must have (RFC 8878
/// §3.1.1.1.2).
const ZSTD_WINDOW_LOG: u32 = 23;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coding {
    /// RFC 1952; one member.
    Gzip,
    /// RFC 8878; at most [`MAX_FRAMES`] frames.
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
    let decoder = Decoder::new(StreamReader::new(body), coding);
    stream::try_unfold((decoder, 1), move |(decoder, frames)| next(decoder, frames, coding))
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

/// The next chunk, and what the one after it is read with; none at the end of the body.
async fn next<R: AsyncBufRead + Unpin>(
    mut decoder: Decoder<R>,
    mut frames: u32,
    coding: Coding,
) -> io::Result<Option<(Bytes, (Decoder<R>, u32))>> {
    loop {
        let mut chunk = Vec::with_capacity(CHUNK);
        if decoder.read(&mut chunk).await? > 0 {
            return Ok(Some((Bytes::from(chunk), (decoder, frames))));
        }
        let mut rest = decoder.into_inner();
        if rest.fill_buf().await?.is_empty() {
            return Ok(None);
        }
        frames += 1;
        check_frames(frames, coding)?;
        decoder = Decoder::new(rest, coding);
    }
}

/// Refuses a body that has more frames than one of its encoding may have.
fn check_frames(frames: u32, coding: Coding) -> io::Result<()> {
    let message = match coding {
        Coding::Zstd if frames > MAX_FRAMES => {
            format!("the zstd body has more frames than the limit of {MAX_FRAMES}; compress the upload as a whole")
        }
        Coding::Gzip if frames > 1 => "the gzip body has more than one member, or other bytes after the first; \
                                         compress the upload as a whole"
            .to_owned(),
        _ => return Ok(()),
    };
    Err(io::Error::other(Error::new(Kind::BadRequest, message)))
}

/// The error of a compressed body: one of this crate from further in, or what is wrong with the compression.
fn unreadable(error: io::Error) -> Error {
    let ours = error.get_ref().and_then(|cause| cause.downcast_ref::<Error>()).cloned();
    ours.unwrap_or_else(|| {
        Error::new(Kind::BadRequest, format_args!("the body is not as its Content-Encoding says: {error}"))
    })
}

/// Decompresses one frame, or one member.
enum Decoder<R> {
    Gzip(GzipDecoder<R>),
    Zstd(ZstdDecoder<R>),
}

impl<R: AsyncBufRead + Unpin> Decoder<R> {
    fn new(body: R, coding: Coding) -> Self {
        match coding {
            Coding::Gzip => Self::Gzip(GzipDecoder::new(body)),
            Coding::Zstd => Self::Zstd(ZstdDecoder::with_params(body, &[DParameter::window_log_max(ZSTD_WINDOW_LOG)])),
        }
    }

    /// Appends bytes up to the capacity of `into`; 0 at the end of the frame.
    async fn read(&mut self, into: &mut Vec<u8>) -> io::Result<usize> {
        match self {
            Self::Gzip(decoder) => decoder.read_buf(into).await,
            Self::Zstd(decoder) => decoder.read_buf(into).await,
        }
    }

    fn into_inner(self) -> R {
        match self {
            Self::Gzip(decoder) => decoder.into_inner(),
            Self::Zstd(decoder) => decoder.into_inner(),
        }
    }
}
