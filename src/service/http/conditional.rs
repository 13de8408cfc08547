//! Results that the client has already, or wants a part of: ETag, If-None-Match, Range (RFC 9110 §13 and §14).
//!
//! A layer around the routes of results. A result never changes while its job is there, and an id is never used again:
//! path, query and media type say which bytes they are, so the tag is made of these, and no result is read for it.
//! Labels whose digest is known have a tag made of that instead, which is the same wherever they were made.

use std::io;
use std::ops::Range;
use std::sync::Arc;

use axum::body::{Body, HttpBody};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::TryStreamExt as _;
use futures_util::future::BoxFuture;
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Kind};
use tokio::io::AsyncReadExt as _;
use tokio_util::io::{ReaderStream, StreamReader};

use crate::guard::problem::Failure;
use crate::ingest::upload::content_length;

/// Put into the extensions of a response: what decides its bytes besides the media type. Of labels their SHA-256, where
/// it holds nothing else but their number; of outputs that are made on request, path, query and release.
#[derive(Debug, Clone)]
pub(crate) struct Content(pub String);

/// Put into the extensions of a response without a body: opens it, or a part of it, once that is wanted.
#[derive(Clone)]
pub(crate) struct Opens(pub Arc<Open>);

type Open = dyn Fn(Option<Range<u64>>) -> BoxFuture<'static, Result<Body, Error>> + Send + Sync;

/// Answers with nothing, a part or all of a result.
pub(crate) async fn results(request: Request, next: Next) -> Response {
    let asked = request.headers().clone();
    let (is_get, uri) = (request.method() == Method::GET, request.uri().clone());
    let mut response = next.run(request).await;
    if response.status() != StatusCode::OK {
        return response;
    }
    let media_type = response.headers().get(header::CONTENT_TYPE).map_or(&b""[..], HeaderValue::as_bytes);
    let what = match response.extensions().get() {
        Some(Content(digest)) => digest.as_str(),
        None => uri.path_and_query().map_or("", |path| path.as_str()),
    };
    let digest = Sha256::new().chain_update(what).chain_update(media_type);
    let tag: String = digest.finalize()[..16].iter().map(|byte| format!("{byte:02x}")).collect();
    let tag = format!("\"{tag}\"");
    // kept by the client only, and validated before each use
    let caching = [(header::CACHE_CONTROL, "private, no-cache"), (header::ACCEPT_RANGES, "bytes")];
    response = ([(header::ETAG, tag.as_str())], caching, response).into_response();
    if known(&asked, &tag) {
        let headers = response.headers_mut();
        headers.remove(header::CONTENT_TYPE);
        headers.remove(header::CONTENT_LENGTH);
        *response.body_mut() = Body::empty();
        *response.status_mut() = StatusCode::NOT_MODIFIED;
        return response;
    }
    let length = content_length(response.headers()).or_else(|| response.body().size_hint().exact());
    // a part of other bytes than the client has is of no use to it
    let is_same = asked.get(header::IF_RANGE).is_none_or(|value| value == &tag);
    let asked = asked.get(header::RANGE).filter(|_| is_get && is_same).and_then(|range| range.to_str().ok());
    let range = asked.zip(length).and_then(|(asked, length)| Some((parse(asked, length)?, length)));
    if let (Some(asked), Some((part, length))) = (asked, &range)
        && part.is_empty()
    {
        let message =
            format_args!("the result has {length} bytes, none of which is in the range that was asked for: {asked}");
        let whole = [(header::CONTENT_RANGE, format!("bytes */{length}"))];
        return (whole, Failure::from(Error::new(Kind::RangeNotSatisfiable, message))).into_response();
    }
    if is_get { with_body(response, range).await.unwrap_or_else(Failure::into_response) } else { response }
}

