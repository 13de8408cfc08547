//! The device, the formats, the limits and the version.

use axum::Json;
use axum::extract::State as Extract;
use serde::Serialize;
use tesserae_mesh::artifacts::{Form, LABELS};
use tesserae_mesh::job::InputFormat;
use utoipa::ToSchema;

use crate::http::state::{App, DeviceDescription};
use crate::settings::Settings;

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
