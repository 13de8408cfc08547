//! Results that are made on request, from what is stored: hierarchies, cuts, labels in other forms.
//!
//! The source is in memory only while a result is made, and a semaphore limits how many large ones are at a time. The
//! result streams to the client at the client's pace; a large one streams from a file without a name.

use std::io::{self, BufWriter, Seek, Write};

use axum::body::Body;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use tempfile::{SpooledData, spooled_tempfile_in};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::sync::OwnedSemaphorePermit;
use tokio_util::io::ReaderStream;

use crate::http::state::Shared;
use crate::ops::blocking::blocking;

/// Bytes of an answer that is held in memory.
pub(super) const HELD: usize = 1 << 18;

/// The right to have a large result in memory.
pub(crate) async fn turn(shared: &Shared) -> Result<OwnedSemaphorePermit> {
    let turn = shared.encoding.clone().acquire_owned().await;
    turn.map_err(|error| Error::new(Kind::Internal, format_args!("no result can be read: {error}")))
}

/// What `write` makes, on a thread that may block, as a response, and what `write` returns. Small results need no turn.
pub(crate) async fn encoded<T: Send + 'static>(
    shared: &Shared,
    turn: Option<OwnedSemaphorePermit>,
    media_type: &'static str,
    write: impl FnOnce(&mut dyn Write) -> Result<T> + Send + 'static,
) -> Result<(Response, T)> {
    let folder = shared.files.scratch();
    let (length, body, returned) = blocking(move || {
        let _turn = turn;
        let mut out = BufWriter::with_capacity(1 << 16, spooled_tempfile_in(HELD, folder));
        let returned = write(&mut out)?;
        let file = out.into_inner().map_err(|error| cannot(error.into_error()))?;
        Ok::<_, Error>(match file.into_inner() {
            SpooledData::InMemory(bytes) => {
                let bytes = bytes.into_inner();
                (bytes.len() as u64, Body::from(bytes), returned)
            }
            SpooledData::OnDisk(mut file) => {
                let length = file.stream_position().map_err(cannot)?;
                file.rewind().map_err(cannot)?;
                let file = tokio::fs::File::from_std(file);
                (length, Body::from_stream(ReaderStream::with_capacity(file, 1 << 16)), returned)
            }
        })
    })
    .await??;
    Ok((streamed(length, body, media_type), returned))
}

pub(super) fn streamed(length: u64, body: Body, media_type: &'static str) -> Response {
    let headers = [(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_LENGTH, length.to_string())];
    (headers, body).into_response()
}

pub(crate) fn cannot(error: io::Error) -> Error {
    Error::io("the result cannot be written", error)
}
