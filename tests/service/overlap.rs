//! Neighbouring jobs: what one does before and after the device has it goes on while the device is at another.

use std::sync::Arc;

use tesserae_mesh::device::Device;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Extras, FaultPoint, Faults, Settings};

use crate::support::*;

/// A service that can be held at named points.
async fn held(change: impl FnOnce(&mut Settings), device: Box<dyn Device>) -> (Service, Faults) {
    let faults = Faults::default();
    let extras = Extras { faults: faults.clone(), ..Extras::default() };
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    (Service::on(data, change, device, None, extras).await, faults)
}

/// A cpu that works on one mesh at a time, small ones too.
fn cpu() -> Box<dyn Device> {
    Box::new(Around::new(|_, _| Ok(())))
}

#[tokio::test]
async fn results_are_made_while_the_device_is_at_the_next_mesh() {
    let (service, faults) = held(|_| {}, cpu()).await;
    faults.hold(FaultPoint::Finish);
    let first = service.submit("clusters=5", sphere(300)).await;
    let second = service.submit("clusters=7", sphere(500)).await;
    // the device is through with both though no result of the first is there
    until(async || faults.waiting(FaultPoint::Finish) == 2).await;
    for job in [&first, &second] {
        assert_eq!(service.job(job).await["state"], "running");
    }
    let busy = metric(&service, "tesserae_device_busy_seconds_total").await;
    assert!(busy > 0.0);
    assert_eq!(metric(&service, "tesserae_device_busy_seconds_total").await, busy, "it has nothing to do");
    faults.disarm();
    for (job, clusters) in [(first, 5), (second, 7)] {
        assert_eq!(service.ended(&job).await["state"], "succeeded");
        let report = json(service.get(text(&job["urls"]["report"]))).await;
        assert_eq!(report["clusters"], clusters);
        assert!(report["timings_ms"]["download"].as_f64() > Some(0.0), "{report}");
    }
}

#[tokio::test]
async fn meshes_of_many_faces_in_small_files_keep_no_thread_from_small_meshes_while_they_wait_for_memory() {
    let threads = std::thread::available_parallelism().map_or(2, |count| count.get().max(2));
    // room for all of these while their faces are unknown, and then for no two that have many beside all small ones
    let change = |settings: &mut Settings| {
        settings.meshes_in_memory = 3 * threads;
        settings.work.memory_budget = Some(8_250_000 * threads as u64);
    };
    let (service, faults) = held(change, Box::new(CpuDevice::new())).await;
    faults.hold(FaultPoint::Finish);
    let mut jobs = Vec::new();
    for _ in 0..threads {
        jobs.push(service.submit("clusters=5", sphere(300)).await);
    }
    until(async || faults.waiting(FaultPoint::Finish) == threads).await;
    // each thread for small meshes has one; the others wait for these threads in this order
    let dense = sphere_glb(55_000);
    assert!(dense.len() < 1 << 20, "{}", dense.len());
    for _ in 0..threads {
        let request = service.post("/v1/jobs?clusters=50&quality=fast").header("content-type", "model/gltf-binary");
        jobs.push(json(request.body(dense.clone())).await);
    }
    for _ in 0..threads {
        jobs.push(service.submit("clusters=5", sphere(300)).await);
    }
    for job in &jobs {
        service.reaches(job, "running").await;
    }
    faults.disarm();
    for job in jobs {
        assert_eq!(service.ended(&job).await["state"], "succeeded");
    }
}

#[tokio::test]
async fn a_job_that_is_cancelled_while_its_results_are_made_keeps_its_place_until_its_mesh_is_gone() {
    let (service, faults) = held(|settings| settings.meshes_in_memory = 1, cpu()).await;
    faults.hold(FaultPoint::Finish);
    let job = service.submit("clusters=5", sphere(300)).await;
    until(async || faults.waiting(FaultPoint::Finish) == 1).await;
    let answer = service.delete(path(&job)).send().await.expect("answered");
    assert_eq!(answer.status(), 202);
    assert_eq!(service.ended(&job).await["state"], "cancelled");
    // the place for tenants without a running job
    service.submit("clusters=5", sphere(300)).await;
    until(async || faults.waiting(FaultPoint::Finish) == 2).await;
    let next = service.submit("clusters=5", sphere(300)).await;
    let state = service.job(&next).await["state"].clone();
    faults.disarm();
    assert_eq!(state, "queued");
    assert_eq!(service.ended(&next).await["state"], "succeeded");
}

#[tokio::test]
async fn time_for_a_job_includes_that_for_its_results() {
    let (service, faults) = held(|settings| settings.work.max_job_seconds = 1, cpu()).await;
    faults.hold(FaultPoint::Finish);
    let job = service.submit("clusters=5", sphere(300)).await;
    let ended = service.ended(&job).await;
    assert_eq!(ended["problem"]["type"], "/problems/time-limit", "{ended}");
    faults.disarm();
    // on a slow machine it reaches the limit, too
    let next = service.submit("clusters=5", sphere(300)).await;
    service.ended(&next).await;
}
