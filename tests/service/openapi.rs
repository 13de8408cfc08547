//! `openapi.yaml` against the code, and the service against `openapi.yaml`.

use std::path::Path;

use crate::support::Service;

/// Fails when the file and the code differ. `UPDATE_OPENAPI=1 cargo test --test service openapi` writes the file.
#[test]
fn openapi_yaml_is_what_the_code_says() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("openapi.yaml");
    let generated = tesserae::service::openapi_yaml().expect("a description");
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
    assert_eq!(yaml, tesserae::service::openapi_yaml().expect("a description"));
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
    let job = service
        .submit("clusters=2", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n".to_vec());
    assert_eq!(service.ended(&job.await).await["state"], "succeeded");
    for name in ["clusters", "algorithm", "seeds", "max_iterations", "allow_disconnected", "format", "levels", "ties"] {
        assert!(yaml.contains(&format!("- name: {name}\n")), "{name} is no query parameter");
    }
}
