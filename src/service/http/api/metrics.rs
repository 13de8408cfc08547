//! The metrics.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::sync::atomic::Ordering;

use axum::extract::State as Extract;
use axum::http::header;
use axum::response::IntoResponse;

use crate::guard::problem::{Answer, Problematic};
use crate::http::state::App;
use crate::metrics::{self, Snapshot};

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
    let oldest = shared.store.oldest_queued().await?;
    let now = Snapshot {
        jobs: shared.store.counts().await?,
        streams: shared.traffic.open_streams(),
        upload_bytes_in_flight: shared.traffic.uploads.held(),
        store: shared.store.statistics(),
        file_errors: shared.files.failures(),
        stuck_jobs: shared.files.stuck.load(Ordering::Relaxed),
        unknown_jobs: shared.files.unknown(),
        results_damaged: shared.files.damages(),
        disk_free: shared.files.free_bytes(),
        oldest_queued: oldest.map(|time| time.elapsed().unwrap_or_default()),
    };
    let text = shared.metrics.text(now, &shared.health)?;
    Ok(([(header::CONTENT_TYPE, metrics::MEDIA_TYPE)], text).into_response())
}
