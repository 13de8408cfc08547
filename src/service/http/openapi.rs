//! The description of the interface, generated from the code: `openapi.yaml` here and `/openapi.yaml` on the service.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::error::Error as StdError;
use std::sync::{Arc, LazyLock};

use axum::http::header;
use axum::response::IntoResponse;
use serde_json::{Value, json};
use tesserae_mesh::artifacts::{self, Artifact, Form};
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::{Levels, Seeds, Snapshots};
use utoipa::openapi::path::{Parameter, ParameterIn};
use utoipa::openapi::security::SecurityScheme;
use utoipa::openapi::{self, Ref, RefOr, Schema};
use utoipa::{IntoParams as _, OpenApi, PartialSchema as _};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::guard::problem::{Answer, Problematic};
use crate::http::api::create::Binary;
use crate::http::api::outputs::{DerivedQuery, has_parameter};
use crate::http::api::{self, events};
use crate::http::state::Shared;
use crate::ingest::request::OF_JOB;
use crate::store::live::LabelsEvent;
use crate::work::urls;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Tesserae",
        description = "Clusters the faces of polygon meshes: a mesh in, one label a face and live energies out."
    ),
    components(
        schemas(events::StateEvent, events::EndEvent, LabelsEvent),
        responses(Problematic)
    ),
    tags(
        (name = "jobs", description = "Submit, follow, cancel"),
        (name = "results", description = "What a job gave"),
        (name = "service", description = "The service itself"),
    ),
)]
struct Document;

/// All routes of the service but the page's, and what the description says about them.
pub(crate) fn routes() -> OpenApiRouter<Arc<Shared>> {
    OpenApiRouter::with_openapi(Document::openapi()).merge(api::routes()).routes(routes!(show))
}

/// Adds what the derives cannot say: outputs come from their table, the members of `Parameters` are query parameters of
/// `POST /v1/jobs` too, no request carries a null, and seeds are no path here. Gives the whole as YAML.
fn complete(mut document: openapi::OpenApi) -> Result<String, Box<dyn StdError>> {
    let mut paths = json!(document.paths);
    let components = document.components.get_or_insert_default();
    for (name, schema) in add_outputs(&mut paths) {
        components.schemas.entry(name).or_insert(schema);
    }
    let token = json!({
        "type": "http",
        "scheme": "bearer",
        "description": "A token of the operator's; needed where the service runs with tokens, everywhere but at \
                        /healthz, /readyz, /v1/version and /openapi.yaml",
    });
    components.add_security_scheme("token", serde_json::from_value::<SecurityScheme>(token)?);
    // either without or with one: which of the two is the operator's choice
    document.security = serde_json::from_value(json!([{}, { "token": [] }]))?;
    let Some(RefOr::T(Schema::Object(parameters))) = components.schemas.get_mut("Parameters") else {
        return Err("Parameters have no schema".into());
    };
    if let Some(RefOr::T(Schema::Object(seeds))) = parameters.properties.get_mut("seeds") {
        let (path, part) = ("file:PATH with a list of face numbers", "listed, which is implied by a part `seeds`");
        seeds.description = seeds.description.take().map(|text| text.replace(path, part));
        let listed = [Seeds::Coarse, Seeds::Merged, Seeds::Morton, Seeds::Random, Seeds::Listed];
        seeds.enum_values = Some(listed.map(|seeds| json!(seeds)).into());
    }
    let mut of_jobs = parameters.clone();
    let members: Vec<Value> = of_jobs.properties.iter().map(|(name, schema)| in_query(name, &json!(schema))).collect();
    of_jobs.description = Some("The parameters of a job, as the JSON part of a form".to_owned());
    for parameter in paths["/v1/jobs"]["post"]["parameters"].as_array().into_iter().flatten() {
        let Some(name) = parameter["name"].as_str().filter(|name| OF_JOB.contains(name)) else { continue };
        let mut schema = parameter["schema"].clone();
        drop_null(&mut schema);
        if name == "outputs" {
            schema = json!({ "type": "array", "items": schema });
        }
        schema["description"] = parameter["description"].clone();
        of_jobs.properties.insert(name.to_owned(), serde_json::from_value(schema)?);
    }
    components.schemas.insert("JobParameters".to_owned(), Schema::from(of_jobs).into());
    for (path, item) in paths.as_object_mut().into_iter().flatten() {
        for (method, operation) in item.as_object_mut().into_iter().flatten() {
            let mut parameters = operation["parameters"].as_array().cloned().unwrap_or_default();
            parameters.iter_mut().for_each(|parameter| drop_null(&mut parameter["schema"]));
            if path.contains("{id}") {
                let schema = json!({ "type": "string", "format": "uuid" });
                let id = json!({
                    "name": "id", "in": "path", "description": "Id of the job", "required": true, "schema": schema,
                });
                parameters.insert(0, id);
            }
            if path == "/v1/jobs" && method == "post" {
                parameters.extend_from_slice(&members);
                add_formats(&mut operation["requestBody"]["content"]);
            }
            if !parameters.is_empty() {
                operation["parameters"] = parameters.into();
            }
            add_common_answers(path, method, &mut operation["responses"]);
        }
    }
    document.paths = serde_json::from_value(paths)?;
    Ok(quoted(&document.to_yaml()?))
}

