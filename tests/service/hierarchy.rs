//! Hierarchies over HTTP: rounds as they happen, cuts, the tree in its forms.

use reqwest::Response;
use serde_json::{Value, json};
use tesserae_mesh::dev::sample::{self, Sample};
use tesserae_mesh::device::Device;
use tesserae_mesh::error::{Error, Kind};
use tesserae_mesh::hierarchy::stored::Stored;
use tesserae_mesh::report::DeviceKind;
use tesserae_mesh::surface::DualGraph;

use crate::support::*;

/// A service and a job that succeeded there.
async fn done(query: &str, mesh: Vec<u8>) -> (Service, Value) {
    let service = Service::start().await;
    let job = service.submit(query, mesh).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    (service, job)
}

async fn get(service: &Service, url: &str, accept: &str) -> Response {
    let response = service.get(url).header("accept", accept).send().await.expect("answered");
    assert_eq!(response.status(), 200, "{url}");
    assert_eq!(response.headers()["content-type"], accept);
    response
}

async fn bytes(service: &Service, url: &str, accept: &str) -> Vec<u8> {
    let response = get(service, url, accept).await;
    let length: usize = response.headers()["content-length"].to_str().expect("text").parse().expect("a number");
    let body = response.bytes().await.expect("bytes").to_vec();
    assert_eq!(body.len(), length);
    body
}

fn numbers(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|four| u32::from_le_bytes(four.try_into().expect("four bytes"))).collect()
}

#[tokio::test]
async fn a_whole_hierarchy_has_labels_at_every_number_of_clusters() {
    let (service, job) = done("algorithm=pml&levels=200,60", sphere(1000)).await;
    let labels = text(&job["urls"]["labels"]);
    let faces = job["result"]["faces"].as_u64().expect("a number");
    let detail = refused(service.get(labels), 409, "conflict").await;
    assert!(detail.contains(&format!("from 1 to {faces}")), "{detail}");

    let stored = bytes(&service, text(&job["urls"]["hierarchy"]), "application/octet-stream").await;
    let tree = Stored::read(stored.as_slice(), stored.len() as u64, u64::MAX).expect("a hierarchy").tree;
    let mut kinds = [0, 0];
    for clusters in [1, 2, 59, 60, 61, 199, 200, 201, 500, faces] {
        let url = format!("{labels}?clusters={clusters}");
        let cut = tree.labels_at(clusters).expect("within the tree");
        let response = get(&service, &url, "application/json").await;
        assert_eq!(response.headers()["tesserae-cut"], cut.kind());
        let energy: f64 = response.headers()["tesserae-energy"].to_str().expect("text").parse().expect("a number");
        assert_eq!(energy, cut.energy);
        let json: Value = response.json().await.expect("JSON");
        assert_eq!((&json["clusters"], &json["cut"]), (&clusters.into(), &cut.kind().into()));
        // JSON is read here to all but the last digit
        let energy = json["energy"].as_f64().expect("a number");
        assert!((energy - cut.energy).abs() <= 1e-14 * cut.energy, "{energy} {}", cut.energy);
        assert_eq!(json["labels"], serde_json::json!(cut.labels));
        assert_eq!(numbers(&bytes(&service, &url, "application/octet-stream").await), cut.labels);
        let npy = bytes(&service, &url, "application/x-npy").await;
        assert_eq!(numbers(&npy[128..]), cut.labels);
        kinds[usize::from(cut.extra_merges > 0)] += 1;
    }
    assert!(kinds[0] >= 3 && kinds[1] >= 3, "{kinds:?}");
    for clusters in [0, faces + 1, u64::MAX - 1] {
        let detail = refused(service.get(&format!("{labels}?clusters={clusters}")), 409, "conflict").await;
        assert!(detail.contains("between the 1 ") && detail.contains(&faces.to_string()), "{detail}");
    }
    refused(service.get(&format!("{labels}?clusters=5")).header("accept", "image/gif"), 406, "not-acceptable").await;
}

