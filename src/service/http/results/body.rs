//! A body of known length.

use axum::body::Body;
use axum::http::header;
use axum::response::{IntoResponse, Response};

/// A body of known length as a response.
pub(super) fn streamed(length: u64, body: Body, media_type: &'static str) -> Response {
    ([(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_LENGTH, length.to_string())], body)
        .into_response()
}