/// The operation of an output without a handler of its own.
fn operation_of(artifact: &Artifact) -> Value {
    let (name, about) = (artifact.name, artifact.about);
    let capitals: String = name.split('-').map(|word| word[..1].to_uppercase() + &word[1..]).collect();
    let mut operation = json!({
        "tags": ["results"],
        "summary": format!("Get the {name}"),
        "description": format!("{about} 409 before the job has succeeded."),
        "operationId": format!("get{capitals}"),
        "responses": { "200": { "description": format!("The {name}") } },
    });
    if !artifact.is_made_of_input() {
        return operation;
    }
    operation["description"] = format!(
        "{about} It was named in `outputs` of the request for the job, or the job keeps its mesh or image \
         (`keep_mesh`); otherwise 404, `/problems/mesh-not-kept`. 409 before the job has succeeded, and for a whole \
         hierarchy without `clusters`."
    )
    .into();
    let parameters = DerivedQuery::into_params(|| Some(ParameterIn::Query)).into_iter();
    let parameters = parameters.filter(|parameter| has_parameter(artifact, &parameter.name));
    let described = parameters.map(|parameter: Parameter| {
        let mut parameter = json!(parameter);
        if parameter["name"] == "format" {
            let formats: Vec<&str> = artifact.forms.iter().map(Form::extension).collect();
            parameter["schema"] = json!({ "type": "string", "enum": formats });
        }
        parameter
    });
    operation["parameters"] = described.collect();
    operation
}

/// Adds the forms of every output to its operation; gives their schemas.
fn add_outputs(paths: &mut Value) -> artifacts::Schemas {
    let mut schemas = artifacts::Schemas::new();
    for artifact in artifacts::ALL.into_iter().filter(|artifact| artifact.is_served) {
        let item = &mut paths[urls::route(artifact)];
        if item.is_null() {
            *item = json!({ "get": operation_of(artifact) });
        }
        for form in artifact.forms {
            let schema = form.schema.map(|schema| Ref::from_schema_name(schema(&mut schemas)).into());
            let content = json!({ "schema": schema.unwrap_or_else(Binary::schema) });
            item["get"]["responses"]["200"]["content"][form.media_type] = content;
        }
    }
    schemas
}

/// Adds the media types of all formats to the content of a body, each with the schema of any bytes. The example is a
/// whole mesh of four faces, so that tools that read the description can make jobs that succeed.
fn add_formats(content: &mut Value) {
    for format in InputFormat::all() {
        for name in format.media_types() {
            content[name] = content["application/octet-stream"].clone();
            if format == InputFormat::Mesh(Format::Obj) {
                let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
                content[name]["example"] = tetrahedron.into();
            }
        }
    }
}