#[tokio::test]
async fn rounds_are_events_and_rows_of_the_report() {
    let (service, job) = done("algorithm=pml&clusters=20&switch_to_ml_at=40", sphere(1000)).await;
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    let stream = service.get(text(&job["urls"]["events"])).send().await.expect("answered").text().await.expect("text");
    let rows: Vec<Value> = stream
        .split("\n\n")
        .filter(|event| event.contains("event: round\n"))
        .filter_map(|event| event.lines().find_map(|line| line.strip_prefix("data: ")))
        .map(|data| serde_json::from_str(data).expect("JSON"))
        .collect();
    assert_eq!(report["levels"], Value::Array(rows.clone()));
    let last = rows.last().expect("there are rounds");
    assert_eq!(last["clusters"], 20);
    assert_eq!((&job["progress"]["rounds"], &job["progress"]["clusters_left"]), (&last["round"], &last["clusters"]));
    assert_eq!(job["progress"]["energy"], last["energy"]);
    let left = |row: &Value| row["clusters"].as_u64().expect("a number");
    let sequential: Vec<&[Value]> = rows.windows(2).filter(|pair| left(&pair[0]) <= 40).collect();
    assert!(sequential.len() > 5 && sequential.iter().all(|pair| pair[1]["merges"] == 1), "{rows:?}");
    let rounds = report["iterations"].as_array().expect("a list").iter().map(|row| row["round"].as_u64());
    assert!(rounds.clone().count() > 0 && rounds.clone().all(|round| round.is_some()));
    // it ended at a number, where it has labels of its own
    let own = json(service.get(text(&job["urls"]["labels"]))).await;
    let cut = json(service.get(&format!("{}?clusters=20", text(&job["urls"]["labels"])))).await;
    assert_eq!((&own["labels"], &own["cut"]), (&cut["labels"], &Value::Null));
    assert_eq!(cut["cut"], "exact");
}

#[tokio::test]
async fn the_tree_comes_as_json_as_much_of_it_as_is_asked_for() {
    let (service, job) = done("algorithm=pml&optimize=none", sphere(600)).await;
    let url = text(&job["urls"]["hierarchy"]);
    let whole = json(service.get(url)).await;
    let faces = whole["faces"].as_u64().expect("a number");
    assert_eq!(whole["algorithm"], "pml");
    assert_eq!(whole["parameters"], job["parameters"]);
    let nodes = whole["nodes"].as_array().expect("a list");
    assert_eq!(nodes.len() as u64, faces - 1);
    let part = json(service.get(&format!("{url}?min_clusters=10&max_clusters=19"))).await;
    let from = nodes.iter().position(|node| node["clusters_left"] == 19).expect("it is there");
    assert_eq!(part["nodes"], Value::Array(nodes[from..from + 10].to_vec()));
    assert_eq!(part["roots"].as_array().map(Vec::len), Some(10));
    let cut = json(service.get(&format!("{url}?clusters=10&max_clusters=0"))).await;
    assert_eq!(cut["nodes"], Value::Array(Vec::new()));
    let mut of_cut = cut["cut"]["nodes"].as_array().expect("a list").clone();
    of_cut.sort_by_key(Value::as_u64);
    assert_eq!(Value::Array(of_cut), part["roots"]);
    let labels = json(service.get(&format!("{}?clusters=10", text(&job["urls"]["labels"])))).await;
    let sizes = |label: usize| labels["labels"].as_array().into_iter().flatten().filter(|&l| *l == label).count();
    for (label, node) in cut["cut"]["nodes"].as_array().into_iter().flatten().enumerate() {
        // without optimisation the faces of a node stay its own
        let made = nodes.iter().find(|made| made["id"] == *node).map_or(json!(1), |made| made["faces"].clone());
        assert_eq!(made, sizes(label), "{node}");
    }
    refused(service.get(&format!("{url}?clusters=0")), 409, "conflict").await;
    for (query, word) in
        [("min_clusters=9&max_clusters=8", "9 and 8"), ("min_clusters=x", "min_clusters"), ("k=3", "k")]
    {
        let detail = refused(service.get(&format!("{url}?{query}")), 422, "invalid-parameter").await;
        assert!(detail.contains(word), "{detail}");
    }
    refused(service.get(url).header("accept", "text/html"), 406, "not-acceptable").await;
    let npy = bytes(&service, url, "application/x-npy").await;
    assert_eq!(npy.len() as u64, 128 + 32 * (faces - 1));
    let limited = service.get(&format!("{url}?max_clusters=5")).header("accept", "application/x-npy");
    refused(limited, 422, "invalid-parameter").await;
    service.delete(path(&job)).send().await.expect("answered");
    service.keeps_no("").await;
    refused(service.get(url), 404, "not-found").await;
}

