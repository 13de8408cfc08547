//! Where a page of the list of jobs begins, as the text that clients carry.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

use crate::error::{Error, Result};

/// The cursor of the page after the job of that number.
pub(super) fn cursor_of(number: u64) -> String {
    URL_SAFE_NO_PAD.encode(format!("before {number}"))
}

/// The number in a cursor.
pub(super) fn number_of(cursor: &str) -> Result<u64> {
    URL_SAFE_NO_PAD
        .decode(cursor)
        .ok()
        .and_then(|bytes| std::str::from_utf8(&bytes).ok()?.strip_prefix("before ")?.parse().ok())
        .ok_or_else(|| Error::parameter(format_args!("cursor is not one that a list of jobs gave: {cursor:?}")))
}
