//! What fails around a job: the disk, the device, time, memory. Injected at named points.

use std::io::ErrorKind;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;
use tesserae_mesh::device::Device;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::gpu::adapter::enumerate;
use tesserae_mesh::device::gpu::{self, Fault, GpuDevice};
use tesserae_mesh::report::DeviceKind;
use tesserae_mesh::surface::DualGraph;
use tesserae_mesh::{Error, Kind};
use tesserae_service::{Extras, FaultPoint, Faults, Reopen, Settings};

use crate::support::*;

async fn with_faults(change: impl FnOnce(&mut Settings)) -> (Service, Faults) {
    let faults = Faults::default();
    let extras = Extras { faults: faults.clone(), ..Extras::default() };
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    (Service::on(data, change, Box::new(CpuDevice::new()), None, extras).await, faults)
}

async fn ready(service: &Service, is_ready: bool) -> Value {
    let started = Instant::now();
    loop {
        let answer = service.get("/readyz").send().await.expect("answered");
        let status = answer.status().as_u16();
        let body: Value = answer.json().await.expect("JSON");
        assert!([200, 503].contains(&status), "{status}: {body}");
        if (status == 200) == is_ready {
            return body;
        }
        assert!(started.elapsed() < PATIENCE, "{status}: {body}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

const FOREVER: usize = usize::MAX;

#[tokio::test]
async fn a_full_disk_refuses_jobs_says_so_and_works_again_by_itself() {
    let (service, faults) = with_faults(|_| {}).await;
    let before = service.submit("clusters=5", sphere(300)).await;
    service.ended(&before).await;
    for (point, kind, status, slug) in [
        (FaultPoint::Commit, ErrorKind::StorageFull, 507, "insufficient-storage"),
        (FaultPoint::WriteBlob, ErrorKind::StorageFull, 507, "insufficient-storage"),
        (FaultPoint::Commit, ErrorKind::ReadOnlyFilesystem, 503, "unavailable"),
        (FaultPoint::WriteBlob, ErrorKind::ReadOnlyFilesystem, 503, "unavailable"),
    ] {
        faults.arm(point, kind, 0, FOREVER);
        faults.arm(FaultPoint::ProbeFolder, kind, 0, FOREVER);
        let request = service.obj("clusters=5", sphere(300));
        refused(request, status, slug).await;
        let why = ready(&service, false).await;
        assert!(text(&why["detail"]).contains("disk"), "{why}");
        // what was there is there
        assert_eq!(service.job(&before).await["state"], "succeeded");
        faults.disarm();
        ready(&service, true).await;
        let after = service.submit("clusters=5", sphere(300)).await;
        assert_eq!(service.ended(&after).await["state"], "succeeded");
    }
    assert_eq!(
        json(service.get("/v1/jobs")).await["jobs"].as_array().map(Vec::len),
        Some(5),
        "refused ones left nothing"
    );
    service.keeps_no("uploads").await;
}

#[tokio::test]
async fn an_accepted_job_outlasts_a_disk_that_fails() {
    let (service, faults) = with_faults(|settings| settings.work.max_attempts = 1).await;
    let expected = service.submit("clusters=5", sphere(300)).await;
    service.ended(&expected).await;
    let digest = async |job: &Value| json(service.get(text(&job["urls"]["report"]))).await["labels_sha256"].clone();
    // a blob of the upload is written, then those of the result fail; and so on
    for (point, passed) in
        [(FaultPoint::WriteBlob, 1), (FaultPoint::ReadBlob, 0), (FaultPoint::Commit, 1), (FaultPoint::Commit, 2)]
    {
        faults.arm(point, ErrorKind::StorageFull, passed, FOREVER);
        faults.arm(FaultPoint::ProbeFolder, ErrorKind::StorageFull, 0, FOREVER);
        let job = service.submit("clusters=5", sphere(300)).await;
        ready(&service, false).await;
        assert!(["queued", "running"].contains(&text(&service.job(&job).await["state"])), "{point:?}");
        faults.disarm();
        let ended = service.ended(&job).await;
        assert_eq!(ended["state"], "succeeded", "{point:?}: {ended}");
        assert_eq!(digest(&job).await, digest(&expected).await);
    }
}

#[tokio::test]
async fn a_job_that_cannot_read_or_write_its_files_pauses_is_seen_and_fails_for_a_retry() {
    // small uploads are in the store, others in files; a part of each is written before those of the result
    for (point, passed, faces) in
        [(FaultPoint::ReadBlob, 0, 300), (FaultPoint::ReadBlob, 0, 20_000), (FaultPoint::WriteBlob, 1, 20_000)]
    {
        let faults = Faults::default();
        let patience = Some(Duration::from_secs(3));
        let extras = Extras { faults: faults.clone(), patience, ..Extras::default() };
        let data = Arc::new(tempfile::tempdir().expect("a folder"));
        let service = Service::on(data, |_| {}, Box::new(CpuDevice::new()), None, extras).await;
        faults.arm(point, ErrorKind::PermissionDenied, passed, FOREVER);
        let job = service.submit("clusters=5&quality=fast", sphere(faces)).await;
        until(async || {
            let readiness = json(service.get("/readyz")).await;
            readiness["status"] == "degraded" && readiness["conditions"][0]["part"] == "disk"
        })
        .await;
        assert_eq!(metric(&service, "tesserae_stuck_jobs").await, 1.0);
        let ended = service.ended(&job).await;
        assert_eq!((&ended["problem"]["status"], &ended["attempt"]), (&507.into(), &1.into()), "{ended}");
        let detail = text(&ended["problem"]["detail"]);
        assert!(detail.contains("for 3 s") && detail.contains("/retry"), "{detail}");
        // after pauses of 0.1, 0.2, 0.4, 0.8 and 1.6 s
        let attempts = metric(&service, "tesserae_file_errors_total").await;
        assert!((3.0..=6.0).contains(&attempts), "{attempts}");
        faults.disarm();
        ready(&service, true).await;
        until(async || json(service.get("/readyz")).await["status"] == "ok").await;
        assert_eq!(metric(&service, "tesserae_stuck_jobs").await, 0.0);
        json(service.post(&format!("{}/retry", path(&job)))).await;
        let ended = service.ended(&job).await;
        assert_eq!((&ended["state"], &ended["attempt"]), (&"succeeded".into(), &2.into()), "{ended}");
        service.keeps_no("uploads").await;

        faults.arm(point, ErrorKind::PermissionDenied, passed, FOREVER);
        let job = service.submit("clusters=5&quality=fast", sphere(faces)).await;
        until(async || metric(&service, "tesserae_stuck_jobs").await == 1.0).await;
        assert_eq!(service.delete(path(&job)).send().await.expect("answered").status(), 202);
        assert_eq!(service.ended(&job).await["state"], "cancelled", "it is not waited for");
        faults.disarm();
        service.keeps_no("uploads").await;
    }
}

#[tokio::test]
async fn a_job_that_takes_too_long_fails_and_says_so() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|settings| settings.work.max_job_seconds = 1, device).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    let ended = service.ended(&job).await;
    assert_eq!(ended["problem"]["type"], "/problems/time-limit");
    assert!(text(&ended["problem"]["detail"]).contains("--max-job-seconds"), "{ended}");
    gate.open();
    let other = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&other).await["state"], "succeeded");
}

