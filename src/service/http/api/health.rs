//! What probes ask for.

use axum::Json;
use axum::extract::{Request, State as Extract};
use serde::Serialize;
use tesserae_mesh::error::{Error, Kind};
use utoipa::ToSchema;

use crate::guard::problem::{Answer, Problematic};
use crate::http::state::App;
use crate::ops::health::{self, Condition};
use crate::ops::trace::Origin;

/// That the process answers.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Health)]
pub(crate) struct HealthView {
    /// `ok`.
    status: &'static str,
}

/// That jobs are taken.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Readiness {
    /// `ok`, or `degraded` when something is wrong all the same.
    #[schema(example = "ok")]
    status: &'static str,
    /// What is wrong.
    conditions: Vec<Condition>,
}

/// Liveness
///
/// Answers as long as the process can, on a thread of its own; the connection is closed then.
#[utoipa::path(
    get, path = "/healthz", tag = "service", operation_id = "getHealth",
    responses((status = 200, description = "The process answers", body = HealthView)),
)]
pub(crate) async fn healthz() -> Json<HealthView> {
    Json(HealthView { status: "ok" })
}

/// Readiness
///
/// Whether jobs are taken; if not, which part does not work. Why, with paths and causes, is shown to tokens that may
/// read metrics, and on the service's own machine where there are no tokens.
#[utoipa::path(
    get, path = "/readyz", tag = "service", operation_id = "getReadiness",
    responses(
        (status = 200, description = "Jobs are taken", body = Readiness),
        (status = 503, response = Problematic),
    ),
)]
pub(crate) async fn readyz(Extract(shared): App, request: Request) -> Answer<Json<Readiness>> {
    let mut conditions = shared.health.conditions();
    let origin = request.extensions().get::<Origin>();
    if !origin.is_some_and(|origin| shared.access.may_read_details(request.headers(), origin.client)) {
        conditions = conditions.into_iter().map(Condition::without_detail).collect();
    }
    if let Some(why) = health::why_not_ready(&conditions) {
        return Err(Error::new(Kind::Unavailable, why).into());
    }
    let status = if conditions.is_empty() { "ok" } else { "degraded" };
    Ok(Json(Readiness { status, conditions }))
}
