//! The life of jobs: queue, list, wait, cancel, delete, failures.

use std::time::{Duration, Instant};

use futures_util::future::join_all;
use serde_json::Value;
use tesserae_mesh::dev::sample::{self, Sample};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::Settings;

use crate::support::*;

#[tokio::test]
async fn an_accepted_job_says_all_about_itself() {
    let service = Service::start().await;
    let response = service
        .post("/v1/jobs?clusters=7&seed=3")
        .header("content-type", "model/obj")
        .body(sphere(300))
        .send()
        .await
        .expect("answered");
    assert_eq!(response.status(), 202);
    assert_eq!(response.headers()["x-content-type-options"], "nosniff");
    let location = response.headers()["location"].to_str().expect("text").to_owned();
    let job: Value = response.json().await.expect("JSON");
    assert_eq!(path(&job), location);
    assert_eq!(location, format!("/v1/jobs/{}", text(&job["id"])));
    assert_eq!(job["parameters"]["clusters"], 7);
    assert_eq!(job["parameters"]["seed"], 3);
    assert_eq!(job["mesh"]["bytes"], sphere(300).len());

    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    assert_eq!(job["problem"], Value::Null);
    assert_eq!(job["queue_position"], Value::Null);
    assert!(job["progress"]["iterations"].as_u64() > Some(0), "{job}");
    assert!(job["progress"]["energy"].as_f64() > Some(0.0), "{job}");
    let times: Vec<&str> = ["created_at", "started_at", "ended_at"].map(|name| text(&job[name])).into();
    assert!(times.is_sorted() && times.iter().all(|time| time.ends_with('Z') && time.len() == 24), "{times:?}");
    service.keeps_no("uploads").await;
}

#[tokio::test]
async fn waiting_gives_the_ended_job_or_the_accepted_one() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let post = |wait: &str| service.obj("clusters=5", sphere(300)).header("prefer", wait.to_owned()).send();
    let response = post("wait=1").await.expect("answered");
    assert_eq!(response.status(), 202);
    assert!(!response.headers().contains_key("preference-applied"));
    let response = post("respond-async").await.expect("answered");
    assert_eq!(response.status(), 202);
    gate.open();
    let response = post("respond-async, wait=50").await.expect("answered");
    assert_eq!(response.status(), 200);
    assert_eq!(response.headers()["preference-applied"], "wait");
    assert!(response.headers().contains_key("location"));
    let job: Value = response.json().await.expect("JSON");
    assert_eq!(job["state"], "succeeded");
}

#[tokio::test]
async fn a_full_queue_says_when_to_come_back_and_positions_count_down() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(
        |settings| {
            settings.max_queued_jobs = 2;
            settings.meshes_in_memory = 1;
        },
        device,
    )
    .await;
    let first = service.submit("clusters=5", sphere(300)).await;
    service.reaches(&first, "running").await;
    let second = service.submit("clusters=5", sphere(300)).await;
    let third = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(second["queue_position"], 1);
    assert_eq!(third["queue_position"], 2);
    let request = service.obj("clusters=5", sphere(300));
    let response = request.send().await.expect("answered");
    assert!(response.headers().contains_key("retry-after"));
    problem(response, 429, "queue-full").await;

    assert_eq!(json(service.delete(path(&second))).await["state"], "cancelled");
    assert_eq!(service.job(&third).await["queue_position"], 1);
    gate.open();
    assert_eq!(service.ended(&third).await["state"], "succeeded");
    service.keeps_no("uploads").await;
}

#[tokio::test]
async fn the_next_mesh_is_read_while_the_device_works() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|settings| settings.meshes_in_memory = 2, device).await;
    let first = service.submit("clusters=5", sphere(300)).await;
    service.reaches(&first, "running").await;
    // its mesh is broken, which is found although the device is held
    let second = service.submit("clusters=1", b"v 0 0 0\nf 1 2 3\n".to_vec()).await;
    assert_eq!(service.ended(&second).await["state"], "failed");
    assert_eq!(service.job(&first).await["state"], "running");
    gate.open();
    assert_eq!(service.ended(&first).await["state"], "succeeded");
}

#[tokio::test]
async fn a_running_job_is_cancelled_stays_listed_and_is_then_deleted() {
    let service = Service::start().await;
    // seconds of iterations: the job still runs when its first ones are seen
    let mesh = sphere(120_000);
    let submit = async || service.submit("clusters=1500&quality=best", mesh.clone()).await;
    let started = Instant::now();
    assert_eq!(service.ended(&submit().await).await["state"], "succeeded");
    let whole = started.elapsed();

    let job = submit().await;
    while service.job(&job).await["progress"]["iterations"].as_u64() < Some(3) {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let asked = Instant::now();
    let response = service.delete(path(&job)).send().await.expect("answered");
    assert_eq!(response.status(), 202);
    let cancelled = service.reaches(&job, "cancelled").await;
    assert_eq!(cancelled["cancel_requested"], true);
    assert_eq!(cancelled["problem"], Value::Null);
    // the device is free again
    let other = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&other).await["state"], "succeeded");
    assert!(asked.elapsed() < whole / 2, "{:?} of {whole:?}", asked.elapsed());
    refused(service.get(text(&job["urls"]["labels"])), 409, "cancelled").await;

    let listed = json(service.get("/v1/jobs?state=cancelled")).await;
    assert_eq!(listed["jobs"][0]["id"], job["id"]);
    let again = service.delete(&format!("{}?cancel=true", path(&job)));
    assert_eq!(json(again).await["state"], "cancelled", "it stays");
    refused(service.delete(&format!("{}?cancel=maybe", path(&job))), 422, "invalid-parameter").await;
    assert_eq!(service.delete(path(&job)).send().await.expect("answered").status(), 204);
    refused(service.get(path(&job)), 404, "not-found").await;
    refused(service.delete(path(&job)), 404, "not-found").await;
    service.keeps_no(text(&job["id"])).await;
}