#[tokio::test]
async fn a_mesh_that_will_never_fit_in_memory_fails_with_the_numbers() {
    let service =
        Service::with(|settings| settings.work.memory_budget = Some(1 << 20), Box::new(CpuDevice::new())).await;
    let job = service.submit("clusters=5", sphere(100_000)).await;
    let ended = service.ended(&job).await;
    assert_eq!(ended["problem"]["status"], 413, "{ended}");
    assert!(text(&ended["problem"]["detail"]).contains("1048576"), "{ended}");
    // others wait for their turn and end
    let mut jobs = Vec::new();
    for _ in 0..6 {
        jobs.push(service.submit("clusters=5", sphere(3000)).await);
    }
    for job in jobs {
        assert_eq!(service.ended(&job).await["state"], "succeeded");
    }
}

/// A cpu that calls itself a gpu and is lost, or stands still at a gate, as often as said. One with a gate has small
/// meshes worked on beside it, which pass.
fn faulty(lost: &Arc<AtomicUsize>, still: Option<Gate>) -> Box<dyn Device> {
    let (lost, gate) = (Arc::clone(lost), still.clone());
    let before = move |_: &DualGraph, _| {
        if let Some(gate) = &gate {
            gate.pass();
        }
        let again = |left: usize| left.checked_sub(1);
        match lost.fetch_update(Ordering::SeqCst, Ordering::SeqCst, again) {
            Ok(_) => Err(Error::new(Kind::DeviceLost, "the card fell out")),
            Err(_) => Ok(()),
        }
    };
    let mut device = Around::new(before);
    (device.info.kind, device.info.name) = (DeviceKind::Gpu, "faulty".to_owned());
    device.another = still.map(|_| Box::new(|| Box::new(CpuDevice::new()) as Box<dyn Device>) as _);
    Box::new(device)
}

