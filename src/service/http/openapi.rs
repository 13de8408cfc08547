//! The description of the interface, generated from the code: `openapi.yaml` in the repository and `/openapi.yaml` on
//! the service.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::http::header;
use axum::response::IntoResponse;
use serde_json::{Value, json};
use tesserae_mesh::artifacts::{self, Artifact, Form};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::{Levels, Seeds, Snapshots};
use utoipa::openapi::path::{HttpMethod, Operation, OperationBuilder, Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::request_body::RequestBody;
use utoipa::openapi::schema::{ArrayBuilder, ObjectBuilder, Type};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{self, Ref, RefOr, Required, Response, ResponseBuilder, Schema};
use utoipa::{IntoParams as _, OpenApi, PartialSchema as _};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::guard::problem::{Answer, Problematic};
use crate::http::api::binary::Binary;
use crate::http::api::derived::DerivedQuery;
use crate::http::api::{self, events};
use crate::http::state::Shared;
use crate::store::PRIORITIES;
use crate::store::live::LabelsEvent;
use crate::work::urls;

/// A whole mesh of four faces, so that tools that read the description can make jobs that succeed.
const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

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
/// `POST /v1/jobs` too, no request carries a null, and seeds are no path here.
fn complete(document: &mut openapi::OpenApi) {
    add_outputs(document);
    let Some(components) = document.components.as_mut() else { return };
    let token = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(
        "A token of the operator's; needed where the service runs with tokens, everywhere but at /healthz, \
         /readyz, /v1/version and /openapi.yaml",
    ));
    components.add_security_scheme("token", SecurityScheme::Http(token.build()));
    // either without or with one: which of the two is the operator's choice
    let with_token = SecurityRequirement::new("token", Vec::<String>::new());
    document.security = Some(vec![SecurityRequirement::default(), with_token]);
    let schemas = &mut components.schemas;
    let Some(RefOr::T(Schema::Object(parameters))) = schemas.get_mut("Parameters") else {
        return;
    };
    if let Some(RefOr::T(Schema::Object(seeds))) = parameters.properties.get_mut("seeds") {
        let on_the_command_line = seeds.description.take().unwrap_or_default();
        seeds.description = Some(
            on_the_command_line
                .replace("file:PATH with a list of face numbers", "listed, which is implied by a part `seeds`"),
        );
        seeds.enum_values = Some(
            [Seeds::Coarse, Seeds::Merged, Seeds::Morton, Seeds::Random, Seeds::Listed]
                .map(|seeds| json!(seeds))
                .into(),
        );
    }
    let mut of_jobs = parameters.clone();
    let members: Vec<_> = of_jobs.properties.iter().map(|(name, schema)| in_query(name, schema)).collect();
    of_jobs.description = Some("The parameters of a job, as the JSON part of a form".to_owned());
    let webhook = ObjectBuilder::new()
        .schema_type(Type::String)
        .description(Some("URL that is called at the end of the job; on a host that the operator allows"));
    let priority = ObjectBuilder::new()
        .schema_type(Type::Integer)
        .minimum(Some(*PRIORITIES.start()))
        .maximum(Some(*PRIORITIES.end()))
        .description(Some("Of your waiting jobs, those with a higher priority start first; 0 when left out"));
    of_jobs.properties.insert("priority".to_owned(), Schema::from(priority).into());
    let outputs = ArrayBuilder::new()
        .items(ObjectBuilder::new().schema_type(Type::String))
        .description(Some("Files to make of the mesh, which is gone when the job has ended"));
    of_jobs.properties.insert("outputs".to_owned(), Schema::from(outputs).into());
    let keep_mesh = ObjectBuilder::new()
        .schema_type(Type::Boolean)
        .description(Some("Keep the mesh or the image with the result, so that every output can be made of it later"));
    of_jobs.properties.insert("keep_mesh".to_owned(), Schema::from(keep_mesh).into());
    of_jobs.properties.insert("webhook".to_owned(), Schema::from(webhook).into());
    schemas.insert("JobParameters".to_owned(), Schema::from(of_jobs).into());
    for (path, item) in &mut document.paths.paths {
        for operation in [&mut item.get, &mut item.post, &mut item.delete].into_iter().flatten() {
            if path.contains("{id}") {
                operation.parameters.get_or_insert_default().insert(0, id_in(path).into());
            }
            add_common_answers(path, &mut operation.responses.responses);
        }
        for operation in [&mut item.get, &mut item.post, &mut item.delete].into_iter().flatten() {
            for parameter in operation.parameters.iter_mut().flatten() {
                if let RefOr::T(parameter) = parameter {
                    parameter.schema = parameter.schema.as_ref().and_then(without_null);
                }
            }
        }
        if let Some(post) = item.post.as_mut().filter(|_| path == "/v1/jobs") {
            if let Some(RefOr::T(body)) = &mut post.request_body {
                add_formats(body);
            }
            post.parameters.get_or_insert_default().extend(members.iter().cloned().map(RefOr::from));
        }
    }
}

