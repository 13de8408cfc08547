//! What the service says about itself to a dashboard.

use std::collections::{BTreeMap, BTreeSet};

use tesserae_mesh::device::cpu::CpuDevice;

use crate::support::*;

#[tokio::test]
async fn work_shows_in_the_metrics() {
    let service = Service::with(|settings| settings.max_upload_bytes = 100_000, Box::new(CpuDevice::new())).await;
    let job = service.submit("clusters=7", sphere(300)).await;
    service.ended(&job).await;
    let tree = service.submit("algorithm=pml", sphere(300)).await;
    service.ended(&tree).await;
    let _ = service.get("/v1/jobs/nothing").send().await;
    let _ = service.post("/v1/jobs?clusters=0").body("x").send().await;
    let response = service.get("/metrics").send().await.expect("answered");
    assert!(response.headers()["content-type"].to_str().expect("text").starts_with("application/openmetrics-text"));
    let text = response.text().await.expect("text");
    for line in [
        "tesserae_jobs{state=\"succeeded\"} 2",
        "tesserae_jobs{state=\"queued\"} 0",
        "tesserae_queue_wait_seconds_count 2",
        "tesserae_job_seconds_count{algorithm=\"bb\",state=\"succeeded\"} 1",
        "tesserae_job_stage_seconds_count{algorithm=\"pml\",stage=\"write\"} 1",
        "tesserae_job_stage_seconds_count{algorithm=\"bb\",stage=\"cluster\"} 1",
        "tesserae_http_requests_total{method=\"POST\",route=\"/v1/jobs\",status=\"202\"} 2",
        "tesserae_http_requests_total{method=\"GET\",route=\"/v1/jobs/{id}\",status=\"404\"} 1",
        "tesserae_rejections_total{reason=\"invalid-parameter\"} 1",
        "tesserae_rejections_total{reason=\"not-found\"} 1",
        "tesserae_store_seconds_count{operation=\"create\"} 2",
        "tesserae_ready 1",
        "tesserae_queue_limit 1024",
        "tesserae_stuck_jobs 0",
        "tesserae_queue_oldest_seconds 0.0",
        "tesserae_condition{part=\"device\",severity=\"failing\"} 0",
        "# EOF",
    ] {
        assert!(text.lines().any(|found| found == line), "{line} is missing:\n{text}");
    }
    assert!(metric(&service, "tesserae_device_busy_seconds_total").await > 0.0);
    assert!(metric(&service, "tesserae_iterations_total{algorithm=\"bb\"}").await > 0.0);
    assert!(metric(&service, "tesserae_faces_total{algorithm=\"bb\"}").await >= 300.0);
    assert!(metric(&service, "process_resident_memory_bytes").await > 1e6);
    assert!(metric(&service, "tesserae_disk_free_bytes").await > 1e6);
    assert!(metric(&service, "process_cpu_seconds_total").await > 0.0);
    assert!(metric(&service, "process_open_fds").await > 3.0);
    assert!(metric(&service, "process_max_fds").await > 3.0);
    assert_eq!(metric(&service, "tesserae_device_memory_bytes").await, 0.0, "the cpu has none of its own");
    // neither jobs nor paths are labels
    assert!(!text.contains(text_of(&job)) && !text.contains("/v1/jobs/nothing"), "{text}");
}

fn text_of(job: &serde_json::Value) -> &str {
    text(&job["id"])
}

/// Metrics that a service gives which has done some work: their names as in queries, and their names and kinds.
async fn given() -> (BTreeSet<String>, BTreeMap<String, String>) {
    let service = Service::start().await;
    let job = service.submit("clusters=5", sphere(300)).await;
    service.ended(&job).await;
    let _ = service.get("/nothing").send().await;
    let text = service.get("/metrics").send().await.expect("answered").text().await.expect("text");
    let mut there = BTreeSet::new();
    let mut kind_of = BTreeMap::new();
    for line in text.lines() {
        if let Some((name, kind)) = line.strip_prefix("# TYPE ").and_then(|rest| rest.split_once(' ')) {
            kind_of.insert(name.to_owned(), kind.to_owned());
        }
    }
    for (name, kind) in &kind_of {
        let suffixes: &[&str] = match kind.as_str() {
            "counter" => &["_total"],
            "histogram" => &["_bucket", "_sum", "_count"],
            _ => &[""],
        };
        there.extend(suffixes.iter().map(|suffix| format!("{name}{suffix}")));
    }
    (there, kind_of)
}

/// Names of metrics in a query.
fn names(expression: &str) -> impl Iterator<Item = &str> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let words = expression.split(move |c| !is_name(c));
    words.filter(|word| word.starts_with("tesserae_") || word.starts_with("process_"))
}

/// The text of a file in `deploy/`.
fn deployed(name: &str) -> String {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy").join(name);
    std::fs::read_to_string(path).expect("a file")
}

/// The queries of a dashboard.
fn queries(dashboard: &str) -> Vec<String> {
    let dashboard: serde_json::Value = serde_json::from_str(&deployed(dashboard)).expect("JSON");
    let mut expressions = Vec::new();
    collect(&dashboard, &mut expressions);
    assert!(expressions.len() > 15, "{}", expressions.len());
    expressions
}

/// Names of metrics in the dashboards must be names that the service gives.
#[tokio::test]
async fn the_dashboards_draw_metrics_that_there_are() {
    let (there, kind_of) = given().await;
    for expression in queries("grafana-farm.json") {
        assert!(names(&expression).count() > 0 && expression.contains("job=\"$farm\""), "{expression}");
        for name in names(&expression) {
            assert!(there.contains(name), "{name} in {expression} is none of {there:#?}");
        }
    }
    let expressions = queries("grafana.json");
    let mut drawn = BTreeSet::new();
    for expression in &expressions {
        for name in names(expression) {
            assert!(there.contains(name), "{name} in {expression} is none of {there:#?}");
            drawn.insert(name.to_owned());
        }
    }
    // and what is counted is drawn
    for name in kind_of.keys() {
        assert!(drawn.iter().any(|drawn| drawn.starts_with(name.as_str())), "{name} is not on the dashboard");
    }
}

/// Alert rules must name metrics that the service gives, or they never fire.
#[tokio::test]
async fn alert_rules_are_about_metrics_that_there_are() {
    let rules = deployed("alerts.yaml") + &deployed("farm-alerts.yaml");
    // an expression ends before the labels of its rule
    let expressions: Vec<&str> =
        rules.split(" expr: ").skip(1).filter_map(|rest| rest.split(" labels: ").next()).collect();
    assert!(expressions.len() >= 10, "{expressions:#?}");
    let (there, _) = given().await;
    for expression in expressions {
        for name in names(expression) {
            assert!(there.contains(name), "{name} in {expression} is none of {there:#?}");
        }
    }
}

fn collect(value: &serde_json::Value, expressions: &mut Vec<String>) {
    match value {
        serde_json::Value::Object(object) => {
            for (name, value) in object {
                match value {
                    serde_json::Value::String(text) if name == "expr" => expressions.push(text.clone()),
                    value => collect(value, expressions),
                }
            }
        }
        serde_json::Value::Array(array) => array.iter().for_each(|value| collect(value, expressions)),
        _ => {}
    }
}
