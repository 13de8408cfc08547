//! Query strings that are too long to be read.

use axum::extract::Request;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tesserae_mesh::error::{Error, Kind, Result};

use crate::guard::problem::Failure;
use crate::guard::query;

/// Longest query string, in bytes.
const MAX_BYTES: usize = 8 << 10;

/// Most parameters of a query string.
const MAX_PARAMETERS: usize = 64;

/// Refuses requests with a longer query string or more parameters, before any of it is parsed.
pub(crate) async fn limit(request: Request, next: Next) -> Response {
    match check_size(request.uri().query().unwrap_or_default()) {
        Ok(()) => next.run(request).await,
        Err(error) => Failure::from(error).into_response(),
    }
}

fn check_size(query: &str) -> Result<()> {
    if query.len() > MAX_BYTES {
        return Err(Error::new(
            Kind::UriTooLong,
            format_args!(
                "the query string has more bytes than the limit of {MAX_BYTES}; send parameters of a job in the part \
                 \"parameters\" of a form instead; bytes: {}",
                query.len()
            ),
        ));
    }
    let parameters = query::pairs(query).count();
    if parameters > MAX_PARAMETERS {
        return Err(Error::parameter(format_args!(
            "the query string has more parameters than the limit of {MAX_PARAMETERS}: {parameters}"
        )));
    }
    Ok(())
}
