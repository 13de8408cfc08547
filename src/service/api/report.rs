//! The report of a job.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use axum::extract::{Path, State as Extract};

use super::view::tell_expiry;
use crate::service::access::Caller;
use crate::service::files;
use crate::service::problem::{Answer, Problematic};
use crate::service::results::stored::{stored, succeeded};
use crate::service::state::App;

/// Get the report
///
/// What was read, the energies, every iteration, the timings. 409 before the job has succeeded.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/report", tag = "results", operation_id = "getReport",
    params(("id" = String, Path, format = "uuid", description = "Id of the job")),
    responses(
        (status = 200, description = "The report", body = crate::report::Report),
        (status = 404, response = Problematic),
        (status = 409, response = Problematic),
        (status = 500, response = Problematic),
    ),
)]
pub(in crate::service) async fn report(Extract(shared): App, caller: Caller, Path(id): Path<String>) -> Answer {
    let job = shared.job(&caller, &id).await?;
    succeeded(&job)?;
    let mut response = stored(&shared, &job, files::REPORT, None, "application/json").await?;
    tell_expiry(&mut response, &shared, &job);
    Ok(response)
}