/// Losses that are left, and how often the device was opened anew.
type Counts = (Arc<AtomicUsize>, Arc<AtomicUsize>);

async fn with_losses(losses: usize, or_cpu: bool, still: Option<Gate>) -> (Service, Counts) {
    let (lost, opened) = (Arc::new(AtomicUsize::new(losses)), Arc::<AtomicUsize>::default());
    let device = faulty(&lost, still);
    let counts = (Arc::clone(&lost), Arc::clone(&opened));
    let reopen: Reopen = Arc::new(move || {
        opened.fetch_add(1, Ordering::SeqCst);
        Ok(faulty(&lost, None))
    });
    let extras = Extras { reopen: Some(reopen), ..Extras::default() };
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    let service = Service::on(
        data,
        |settings| settings.work.device_timeout = Duration::from_secs(5),
        device,
        or_cpu.then_some(0),
        extras,
    )
    .await;
    (service, counts)
}

async fn device_of(service: &Service, job: &Value) -> String {
    text(&json(service.get(text(&job["urls"]["report"]))).await["device"]["name"]).to_owned()
}

#[tokio::test]
async fn a_lost_device_is_opened_anew_and_the_job_runs_again() {
    let (service, (_, opened)) = with_losses(2, false, None).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    let ended = service.ended(&job).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    assert_eq!(device_of(&service, &job).await, "faulty");
    assert_eq!(opened.load(Ordering::SeqCst), 2);
    assert_eq!(ready(&service, true).await["status"], "ok", "it works again");
}

#[tokio::test]
async fn the_cpu_stands_in_where_it_may() {
    let (service, _) = with_losses(1, true, None).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
    assert_ne!(device_of(&service, &job).await, "faulty");
    let degraded = ready(&service, true).await;
    assert_eq!(degraded["status"], "degraded");
    assert!(text(&degraded["conditions"][0]["detail"]).contains("the card fell out"), "{degraded}");
    // the next one has the device again
    let next = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&next).await["state"], "succeeded");
    assert_eq!(device_of(&service, &next).await, "faulty");
    assert_eq!(ready(&service, true).await["status"], "ok");
}

#[tokio::test]
async fn a_job_whose_labels_a_gpu_got_wrong_runs_again_on_the_cpu_and_is_counted() {
    let found = enumerate().into_iter().find(|found| found.report.usable).expect("a Vulkan driver");
    let mut device = GpuDevice::new(&found).expect("it opens");
    device.inject(Fault::Miscompute(gpu::FaultPoint::Labels));
    let service = Service::with(|_| {}, Box::new(device)).await;
    for (wrong, name) in [(1.0, std::env::consts::ARCH), (1.0, &*found.report.name)] {
        let job = service.submit("clusters=5", sphere(300)).await;
        assert_eq!(service.ended(&job).await["state"], "succeeded");
        let report = json(service.get(text(&job["urls"]["report"]))).await;
        assert_eq!(report["device"]["name"], name, "{report}");
        let is_warned = report["warnings"].to_string().contains("computed wrongly");
        assert_eq!(is_warned, name == std::env::consts::ARCH, "{report}");
        assert_eq!(metric(&service, "tesserae_device_wrong_total").await, wrong);
    }
}

