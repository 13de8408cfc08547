//! What outlasts the service: jobs, events, results and keys.

use std::time::Duration;

use reqwest::RequestBuilder;
use serde_json::Value;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Extras, Server, Settings};

use crate::support::*;

fn keyed(service: &Service, query: &str, key: &str, obj: &[u8]) -> RequestBuilder {
    service.obj(query, obj.to_vec()).header("idempotency-key", key)
}

async fn events(service: &Service, job: &Value) -> String {
    let response = service.get(text(&job["urls"]["events"])).send().await.expect("answered");
    response.text().await.expect("text")
}

async fn labels(service: &Service, job: &Value) -> Vec<u8> {
    let request = service.get(text(&job["urls"]["labels"])).header("accept", "application/x-npy");
    request.send().await.expect("answered").bytes().await.expect("bytes").to_vec()
}

#[tokio::test]
async fn a_restart_changes_nothing_that_was_told() {
    let service = Service::start().await;
    let flat = service.submit("clusters=9", sphere(500)).await;
    let tree = service.submit("algorithm=pml", sphere(500)).await;
    let broken = service.submit("clusters=9", b"v 0 0 0\nf 1 2 3\n".to_vec()).await;
    for job in [&flat, &tree, &broken] {
        service.ended(job).await;
    }
    let tell = async |service: &Service| {
        let mut told = vec![json(service.get("/v1/jobs")).await.to_string()];
        for job in [&flat, &tree, &broken] {
            told.push(service.job(job).await.to_string());
            told.push(events(service, job).await);
        }
        let cut = format!("{}?clusters=20", text(&tree["urls"]["labels"]));
        told.push(json(service.get(&cut)).await.to_string());
        told.push(json(service.get(text(&flat["urls"]["report"]))).await.to_string());
        (told, labels(service, &flat).await)
    };
    let before = tell(&service).await;
    let service = service.again(|_| {}).await;
    assert_eq!(tell(&service).await, before);
    assert_eq!(service.delete(path(&flat)).send().await.expect("answered").status(), 204);
    service.keeps_no(text(&flat["id"])).await;
    let service = service.again(|_| {}).await;
    refused(service.get(path(&flat)), 404, "not-found").await;
}

#[tokio::test]
async fn a_queued_job_waits_on_and_gives_the_same_bytes() {
    let mesh = sphere(2000);
    let (device, gate) = Held::behind_gate();
    let change = |settings: &mut Settings| {
        settings.grace_period = 0;
        settings.meshes_in_memory = 1;
    };
    let service = Service::with(change, device).await;
    let running = service.submit("clusters=40", mesh.clone()).await;
    let queued = service.submit("clusters=40", mesh.clone()).await;
    service.reaches(&running, "running").await;
    let service = service.again(|_| {}).await;
    gate.open();
    for job in [&running, &queued] {
        let ended = service.ended(job).await;
        assert_eq!(ended["state"], "succeeded", "{ended}");
    }
    let fresh = service.submit("clusters=40", mesh).await;
    service.ended(&fresh).await;
    let expected = labels(&service, &fresh).await;
    assert!(expected.len() > 4000);
    assert_eq!(labels(&service, &running).await, expected, "the second attempt");
    assert_eq!(labels(&service, &queued).await, expected);
    // the events of both attempts, numbered through
    let told = events(&service, &running).await;
    let ids: Vec<u64> = told.lines().filter_map(|line| line.strip_prefix("id: ")?.parse().ok()).collect();
    assert_eq!(ids, (1..=ids.len() as u64).collect::<Vec<_>>());
    for attempt in ["\"attempt\":1", "\"attempt\":2"] {
        assert!(told.contains(attempt), "{told}");
    }
    assert_eq!(service.job(&running).await["attempt"], 2);
    let states: Vec<&str> = told.lines().filter(|line| line.contains("\"state\"")).collect();
    assert_eq!(states.len(), 5, "queued, running, queued, running, end: {states:?}");
}

#[tokio::test]
async fn the_same_key_and_request_give_the_same_job_also_after_a_restart() {
    let mesh = sphere(300);
    let service = Service::start().await;
    let first = json(keyed(&service, "clusters=5", "\"a key\"", &mesh)).await;
    let again = json(keyed(&service, "clusters=5", "\"a key\"", &mesh).header("prefer", "wait=50")).await;
    assert_eq!(again["id"], first["id"]);
    assert_eq!(again["state"], "succeeded");
    let service = service.again(|_| {}).await;
    let again = keyed(&service, "clusters=5", "\"a key\"", &mesh).send().await.expect("answered");
    assert_eq!(again.headers()["location"], path(&first));
    assert_eq!(again.json::<Value>().await.expect("JSON")["id"], first["id"]);
    // as long as the first, and of the same name: only its content tells
    let mut of_equal_length = mesh.clone();
    let digit = of_equal_length.iter_mut().rfind(|byte| byte.is_ascii_digit()).expect("a number");
    *digit = if *digit == b'1' { b'2' } else { b'1' };
    for (query, mesh) in
        [("clusters=6", mesh.clone()), ("clusters=5", of_equal_length), ("clusters=5&seed=1", mesh.clone())]
    {
        refused(keyed(&service, query, "\"a key\"", &mesh), 422, "key-reused").await;
    }
    let other = json(keyed(&service, "clusters=5", "another key", &mesh)).await;
    assert_ne!(other["id"], first["id"]);
    refused(keyed(&service, "clusters=5", &"k".repeat(256), &mesh), 400, "bad-request").await;
    service.ended(&other).await;
    service.keeps_no("uploads").await;
}

#[tokio::test]
async fn a_folder_in_use_is_refused() {
    let service = Service::start().await;
    let folder = service.folder();
    let second = async || {
        let settings = Settings {
            listen: ([127, 0, 0, 1], 0).into(),
            data_dir: Some(folder.path().to_owned()),
            ..Settings::default()
        };
        Server::bind(settings, Box::new(CpuDevice::new()), description(), Extras::default()).await
    };
    let error = second().await.expect_err("in use");
    assert!(error.message.contains("--data-dir"), "{error}");
    // the store of jobs has a lock of its own, as when somebody removed that of the folder
    std::fs::remove_file(folder.path().join("lock")).expect("removed");
    let error = second().await.expect_err("in use");
    assert!(error.message.contains("--data-dir") && error.message.contains("store of jobs"), "{error}");
}

#[tokio::test]
async fn jobs_are_forgotten_when_their_time_is_over() {
    let service = Service::with(|settings| settings.storage.retention = 1, Box::new(CpuDevice::new())).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(job["expires_at"], Value::Null);
    let ended = service.ended(&job).await;
    assert!(text(&ended["expires_at"]) > text(&ended["ended_at"]), "{ended}");
    let started = std::time::Instant::now();
    while service.get(path(&job)).send().await.expect("answered").status() != 404 {
        assert!(started.elapsed() < PATIENCE);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    service.keeps_no("").await;
}
