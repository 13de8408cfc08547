//! The metrics.

use axum::extract::State as Extract;
use axum::http::header;
use axum::response::IntoResponse;

use crate::guard::problem::{Answer, Problematic};
use crate::http::state::App;
use crate::metrics;

/// Metrics
///
/// For Prometheus, as OpenMetrics. With tokens, only for tenants that may read metrics.
#[utoipa::path(
    get, path = "/metrics", tag = "service", operation_id = "getMetrics",
    responses(
        (status = 200, description = "The metrics", body = String, content_type = "application/openmetrics-text"),
        (status = 500, response = Problematic),
    ),
)]
pub(crate) async fn metrics(Extract(shared): App) -> Answer {
    shared.metrics.families.streams.set(shared.traffic.open_streams().cast_signed());
    let text = shared.metrics.text(&shared.store, &shared.files, &shared.health).await?;
    Ok(([(header::CONTENT_TYPE, metrics::MEDIA_TYPE)], text).into_response())
}
