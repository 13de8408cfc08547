//! The service itself: the device, formats, limits, version, workers, metrics, and what probes read.

use axum::Json;
use axum::extract::{Request, State as Extract};
use axum::http::header;
use axum::response::IntoResponse;
use serde::Serialize;
use tesserae_mesh::artifacts::{Form, LABELS};
use tesserae_mesh::error::Error;
use tesserae_mesh::job::InputFormat;
use utoipa::ToSchema;

use crate::guard::problem::Answer;
use crate::http::state::{App, DeviceDescription};
use crate::ops::health::{self, Condition};
use crate::ops::trace::Origin;
use crate::settings::Settings;
use crate::store::Worker;

/// Formats that are read and written.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Formats {
    /// Formats of meshes.
    meshes: Vec<FormatView>,
    /// Formats of points.
    points: Vec<FormatView>,
    /// Formats of labels; the first is what a request gets that accepts anything.
    labels: Vec<FormatView>,
}

/// A format.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = FormatInfo)]
pub(crate) struct FormatView {
    /// Usual file extension; of meshes, also the value of `format`.
    #[schema(example = "glb")]
    name: &'static str,
    /// Media type.
    #[schema(example = "model/gltf-binary")]
    media_type: &'static str,
}

/// What a mesh may be.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = MeshLimits)]
pub(crate) struct LimitsView {
    /// Bytes of the largest upload, the files that belong to a mesh included.
    #[schema(example = 2_147_483_648_u64)]
    max_upload_bytes: u64,
    /// Faces of the largest mesh.
    #[schema(example = 50_000_000)]
    max_faces: u64,
}

/// The version of the service.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Version {
    /// `tesserae`.
    name: &'static str,
    /// Semantic version.
    version: &'static str,
}

/// The device
///
/// What clusters here, and how it was chosen.
#[utoipa::path(
    get, path = "/v1/device", tag = "service", operation_id = "getDevice",
    responses((status = 200, description = "The device", body = DeviceDescription)),
)]
pub(crate) async fn device(Extract(shared): App) -> Json<DeviceDescription> {
    Json(shared.device.clone())
}

/// Formats
///
/// Formats of meshes and of points, and media types of labels.
#[utoipa::path(
    get, path = "/v1/formats", tag = "service", operation_id = "getFormats",
    responses((status = 200, description = "The formats", body = Formats)),
)]
pub(crate) async fn formats() -> Json<Formats> {
    let file = |format: InputFormat| FormatView { name: format.name(), media_type: format.media_type() };
    let (points, meshes): (Vec<_>, Vec<_>) = InputFormat::all().partition(|format| format.is_of_points());
    let label = |form: &Form| FormatView { name: form.extension(), media_type: form.media_type };
    Json(Formats {
        meshes: meshes.into_iter().map(file).collect(),
        points: points.into_iter().map(file).collect(),
        labels: LABELS.forms.iter().map(label).collect(),
    })
}

/// Limits
///
/// The largest upload and the largest mesh. A compressed upload counts as it is once it is decompressed.
#[utoipa::path(
    get, path = "/v1/limits", tag = "service", operation_id = "getLimits",
    responses((status = 200, description = "The limits", body = LimitsView)),
)]
pub(crate) async fn limits(Extract(shared): App) -> Json<LimitsView> {
    let Settings { max_upload_bytes, max_faces, .. } = shared.settings;
    Json(LimitsView { max_upload_bytes, max_faces })
}

/// Version
///
/// Which release answers.
#[utoipa::path(
    get, path = "/v1/version", tag = "service", operation_id = "getVersion",
    responses((status = 200, description = "The version", body = Version)),
)]
pub(crate) async fn version() -> Json<Version> {
    Json(Version { name: "tesserae", version: env!("CARGO_PKG_VERSION") })
}

/// The workers.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct WorkerList {
    /// The workers, the oldest first.
    workers: Vec<Worker>,
}

/// List workers
///
/// The processes that work on jobs of this store, front ends aside, that were heard of in the last five minutes or have
/// jobs. Needs a token that was made with `--metrics`.
#[utoipa::path(
    get, path = "/v1/workers", tag = "service", operation_id = "listWorkers",
    responses((status = 200, description = "The workers", body = WorkerList)),
)]
pub(crate) async fn workers(Extract(shared): App) -> Answer<Json<WorkerList>> {
    Ok(Json(WorkerList { workers: shared.store.workers().await? }))
}

/// Metrics
///
/// For Prometheus, as OpenMetrics. With tokens, only for tenants that may read metrics.
#[utoipa::path(
    get, path = "/metrics", tag = "service", operation_id = "getMetrics",
    responses(
        (status = 200, description = "The metrics", body = String, content_type = "application/openmetrics-text"),
    ),
)]
pub(crate) async fn metrics(Extract(shared): App) -> Answer {
    shared.metrics.families.streams.set(shared.traffic.open_streams().cast_signed());
    let text = shared.metrics.text(&shared.store, &shared.files, &shared.health).await?;
    let media_type = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    Ok(([(header::CONTENT_TYPE, media_type)], text).into_response())
}

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
    responses((status = 200, description = "Jobs are taken", body = Readiness)),
)]
pub(crate) async fn readyz(Extract(shared): App, request: Request) -> Answer<Json<Readiness>> {
    let mut conditions = shared.health.conditions();
    let origin = request.extensions().get::<Origin>();
    if !origin.is_some_and(|origin| shared.access.may_read_details(request.headers(), origin.client)) {
        conditions = conditions.into_iter().map(Condition::without_detail).collect();
    }
    if let Some(why) = health::why_not_ready(&conditions) {
        return Err(Error::unavailable(why).into());
    }
    let status = if conditions.is_empty() { "ok" } else { "degraded" };
    Ok(Json(Readiness { status, conditions }))
}