/// The id in the path of a job's or a worker's resources.
fn id_in(path: &str) -> Parameter {
    let id =
        ObjectBuilder::new().schema_type(Type::String).format(Some(openapi::SchemaFormat::Custom("uuid".to_owned())));
    ParameterBuilder::new()
        .name("id")
        .parameter_in(ParameterIn::Path)
        .required(Required::True)
        .description(Some(format!("Id of the {}", path.split('/').nth(2).unwrap_or_default().trim_end_matches('s'))))
        .schema(Some(Schema::from(id)))
        .build()
}

/// The operation of an output without a handler of its own.
fn operation_of(artifact: &Artifact) -> Operation {
    let name = artifact.name;
    let capitals: String = name.split('-').map(|word| word[..1].to_uppercase() + &word[1..]).collect();
    let operation = OperationBuilder::new()
        .tag("results")
        .summary(Some(format!("Get the {name}")))
        .operation_id(Some(format!("get{capitals}")))
        .response("200", ResponseBuilder::new().description(format!("The {name}")));
    if !artifact.is_made_of_input() {
        return operation.description(Some(format!("{} 409 before the job has succeeded.", artifact.about))).build();
    }
    let operation = operation.description(Some(format!(
        "{} It was named in `outputs` of the request for the job, or the job keeps its mesh or image (`keep_mesh`); \
             otherwise 404, `/problems/mesh-not-kept`. 409 before the job has succeeded, and for a whole hierarchy \
             without `clusters`.",
        artifact.about
    )));
    let applies = |name: &str| {
        ["format", "clusters"].contains(&name) || artifact.choices.iter().any(|choice| choice.name() == name)
    };
    let parameters = DerivedQuery::into_params(|| Some(ParameterIn::Query)).into_iter();
    let with_formats = |mut parameter: Parameter| {
        if parameter.name == "format" {
            let formats = artifact.forms.iter().map(Form::extension);
            let formats = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(formats));
            parameter.schema = Some(Schema::from(formats).into());
        }
        parameter
    };
    let parameters = parameters.filter(|parameter| applies(&parameter.name)).map(with_formats);
    parameters.fold(operation, OperationBuilder::parameter).build()
}

/// Adds the forms of every output to its operation, and their schemas.
fn add_outputs(document: &mut openapi::OpenApi) {
    let mut schemas = artifacts::Schemas::new();
    for artifact in artifacts::ALL.into_iter().filter(|artifact| artifact.is_served) {
        let path = urls::route(artifact);
        if document.paths.get_path_item(&path).is_none() {
            document.paths.add_path_operation(&path, vec![HttpMethod::Get], operation_of(artifact));
        }
        let operation = document.paths.paths.get_mut(&path).and_then(|item| item.get.as_mut());
        let answer = operation.and_then(|operation| operation.responses.responses.get_mut("200"));
        let Some(RefOr::T(answer)) = answer else { continue };
        for form in artifact.forms {
            let schema = form.schema.map(|schema| Ref::from_schema_name(schema(&mut schemas)).into());
            let content = openapi::ContentBuilder::new().schema(Some(schema.unwrap_or_else(Binary::schema))).build();
            answer.content.insert(form.media_type.to_owned(), content.into());
        }
    }
    let components = document.components.get_or_insert_default();
    for (name, schema) in schemas {
        components.schemas.entry(name).or_insert(schema);
    }
}

/// Adds the media types of all formats to a body, each with the schema of any bytes.
fn add_formats(body: &mut RequestBody) {
    let Some(RefOr::T(bytes)) = body.content.get("application/octet-stream").cloned() else { return };
    for format in InputFormat::all() {
        let mut content = bytes.clone();
        content.example = (format == InputFormat::Mesh(Format::Obj)).then(|| json!(TETRAHEDRON));
        for name in format.media_types() {
            body.content.insert((*name).to_owned(), content.clone().into());
        }
    }
}