/// Makes the tag of a response weak that was compressed since it got the tag: its bytes are others. A response without
/// any coding may be sent whatever the client accepts (RFC 9110 §12.5.3), so this layer leaves nothing in the request
/// but the codings that there are: the layer that compresses would answer 406 after the request was handled.
pub(crate) async fn distinguish_codings(mut request: Request, next: Next) -> Response {
    let accepted = request.headers().get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    let accepted = accepted.flat_map(|value| value.split(',')).map(str::trim);
    let is_known = |coding: &&str| {
        let name = coding.split(';').next().unwrap_or_default().trim();
        ["gzip", "zstd"].iter().any(|known| name.eq_ignore_ascii_case(known))
    };
    let codings: Vec<&str> = accepted.filter(is_known).collect();
    let is_head = request.method() == Method::HEAD && !codings.is_empty();
    match HeaderValue::try_from(codings.join(",")) {
        Ok(codings) if !codings.is_empty() => _ = request.headers_mut().insert(header::ACCEPT_ENCODING, codings),
        _ => _ = request.headers_mut().remove(header::ACCEPT_ENCODING),
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    if headers.contains_key(header::CONTENT_ENCODING)
        && let Some(tag) = headers.get(header::ETAG)
        && let Ok(weak) = HeaderValue::try_from([b"W/", tag.as_bytes()].concat())
    {
        headers.insert(header::ETAG, weak);
    }
    // that of a GET, which may be compressed, is another
    let _ = is_head.then(|| headers.remove(header::CONTENT_LENGTH));
    response
}

/// Whether the client has the result, compressed or not.
fn known(asked: &HeaderMap, tag: &str) -> bool {
    let values = asked.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    let mut values = values.flat_map(|value| value.split(',')).map(str::trim);
    values.any(|known| known == "*" || known.strip_prefix("W/").unwrap_or(known) == tag)
}

/// The bytes of a `Range` header, perhaps none. `None` for what may be ignored: other units, several ranges, nonsense.
fn parse(range: &str, length: u64) -> Option<Range<u64>> {
    let (first, last) = range.strip_prefix("bytes=")?.trim().split_once('-')?;
    let number =
        |text: &str| text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse::<u64>().ok()).flatten();
    Some(match (first, last) {
        ("", last) => length.saturating_sub(number(last)?)..length,
        (first, "") => number(first)?..length,
        (first, last) if number(first)? <= number(last)? => number(first)?..number(last)?.saturating_add(1).min(length),
        _ => return None,
    })
}

/// A response with all of its body, or a part of so many bytes.
async fn with_body(response: Response, part: Option<(Range<u64>, u64)>) -> Result<Response, Failure> {
    let (mut parts, body) = response.into_parts();
    let body = match (parts.extensions.remove(), &part) {
        (Some(Opens(open)), part) => open(part.as_ref().map(|(range, _)| range.clone())).await?,
        (None, Some((range, _))) => {
            slice(body, range.clone()).await.map_err(|error| Error::io("the result cannot be read", error))?
        }
        (None, None) => body,
    };
    let headers = part.map(|(Range { start, end }, length)| {
        parts.status = StatusCode::PARTIAL_CONTENT;
        let range = format!("bytes {start}-{}/{length}", end - 1);
        [(header::CONTENT_LENGTH, (end - start).to_string()), (header::CONTENT_RANGE, range)]
    });
    Ok((headers, Response::from_parts(parts, body)).into_response())
}

/// Some bytes of a body: those before are read and dropped, those after are not read.
async fn slice(body: Body, range: Range<u64>) -> io::Result<Body> {
    let mut bytes = StreamReader::new(body.into_data_stream().map_err(io::Error::other));
    tokio::io::copy(&mut (&mut bytes).take(range.start), &mut tokio::io::sink()).await?;
    Ok(Body::from_stream(ReaderStream::with_capacity(bytes.take(range.end - range.start), 1 << 16)))
}

#[cfg(any(fuzzing, test))]
pub(crate) fn for_fuzzing(headers: &HeaderMap, length: u64) {
    let _ = known(headers, "\"abc\"");
    if let Some(range) = headers.get(header::RANGE).and_then(|range| parse(range.to_str().ok()?, length)) {
        assert!(range.is_empty() || range.end <= length);
    }
}

#[cfg(test)]
mod tests {
    use futures_util::stream;

    use super::*;

    #[test]
    fn ranges_are_read_as_the_standard_says() {
        for (text, expected) in [
            ("bytes=0-9", Some(Some(0..10))),
            ("bytes=90-", Some(Some(90..100))),
            ("bytes=-10", Some(Some(90..100))),
            ("bytes=-1000", Some(Some(0..100))),
            ("bytes=99-99999999999", Some(Some(99..100))),
            ("bytes=100-", Some(None)),
            ("bytes=-0", Some(None)),
            ("bytes=9-0", None),
            ("bytes=0-1,5-6", None),
            ("bytes=", None),
            ("bytes=-", None),
            ("bytes=+1-2", None),
            ("lines=0-9", None),
            ("bytes=99999999999999999999-", None),
        ] {
            let range = parse(text, 100).map(|range| (!range.is_empty()).then_some(range));
            assert_eq!(range, expected, "{text}");
        }
    }

    #[tokio::test]
    async fn a_slice_has_the_bytes_that_were_asked_for_however_they_come() {
        let all: Vec<u8> = (0..=255).collect();
        for (chunk, range) in [(1, 0..256), (7, 3..4), (7, 6..8), (100, 99..201), (256, 255..256), (3, 0..1)] {
            let chunks: Vec<_> = all.chunks(chunk).map(|bytes| io::Result::Ok(bytes.to_vec())).collect();
            let sliced = slice(Body::from_stream(stream::iter(chunks)), range.clone()).await.expect("a slice");
            let bytes = axum::body::to_bytes(sliced, 1000).await.expect("bytes");
            assert_eq!(bytes, all[range.start as usize..range.end as usize], "{chunk} {range:?}");
        }
    }
}