#[tokio::test]
async fn a_job_that_was_given_up_is_run_again_on_request() {
    let (service, (lost, _)) = with_losses(FOREVER, false, None).await;
    let retry = |job: &Value| service.post(&format!("{}/retry", path(job)));
    // small ones are kept in the store, others in files
    for mesh in [sphere(300), sphere(20_000)] {
        lost.store(FOREVER, Ordering::SeqCst);
        let job = service.submit("clusters=5", mesh).await;
        let ended = service.ended(&job).await;
        assert_eq!((&ended["problem"]["type"], &ended["attempt"]), (&"/problems/poison".into(), &3.into()), "{ended}");
        let detail = text(&ended["problem"]["detail"]);
        assert!(["3 attempts", "the card fell out", "/retry"].iter().all(|part| detail.contains(part)), "{ended}");
        lost.store(0, Ordering::SeqCst);
        let queued = json(retry(&job)).await;
        assert_eq!((&queued["id"], &queued["problem"]), (&job["id"], &Value::Null));
        let ended = service.ended(&job).await;
        assert_eq!((&ended["state"], &ended["attempt"]), (&"succeeded".into(), &4.into()), "{ended}");
        service.keeps_no("uploads").await;
        let stream = service.get(text(&job["urls"]["events"])).send().await.expect("answered");
        let events = stream.text().await.expect("text");
        for attempt in 1..=4 {
            assert!(events.contains(&format!("\"attempt\":{attempt}")), "{events}");
        }
        assert_eq!(events.matches("event: end").count(), 2, "the stream goes on after the failure: {events}");
        let detail = refused(retry(&job), 409, "conflict").await;
        assert!(detail.contains("succeeded"), "{detail}");
    }
    let broken = service.submit("clusters=5", b"v 0 0 0\nf 1 2 3\n".to_vec()).await;
    service.ended(&broken).await;
    let detail = refused(retry(&broken), 409, "conflict").await;
    assert!(detail.contains("submit the mesh again"), "{detail}");
    refused(service.post("/v1/jobs/6ed6e4e2-8a9c-44bf-a77e-f6c240b63f15/retry"), 404, "not-found").await;
}

#[tokio::test]
async fn a_device_that_stands_still_is_left_to_itself_also_while_small_meshes_go_on_beside_it() {
    let gate = Gate::default();
    let (service, (_, opened)) = with_losses(0, false, Some(gate.clone())).await;
    let job = service.submit("clusters=5", sphere(10_000)).await;
    service.reaches(&job, "running").await;
    let small = sphere(3000);
    let beside = async {
        loop {
            let small = service.submit("clusters=200", small.clone()).await;
            assert_eq!(service.ended(&small).await["state"], "succeeded");
        }
    };
    let ended = tokio::select! {
        ended = service.ended(&job) => ended,
        () = beside => unreachable!(),
    };
    assert_eq!(ended["state"], "succeeded", "{ended}");
    assert_eq!(opened.load(Ordering::SeqCst), 1);
    gate.open();
}

#[tokio::test]
async fn a_device_that_cannot_be_opened_makes_the_service_wait_for_it() {
    let (lost, broken) = (Arc::new(AtomicUsize::new(1)), Arc::new(Mutex::new(true)));
    let device = faulty(&lost, None);
    let still_broken = Arc::clone(&broken);
    let reopen: Reopen = Arc::new(move || match *still_broken.lock().expect("unpoisoned") {
        true => Err(Error::new(Kind::DeviceLost, "no driver")),
        false => Ok(faulty(&lost, None)),
    });
    let extras = Extras { reopen: Some(reopen), ..Extras::default() };
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    let service = Service::on(data, |settings| settings.work.max_attempts = 4, device, None, extras).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    let why = ready(&service, false).await;
    assert!(text(&why["detail"]).contains("no driver"), "{why}");
    *broken.lock().expect("unpoisoned") = false;
    let ended = service.ended(&job).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    ready(&service, true).await;
}