/// Adds what every path may answer, and what every result may.
fn add_common_answers(path: &str, method: &str, answers: &mut Value) {
    let Some(answers) = answers.as_object_mut() else { return };
    let is_probe = ["/healthz", "/readyz"].contains(&path);
    let output = artifacts::ALL.iter().find(|artifact| artifact.is_served && path == urls::route(artifact));
    let is_result = output.is_some() || path.ends_with("/upload");
    for (status, applies) in [
        ("414", true),
        ("421", true),
        ("422", true),
        ("429", !is_probe),
        ("503", path != "/healthz"),
        ("500", ["/v1/jobs", "/v1/workers", "/metrics", "/openapi.yaml"].iter().any(|start| path.starts_with(start))),
        ("404", path.contains("{id}")),
        ("401", !is_probe && !["/v1/version", "/openapi.yaml"].contains(&path)),
        ("403", path == "/metrics" || path.starts_with("/v1/workers") || method != "get"),
        ("408", path == "/v1/jobs"),
        ("406", output.is_some_and(|output| output.forms.len() > 1)),
        ("409", output.is_some()),
        ("416", is_result),
    ] {
        if applies {
            answers.entry(status).or_insert(json!(Ref::from_response_name("Problematic")));
        }
    }
    if is_result {
        answers.insert("304".into(), json!({ "description": "The client has it already (`If-None-Match`)" }));
        let mut part = answers["200"].clone();
        part["description"] = "The part of it that `Range` names".into();
        answers.insert("206".into(), part);
    }
}

/// A member of a schema as a query parameter; its description moves up.
fn in_query(name: &str, schema: &Value) -> Value {
    // a list of numbers in a query is text
    let as_text = |pattern: &str, example: &str| json!({ "type": "string", "pattern": pattern, "examples": [example] });
    let mut in_query = match name {
        "levels" => as_text(Levels::PATTERN, "2000,1000"),
        "snapshots" => as_text(Snapshots::PATTERN, "0,6,46"),
        _ => schema.clone(),
    };
    drop_null(&mut in_query);
    if let Some(schema) = in_query.as_object_mut() {
        schema.remove("description");
    }
    let description = &schema["description"];
    json!({ "name": name, "in": "query", "description": description, "required": false, "schema": in_query })
}

/// Takes the null out of the type of a schema.
fn drop_null(schema: &mut Value) {
    if let Some(Value::Array(types)) = schema.get_mut("type") {
        types.retain(|name| name != "null");
        if let [only] = &types[..] {
            schema["type"] = only.clone();
        }
    }
}

/// The description as YAML, as it stands in `openapi.yaml`.
pub fn openapi_yaml() -> Result<String> {
    complete(routes().into_openapi())
        .map_err(|error| Error::internal(format_args!("the description cannot be written: {error}")))
}

/// This description
///
/// OpenAPI, as YAML.
#[utoipa::path(
    get, path = "/openapi.yaml", tag = "service", operation_id = "getOpenapi",
    responses((status = 200, description = "The description", body = Object, content_type = "application/yaml")),
)]
pub(crate) async fn show() -> Answer {
    static YAML: LazyLock<Result<String>> = LazyLock::new(openapi_yaml);
    let yaml = YAML.as_deref().map_err(Error::clone)?;
    Ok(([(header::CONTENT_TYPE, "application/yaml")], yaml).into_response())
}

/// Quotes the words that YAML 1.1, which many programs read, takes for booleans, where they are values.
fn quoted(yaml: &str) -> String {
    let line = |line: &str| match line.rsplit_once(' ') {
        Some((head, word @ ("on" | "off" | "yes" | "no" | "y" | "n"))) if head.ends_with(['-', ':']) => {
            format!("{head} '{word}'\n")
        }
        _ => format!("{line}\n"),
    };
    yaml.lines().map(line).collect()
}

#[cfg(test)]
#[test]
fn words_that_are_values_are_quoted_and_texts_are_not() {
    let yaml = quoted("enum:\n- off\n- obj\ndefault: on\ntext: on and off\n");
    assert_eq!(yaml, "enum:\n- 'off'\n- obj\ndefault: 'on'\ntext: on and off\n");
}