#[tokio::test]
async fn a_job_that_waits_for_the_device_is_cancelled_at_once() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let first = service.submit("clusters=5", sphere(300)).await;
    let second = service.submit("clusters=5", sphere(300)).await;
    service.reaches(&first, "running").await;
    service.reaches(&second, "running").await;
    service.delete(path(&second)).send().await.expect("answered");
    service.reaches(&second, "cancelled").await;
    assert_eq!(service.job(&first).await["state"], "running");
    gate.open();
    assert_eq!(service.ended(&first).await["state"], "succeeded");
    assert_eq!(service.job(&second).await["state"], "cancelled");
}

#[tokio::test]
async fn a_panic_fails_its_job_and_nothing_else() {
    let (device, gate) = Held::behind_gate();
    gate.open();
    let service = Service::with(|_| {}, device).await;
    let mut strip = Vec::new();
    let mesh = sample::generate(Sample::Strip, PANIC_FACES as u64).expect("a strip");
    sample::write_obj(&mut strip, &mesh).expect("written");
    let job = service.submit("clusters=5", strip).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "failed");
    assert_eq!(job["problem"]["type"], "/problems/internal");
    assert_eq!(job["problem"]["status"], 500);
    let other = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&other).await["state"], "succeeded");
}

#[tokio::test]
async fn the_list_is_newest_first_in_pages() {
    let service = Service::start().await;
    let mut ids = Vec::new();
    for _ in 0..5 {
        let job = service.submit("clusters=5", sphere(300)).await;
        ids.insert(0, job["id"].clone());
    }
    let mut seen = Vec::new();
    let mut next = String::new();
    loop {
        let page = json(service.get(&format!("/v1/jobs?limit=2{next}"))).await;
        seen.extend(page["jobs"].as_array().expect("a list").iter().map(|job| job["id"].clone()));
        match page["next"].as_str() {
            Some(cursor) => next = format!("&cursor={cursor}"),
            None => break,
        }
    }
    assert_eq!(seen, ids);
    for query in ["limit=0", "limit=1001", "limit=x", "state=lost", "cursor=x", "page=2", "limit=1&limit=2"] {
        refused(service.get(&format!("/v1/jobs?{query}")), 422, "invalid-parameter").await;
    }
}

#[tokio::test]
async fn fifty_small_jobs_at_once_all_end_with_the_same_labels() {
    let service = Service::start().await;
    let obj = sphere(500);
    let digests = join_all((0..50).map(|_| async {
        let job = json(service.obj("clusters=9", obj.clone()).header("prefer", "wait=50")).await;
        // on a slow machine the wait is over before the job
        let job = service.ended(&job).await;
        json(service.get(text(&job["urls"]["report"]))).await["labels_sha256"].clone()
    }))
    .await;
    assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
    let metrics = service.get("/metrics").send().await.expect("answered").text().await.expect("text");
    assert!(metrics.contains("tesserae_jobs{state=\"succeeded\"} 50"), "{metrics}");
    let posted = metrics.lines().filter_map(|line| {
        let answered =
            line.strip_prefix("tesserae_http_requests_total{method=\"POST\",route=\"/v1/jobs\",status=\"20")?;
        answered.rsplit(' ').next()?.parse::<u32>().ok()
    });
    assert_eq!(posted.sum::<u32>(), 50, "{metrics}");
}

#[tokio::test]
async fn the_service_describes_itself() {
    let limits = |settings: &mut Settings| (settings.max_upload_bytes, settings.max_faces) = (12_345, 678);
    let service = Service::with(limits, Box::new(CpuDevice::new())).await;
    let device = json(service.get("/v1/device")).await;
    assert_eq!(device["kind"], "cpu");
    assert_eq!(device["chosen"], "by the test");
    let limits = json(service.get("/v1/limits")).await;
    assert_eq!(limits, serde_json::json!({"max_upload_bytes": 12_345, "max_faces": 678}));
    let formats = json(service.get("/v1/formats")).await;
    assert_eq!(formats["meshes"][0], serde_json::json!({"name": "obj", "media_type": "model/obj"}));
    assert_eq!(formats["labels"][1]["media_type"], "application/x-npy");
    assert_eq!(json(service.get("/v1/version")).await["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(json(service.get("/healthz")).await["status"], "ok");
    assert_eq!(json(service.get("/readyz")).await["status"], "ok");
    for path in ["/v1/device", "/healthz", "/openapi.yaml", "/metrics", "/v1/jobs"] {
        let head = service.client.head(service.url(path)).send().await.expect("answered");
        assert_eq!(head.status(), 200, "{path}");
        assert!(head.headers().contains_key("content-type"), "{path}");
    }
}