#[tokio::test]
async fn trees_without_a_linkage_matrix_say_why() {
    let mut parts = Vec::new();
    sample::write_obj(&mut parts, &sample::generate(Sample::Parts, 600).expect("parts")).expect("written");
    for (query, mesh, word) in [
        ("algorithm=hr", parts, "bridge_components"),
        ("algorithm=pml", sphere(600), "optimize=none"),
        ("algorithm=hr&clusters=7", sphere(600), "leave clusters out"),
    ] {
        let (service, job) = done(query, mesh).await;
        let matrix = service.get(text(&job["urls"]["hierarchy"])).header("accept", "application/x-npy");
        let detail = refused(matrix, 409, "conflict").await;
        assert!(detail.contains(word), "{query}: {detail}");
    }
}

#[tokio::test]
async fn there_is_no_hierarchy_before_success_and_none_of_flat_algorithms() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let job = service.submit("algorithm=hr", sphere(600)).await;
    let url = text(&job["urls"]["hierarchy"]);
    refused(service.get(url), 409, "conflict").await;
    refused(service.get(&format!("{}?clusters=5", text(&job["urls"]["labels"]))), 409, "conflict").await;
    let flat = service.submit("clusters=9", sphere(600)).await;
    assert_eq!(flat["urls"]["hierarchy"], Value::Null);
    refused(service.get(&format!("{}/hierarchy", path(&flat))), 404, "not-found").await;
    gate.open();
    assert_eq!(service.ended(&job).await["state"], "succeeded");
}

/// A gpu that makes no hierarchies.
fn limited() -> Box<dyn Device> {
    let before = |_: &DualGraph, is_merging| match is_merging {
        true => Err(Error::new(Kind::DeviceUnsuitable, "this device makes no hierarchies")),
        false => Ok(()),
    };
    let mut device = Around::new(before);
    device.info.kind = DeviceKind::Gpu;
    Box::new(device)
}

#[tokio::test]
async fn what_a_gpu_cannot_do_is_done_by_the_cpu_if_the_choice_was_left_to_the_service() {
    for algorithm in ["pml", "ml", "hr"] {
        let query = format!("algorithm={algorithm}&clusters=9");
        let free = Service::with_choice(|_| {}, limited(), Some(0)).await;
        let job = free.submit(&query, sphere(300)).await;
        assert_eq!(free.ended(&job).await["state"], "succeeded");
        let report = json(free.get(text(&job["urls"]["report"]))).await;
        assert_eq!(report["device"]["kind"], "cpu");
        let bound = Service::with_choice(|_| {}, limited(), None).await;
        let job = bound.submit(&query, sphere(300)).await;
        let problem = &bound.ended(&job).await["problem"];
        assert_eq!(problem["type"], "/problems/device-unsuitable");
        assert!(text(&problem["detail"]).contains("no hierarchies"));
    }
}

#[tokio::test]
async fn meshes_that_the_cpu_is_faster_with_go_to_the_cpu_if_the_choice_was_left_to_the_service() {
    for (below, kinds) in [(Some(1000), ["cpu", "gpu"]), (Some(0), ["gpu", "gpu"]), (Some(1 << 31), ["cpu", "cpu"])] {
        let service = Service::with_choice(|_| {}, limited(), below).await;
        for (faces, kind) in [300, 1200].into_iter().zip(kinds) {
            let job = service.submit("clusters=9&seeds=morton", sphere(faces)).await;
            assert_eq!(service.ended(&job).await["state"], "succeeded");
            let report = json(service.get(text(&job["urls"]["report"]))).await;
            assert_eq!(report["device"]["kind"], kind, "{faces} faces, the cpu below {below:?}");
        }
        let device = json(service.get("/v1/device")).await;
        assert_eq!(device["cpu_below_faces"], serde_json::json!(below));
    }
}
