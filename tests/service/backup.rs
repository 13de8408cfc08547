//! Backups of a service that runs.

use std::path::Path;
use std::sync::Arc;

use serde_json::Value;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Backup, Extras, Settings, back_up};

use crate::support::*;

async fn back_up_to(service: &Service, to: &Path) -> Backup {
    let (from, to) = (service.folder(), to.to_owned());
    let made = tokio::task::spawn_blocking(move || back_up(from.path(), &to)).await;
    made.expect("no panic").expect("made")
}

async fn labels(service: &Service, job: &Value) -> Vec<u8> {
    let request = service.get(text(&job["urls"]["labels"])).header("accept", "application/x-npy");
    request.send().await.expect("answered").bytes().await.expect("bytes").to_vec()
}

#[tokio::test]
async fn a_service_on_a_backup_serves_results_and_runs_what_waited() {
    let service = Service::start().await;
    let meshes = [sphere(300), sphere(70_000)];
    let mut ended = Vec::new();
    for mesh in &meshes {
        let job = service.submit("clusters=7&quality=fast", mesh.clone()).await;
        assert_eq!(service.ended(&job).await["state"], "succeeded");
        ended.push((labels(&service, &job).await, job));
    }
    let folder = service.folder();
    let mut service = service;
    service.stopped().await;
    let (device, _gate) = Held::behind_gate();
    let change = |settings: &mut Settings| {
        settings.meshes_in_memory = 1;
        settings.grace_period = 0;
    };
    let service = Service::on(folder, change, device, None, Extras::default()).await;
    let mut waiting = Vec::new();
    for mesh in meshes.iter().rev() {
        waiting.push(service.submit("clusters=7&quality=fast", mesh.clone()).await);
    }
    service.reaches(&waiting[0], "running").await;

    let to = Arc::new(tempfile::tempdir().expect("a folder"));
    let backup = back_up_to(&service, to.path()).await;
    // a report and labels of the large job that ended, and the mesh of the one that runs
    assert_eq!((backup.jobs, backup.files, backup.left_out), (4, 3, 0));
    let store = rusqlite::Connection::open(to.path().join("jobs.sqlite3")).expect("it opens");
    let sql = "SELECT count(*), sum(begun) FROM jobs WHERE state = 'running'";
    let running: (i64, i64) = store.query_row(sql, [], |row| Ok((row.get(0)?, row.get(1)?))).expect("readable");
    assert_eq!(running, (1, 0), "no process died in which the job ran");
    drop(store);
    let copy = Service::on(to, |_| {}, Box::new(CpuDevice::new()), None, Extras::default()).await;
    for (expected, job) in &ended {
        assert!(labels(&copy, job).await == *expected);
    }
    for (job, (expected, _)) in waiting.iter().zip(ended.iter().rev()) {
        let job = copy.ended(job).await;
        assert_eq!(job["state"], "succeeded", "{job}");
        assert!(labels(&copy, &job).await == *expected);
    }
    // the service itself goes on with its own
    assert_eq!(service.job(&waiting[0]).await["state"], "running");
}

#[tokio::test]
async fn a_backup_under_load_holds_all_files_of_its_jobs() {
    let service = Service::start().await;
    let mesh = sphere_glb(16_000);
    let work = async {
        loop {
            let request =
                service.post("/v1/jobs?clusters=500&quality=fast").header("content-type", "model/gltf-binary");
            let job = json(request.body(mesh.clone())).await;
            assert_eq!(service.ended(&job).await["state"], "succeeded");
            assert_eq!(service.delete(path(&job)).send().await.expect("answered").status(), 204);
        }
    };
    let copies = async {
        for _ in 0..3 {
            let to = Arc::new(tempfile::tempdir().expect("a folder"));
            back_up_to(&service, to.path()).await;
            let copy = Service::on(to, |_| {}, Box::new(CpuDevice::new()), None, Extras::default()).await;
            for job in json(copy.get("/v1/jobs")).await["jobs"].as_array().expect("jobs") {
                let ended = copy.ended(job).await;
                match text(&ended["state"]) {
                    "succeeded" => assert!(!labels(&copy, &ended).await.is_empty()),
                    state => assert_eq!(state, "cancelled", "{ended}"),
                }
            }
        }
    };
    tokio::select! {
        () = copies => {}
        () = work => unreachable!(),
        () = work_beside(&service, &mesh) => unreachable!(),
    }
}

/// Jobs that are there for a moment only, and cancelled.
async fn work_beside(service: &Service, mesh: &[u8]) {
    loop {
        let request = service.post("/v1/jobs?clusters=500").header("content-type", "model/gltf-binary");
        let job = json(request.body(mesh.to_vec())).await;
        service.delete(path(&job)).send().await.expect("answered");
        service.ended(&job).await;
    }
}
