//! The description of the interface, generated from the code: `openapi.yaml` in the repository and `/openapi.yaml` on
//! the service.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use axum::http::header;
use axum::response::IntoResponse;
use serde_json::Value;
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::{self, RefOr, Required, Schema};
use utoipa::{Modify, OpenApi, ToResponse, ToSchema};

use super::problem::{Answer, Problem};
use super::{events, info, jobs, results};
use crate::error::{Error, Kind, Result};

/// Bytes.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "describes bodies for openapi.yaml")]
pub(super) struct Binary(String);

/// What went wrong.
#[derive(ToResponse)]
#[response(description = "What went wrong (RFC 9457)", content_type = "application/problem+json")]
#[expect(dead_code, reason = "describes answers for openapi.yaml")]
pub(super) struct Problematic(Problem);

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Tesserae",
        description = "Clusters the faces of polygon meshes: a mesh in, one label a face and live energies out."
    ),
    paths(
        jobs::create,
        jobs::list,
        jobs::show,
        jobs::remove,
        events::stream,
        results::labels,
        results::hierarchy,
        results::report,
        info::device,
        info::formats,
        info::version,
        info::healthz,
        info::readyz,
        info::metrics,
        show,
    ),
    components(
        schemas(events::StateEvent, events::EndEvent),
        responses(Problematic)
    ),
    tags(
        (name = "jobs", description = "Submit, follow, cancel"),
        (name = "results", description = "What a job gave"),
        (name = "service", description = "The service itself"),
    ),
    modifiers(&ParametersInQuery),
)]
struct Document;

/// Makes query parameters of `POST /v1/jobs` out of the members of `Parameters`.
struct ParametersInQuery;

impl Modify for ParametersInQuery {
    fn modify(&self, document: &mut openapi::OpenApi) {
        let members = document.components.as_ref().and_then(|components| components.schemas.get("Parameters"));
        let Some(RefOr::T(Schema::Object(parameters))) = members else {
            return;
        };
        let parameters: Vec<Parameter> =
            parameters.properties.iter().map(|(name, schema)| in_query(name, schema)).collect();
        let post = document.paths.paths.get_mut("/v1/jobs").and_then(|path| path.post.as_mut());
        if let Some(post) = post {
            post.parameters.get_or_insert_default().extend(parameters.into_iter().map(RefOr::from));
        }
    }
}

/// A member of a schema as a query parameter: its description moves up, and it is absent where the member is null.
fn in_query(name: &str, schema: &RefOr<Schema>) -> Parameter {
    let mut value = serde_json::to_value(schema).unwrap_or_default();
    let description = value
        .as_object_mut()
        .and_then(|object| object.remove("description"))
        .and_then(|text| text.as_str().map(str::to_owned));
    if let Some(Value::Array(types)) = value.get_mut("type") {
        types.retain(|name| name != "null");
        if let [only] = types.as_slice() {
            value["type"] = only.clone();
        }
    }
    let schema: Option<RefOr<Schema>> = serde_json::from_value(value).ok();
    ParameterBuilder::new()
        .name(name)
        .parameter_in(ParameterIn::Query)
        .required(Required::False)
        .description(description)
        .schema(schema)
        .build()
}

/// The description as YAML, as it stands in `openapi.yaml`.
pub fn openapi_yaml() -> Result<String> {
    Document::openapi()
        .to_yaml()
        .map_err(|error| Error::new(Kind::Internal, format_args!("the description cannot be written: {error}")))
}

/// This description
///
/// OpenAPI, as YAML.
#[utoipa::path(
    get, path = "/openapi.yaml", tag = "service", operation_id = "getOpenapi",
    responses(
        (status = 200, description = "The description", body = Object, content_type = "application/yaml"),
        (status = 500, response = Problematic),
    ),
)]
pub(super) async fn show() -> Answer {
    let yaml = openapi_yaml()?;
    Ok(([(header::CONTENT_TYPE, "application/yaml")], yaml).into_response())
}
