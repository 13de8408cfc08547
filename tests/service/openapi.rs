//! `openapi.yaml` against the code, and the service against `openapi.yaml`.

use std::path::Path;

use tesserae_mesh::artifacts::{self, LABELS_PNG, Need};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::Format;

use crate::support::Service;

const TETRAHEDRON: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// Fails when the file and the code differ. `UPDATE_OPENAPI=1 cargo test --test service openapi` writes the file.
#[test]
fn openapi_yaml_is_what_the_code_says() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openapi.yaml");
    let generated = tesserae_service::openapi_yaml().expect("a description");
    if std::env::var_os("UPDATE_OPENAPI").is_some() {
        std::fs::write(&path, &generated).expect("written");
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    let same = kept == generated;
    assert!(same, "openapi.yaml is out of date: run UPDATE_OPENAPI=1 cargo test --test service openapi");
}

#[tokio::test]
async fn the_service_serves_its_description_and_answers_at_every_path_of_it() {
    let service = Service::start().await;
    let response = service.get("/openapi.yaml").send().await.expect("answered");
    assert_eq!(response.headers()["content-type"], "application/yaml");
    let yaml = response.text().await.expect("text");
    assert_eq!(yaml, tesserae_service::openapi_yaml().expect("a description"));
    for note in ["P§", "DESIGN", "Eq."] {
        assert!(!yaml.contains(note), "{note} says nothing to who reads this");
    }
    let paths: Vec<&str> =
        yaml.lines().filter_map(|line| line.strip_prefix("  /")).filter_map(|line| line.strip_suffix(':')).collect();
    assert!(paths.len() >= 13, "{paths:?}");
    for path in paths {
        let path = format!("/{path}").replace("{id}", "00000000-0000-4000-8000-000000000000");
        let response = service.get(&path).send().await.expect("answered");
        let detail = response.text().await.expect("text");
        assert!(!detail.contains("nothing at this path"), "{path}: {detail}");
    }
    // tools that read the description can make a job of it that succeeds
    let example =
        yaml.split_once("model/obj:").and_then(|(_, rest)| rest.split_once("example:")).expect("an example").1;
    assert!(example.trim_start().starts_with('|') && example.contains("f 2 3 4"), "{}", &example[..200]);
    let job = service.submit("clusters=2", TETRAHEDRON.to_vec());
    assert_eq!(service.ended(&job.await).await["state"], "succeeded");
    for name in ["clusters", "algorithm", "seeds", "max_iterations", "allow_disconnected", "format", "levels", "ties"] {
        assert!(yaml.contains(&format!("- name: {name}\n")), "{name} is no query parameter");
    }
}

/// A format that is added to the table is named everywhere; a text that is written by hand and forgets it fails here.
#[tokio::test]
async fn every_place_that_lists_formats_has_exactly_those_of_the_table() {
    let service = Service::start().await;
    let names = Format::ALL.map(Format::name);
    let types: Vec<&str> = InputFormat::all().flat_map(InputFormat::media_types).copied().collect();

    let response = service.post("/v1/jobs?clusters=1").body("x").header("content-type", "model/none").send().await;
    let response = response.expect("answered");
    assert_eq!(response.status(), 415);
    let listed = response.headers()["accept-post"].to_str().expect("text").to_owned();
    let containers = ["multipart/form-data", "application/octet-stream"];
    let (others, files): (Vec<&str>, Vec<&str>) = listed.split(", ").partition(|name| containers.contains(name));
    assert_eq!((files, others), (types.clone(), containers.to_vec()));
    assert!(response.text().await.expect("text").contains(&listed), "the detail lists the same");

    let formats: serde_json::Value =
        service.get("/v1/formats").send().await.expect("answered").json().await.expect("JSON");
    let expected =
        Format::ALL.map(|format| serde_json::json!({"name": format.name(), "media_type": format.media_type()}));
    assert_eq!(formats["meshes"], serde_json::json!(expected));

    let yaml = tesserae_service::openapi_yaml().expect("a description");
    let body = yaml.split_once("requestBody:").and_then(|(_, rest)| rest.split_once("responses:")).expect("a body").0;
    let keys = body.lines().filter_map(|line| line.strip_prefix("          ")?.strip_suffix(':'));
    let is_type = |key: &&str| !key.starts_with(' ') && !containers.contains(key);
    let mut in_yaml: Vec<&str> = keys.filter(is_type).collect();
    let mut sorted = types.clone();
    in_yaml.sort_unstable();
    sorted.sort_unstable();
    assert_eq!(in_yaml, sorted);
    let all: Vec<&str> = InputFormat::all().map(InputFormat::name).collect();
    for (schema, names) in [("Format", &names[..]), ("InputFormat", &all)] {
        let schema = yaml.split_once(&format!("\n    {schema}:\n")).expect("a schema").1;
        let values =
            schema.split_once("enum:\n").expect("values").1.lines().map_while(|line| line.trim().strip_prefix("- "));
        let values = values.map(|value| value.trim_matches('\''));
        assert_eq!(values.collect::<Vec<_>>(), names);
    }
}

/// An output that is added to the table is served and described with no other change.
#[tokio::test]
async fn every_output_of_the_table_has_its_route_with_exactly_its_media_types() {
    let service = Service::start().await;
    let job = service.submit("algorithm=hr&clusters=1&keep_mesh=true", TETRAHEDRON.to_vec()).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded");
    let yaml = tesserae_service::openapi_yaml().expect("a description");
    for artifact in artifacts::ALL {
        let name = artifact.name;
        let path = format!("\n  /v1/jobs/{{id}}/{name}:\n");
        assert_eq!(yaml.contains(&path), artifact.is_served, "{name}");
        let Some((_, operation)) = yaml.split_once(&path) else { continue };
        let answer = operation.split_once("'200':").and_then(|(_, rest)| rest.split_once("        '206':"));
        let lines = answer.expect("an answer").0.lines();
        let is_type = |name: &&str| !name.starts_with(' ') && name.contains('/');
        let described: Vec<&str> =
            lines.filter_map(|line| line.strip_prefix("            ")?.strip_suffix(':')).filter(is_type).collect();
        let mut types: Vec<&str> = artifact.forms.iter().map(|form| form.media_type).collect();
        types.dedup();
        assert_eq!(described, types, "{name}");
        if artifact.needs.contains(&Need::Image) {
            // no output of a mesh
            assert!(job["urls"].get(name).is_none());
            continue;
        }
        let url = job["urls"][name].as_str().expect(name);
        for form in artifact.forms {
            // a closed surface in one cluster has no boundaries
            let cut = if artifact.needs.contains(&Need::Mesh) { "&clusters=2" } else { "" };
            let query =
                if artifact.forms.len() > 1 { format!("?format={}{cut}", form.extension()) } else { String::new() };
            let response = service.get(&format!("{url}{query}")).send().await.expect("answered");
            if form.file == LABELS_PNG.file {
                // of images alone
                assert_eq!(response.status(), 409);
                continue;
            }
            assert_eq!(
                (response.status().as_u16(), response.headers()["content-type"].to_str().expect("text")),
                (200, form.media_type)
            );
            let saved_as = response.headers().get("content-disposition").map(|value| value.to_str().expect("text"));
            let is_saved = artifact.forms.len() > 1 || artifact.needs.contains(&Need::Mesh);
            assert_eq!(saved_as.is_some(), is_saved, "{name}");
            assert!(saved_as.is_none_or(|value| value.ends_with(&format!("-{}\"", form.file))), "{saved_as:?}");
        }
    }
}
