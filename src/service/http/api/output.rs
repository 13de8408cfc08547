//! Outputs whose route has no query: those of the table without a handler of their own.

use axum::extract::{Path, State as Extract};
use axum::http::HeaderMap;
use tesserae_mesh::artifacts::Artifact;
use tesserae_mesh::error::{Error, Kind};

use crate::guard::access::Caller;
use crate::guard::problem::Answer;
use crate::http::negotiate;
use crate::http::results::stored::{Of, attachment, stored, succeeded};
use crate::http::state::App;

pub(crate) async fn output(
    artifact: &'static Artifact,
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Answer {
    let job = shared.job(&caller, &id).await?;
    if !artifact.is_made(&job.spec.parameters) {
        let message = format!("jobs with these parameters have no such output: {}", artifact.name);
        return Err(Error::new(Kind::NotFound, message).into());
    }
    succeeded(&job)?;
    let (form, is_only) = match artifact.forms {
        [form] => (form, true),
        _ => (negotiate::choose(&headers, artifact)?, false),
    };
    let mut response = stored(&shared, &job, Of::Result, form.file, 0, form.media_type).await?;
    if !is_only {
        attachment(&mut response, &job, form.file);
    }
    Ok(response)
}
