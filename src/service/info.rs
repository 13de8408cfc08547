//! What the service says about itself.

use axum::Json;
use axum::extract::{Request, State as Extract};
use axum::http::header;
use axum::response::IntoResponse;
use serde::Serialize;
use utoipa::ToSchema;

use super::access_log::Origin;
use super::health::{self, Condition};
use super::metrics::{self, Room, Snapshot};
use super::openapi::Problematic;
use super::problem::Answer;
use super::server::App;
use crate::error::{Error, Kind};
use crate::mesh::Format;
use crate::output::LabelFormat;
use crate::report::DeviceInfo;

/// The device of this process and why it is that one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct DeviceDescription {
    /// What it is.
    #[serde(flatten)]
    pub info: DeviceInfo,
    /// How it was chosen, for people.
    #[schema(example = "auto: there is no GPU")]
    pub chosen: String,
    /// Meshes with fewer faces are clustered by the processor, as is what the device cannot do or is slow at; null when the
    /// device was asked for by name, and the processor takes no part.
    #[schema(example = 200_000)]
    pub cpu_below_faces: Option<u64>,
}

/// Formats that are read and written.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Formats {
    /// Formats of meshes.
    meshes: Vec<FormatView>,
    /// Formats of labels; the first is what a request gets that accepts anything.
    labels: Vec<FormatView>,
}

/// A format.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = FormatInfo)]
pub(super) struct FormatView {
    /// Usual file extension; of meshes, also the value of `format`.
    #[schema(example = "glb")]
    name: &'static str,
    /// Media type.
    #[schema(example = "model/gltf-binary")]
    media_type: &'static str,
}

/// The version of the service.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Version {
    /// `tesserae`.
    name: &'static str,
    /// Semantic version.
    version: &'static str,
}

/// That the process answers.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Health)]
pub(super) struct HealthView {
    /// `ok`.
    status: &'static str,
}

/// That jobs are taken.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Readiness {
    /// `ok`, or `degraded` when something is wrong all the same.
    #[schema(example = "ok")]
    status: &'static str,
    /// What is wrong.
    conditions: Vec<Condition>,
}

/// The device
///
/// What clusters here, and how it was chosen.
#[utoipa::path(
    get, path = "/v1/device", tag = "service", operation_id = "getDevice",
    responses((status = 200, description = "The device", body = DeviceDescription)),
)]
pub(super) async fn device(Extract(shared): App) -> Json<DeviceDescription> {
    Json(shared.device.clone())
}

/// Formats
///
/// What meshes can be, and what labels can be asked for as.
#[utoipa::path(
    get, path = "/v1/formats", tag = "service", operation_id = "getFormats",
    responses((status = 200, description = "The formats", body = Formats)),
)]
pub(super) async fn formats() -> Json<Formats> {
    let mesh = |format: Format| FormatView { name: format.name(), media_type: format.media_type() };
    let label = |format: LabelFormat| FormatView { name: format.extension(), media_type: format.media_type() };
    Json(Formats { meshes: Format::ALL.map(mesh).into(), labels: LabelFormat::ALL.map(label).into() })
}

/// Version
///
/// Which release answers.
#[utoipa::path(
    get, path = "/v1/version", tag = "service", operation_id = "getVersion",
    responses((status = 200, description = "The version", body = Version)),
)]
pub(super) async fn version() -> Json<Version> {
    Json(Version { name: env!("CARGO_PKG_NAME"), version: env!("CARGO_PKG_VERSION") })
}

/// Liveness
///
/// Answers as long as the process can.
#[utoipa::path(
    get, path = "/healthz", tag = "service", operation_id = "getHealth",
    responses((status = 200, description = "The process answers", body = HealthView)),
)]
pub(super) async fn healthz() -> Json<HealthView> {
    Json(HealthView { status: "ok" })
}

/// Readiness
///
/// Whether jobs are taken; if not, which part does not work. Why, with paths and causes, is told to tokens that may read
/// metrics, and on the service's own machine where there are no tokens.
#[utoipa::path(
    get, path = "/readyz", tag = "service", operation_id = "getReadiness",
    responses(
        (status = 200, description = "Jobs are taken", body = Readiness),
        (status = 503, response = Problematic),
    ),
)]
pub(super) async fn readyz(Extract(shared): App, request: Request) -> Answer<Json<Readiness>> {
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
pub(super) async fn metrics(Extract(shared): App) -> Answer {
    let oldest = shared.store.oldest_queued().await?;
    let room = Room {
        disk_free: shared.files.free_bytes(),
        oldest_queued: oldest.map(|time| time.elapsed().unwrap_or_default()),
    };
    let now = Snapshot {
        jobs: shared.store.counts().await?,
        streams: shared.traffic.open_streams(),
        upload_bytes_in_flight: shared.traffic.uploads.held(),
        store: shared.store.statistics(),
        disk_used: shared.files.used_bytes(),
        room,
    };
    let text = shared.metrics.text(now, &shared.health)?;
    Ok(([(header::CONTENT_TYPE, metrics::MEDIA_TYPE)], text).into_response())
}