/// Adds what every path may answer, and what every result may.
fn add_common_answers(path: &str, answers: &mut BTreeMap<String, RefOr<Response>>) {
    let problem = || RefOr::from(Ref::from_response_name("Problematic"));
    let mut add = |status: &str, answer: RefOr<Response>| {
        answers.entry(status.to_owned()).or_insert(answer);
    };
    // of the query string
    for status in ["414", "422"] {
        add(status, problem());
    }
    if ["/healthz", "/readyz"].contains(&path) {
        return;
    }
    if ["/v1/jobs", "/v1/workers"].iter().any(|of| path.starts_with(of)) {
        add("500", problem());
    }
    if path.contains("{id}") {
        add("404", problem());
    }
    for status in ["429", "503"] {
        add(status, problem());
    }
    if !["/v1/version", "/openapi.yaml"].contains(&path) {
        add("401", problem());
    }
    if path == "/metrics" || path.starts_with("/v1/workers") {
        add("403", problem());
    }
    if path == "/v1/jobs" {
        add("408", problem());
    }
    let is_its = |artifact: &&&Artifact| artifact.is_served && path == urls::route(artifact);
    if let Some(artifact) = artifacts::ALL.iter().find(is_its) {
        if artifact.forms.len() > 1 {
            add("406", problem());
        }
        add("409", problem());
        let unchanged = ResponseBuilder::new().description("The client has it already (`If-None-Match`)");
        add("304", unchanged.build().into());
        add("416", problem());
        if let Some(RefOr::T(whole)) = answers.get("200") {
            let mut part = whole.clone();
            "The part of it that `Range` names".clone_into(&mut part.description);
            answers.entry("206".to_owned()).or_insert(part.into());
        }
    }
}

/// A member of a schema as a query parameter; its description moves up.
fn in_query(name: &str, schema: &RefOr<Schema>) -> Parameter {
    let mut schema = schema.clone();
    match name {
        "levels" => schema = list_in_query(&schema, Levels::PATTERN, "2000,1000"),
        "snapshots" => schema = list_in_query(&schema, Snapshots::PATTERN, "0,6,46"),
        _ => {}
    }
    let description = match &mut schema {
        RefOr::T(Schema::Object(schema)) => schema.description.take(),
        RefOr::Ref(reference) => Some(std::mem::take(&mut reference.description)),
        RefOr::T(_) => None,
    };
    ParameterBuilder::new()
        .name(name)
        .parameter_in(ParameterIn::Query)
        .required(Required::False)
        .description(description)
        .schema(without_null(&schema))
        .build()
}

/// A list of numbers in a query is text.
fn list_in_query(schema: &RefOr<Schema>, pattern: &'static str, example: &str) -> RefOr<Schema> {
    let description = match schema {
        RefOr::T(Schema::OneOf(schema)) => schema.description.clone(),
        RefOr::T(_) | RefOr::Ref(_) => None,
    };
    let text = ObjectBuilder::new()
        .schema_type(Type::String)
        .pattern(Some(pattern))
        .description(description)
        .examples([json!(example)]);
    Schema::from(text).into()
}

/// A schema less the null of its type.
fn without_null(schema: &RefOr<Schema>) -> Option<RefOr<Schema>> {
    let mut schema = serde_json::to_value(schema).ok()?;
    if let Some(Value::Array(types)) = schema.get_mut("type") {
        types.retain(|name| name != "null");
        if let [only] = types.as_slice() {
            schema["type"] = only.clone();
        }
    }
    serde_json::from_value(schema).ok()
}

/// The description as YAML, as it stands in `openapi.yaml`.
pub fn openapi_yaml() -> Result<String> {
    let mut document = routes().into_openapi();
    complete(&mut document);
    document
        .to_yaml()
        .map(|yaml| quoted(&yaml))
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
pub(crate) async fn show() -> Answer {
    let yaml = openapi_yaml()?;
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
    let (yaml, expected) = (
        "enum:\n- off\n- obj\ndefault: on\ntext: on and off\n",
        "enum:\n- 'off'\n- obj\ndefault: 'on'\ntext: on and off\n",
    );
    assert_eq!(quoted(yaml), expected);
}
