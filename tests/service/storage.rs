//! The data folder: a store that was lost, that is damaged, and folders that go away.

use std::path::Path;
use std::sync::Arc;

use tempfile::TempDir;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Extras, Server, Settings};

use crate::support::*;

/// Why no service starts in a folder.
async fn refusal(folder: &TempDir) -> String {
    let settings = Settings {
        listen: ([127, 0, 0, 1], 0).into(),
        data_dir: Some(folder.path().to_owned()),
        ..Settings::default()
    };
    Server::bind(settings, Box::new(CpuDevice::new()), description(), Extras::default())
        .await
        .expect_err("it must not start")
        .message
}

fn found(folder: &Path, name: &str) -> Vec<std::path::PathBuf> {
    let mut all = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            match entry.path() {
                path if path.is_dir() => folders.push(path),
                path if path.ends_with(name) => all.push(path),
                _ => {}
            }
        }
    }
    all
}

#[tokio::test]
async fn results_outlast_a_store_that_was_lost() {
    let mut service = Service::start().await;
    service.stopped().await;
    let folder = service.folder();
    let store = folder.path().join("jobs.sqlite3");
    let older = std::fs::read(&store).expect("a store");
    let mut service = service.again(|_| {}).await;
    let job = service.submit("clusters=5&quality=fast", sphere(70_000)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
    service.stopped().await;
    let kept = std::fs::read(&store).expect("a store");

    let mut another = Service::start().await;
    another.stopped().await;
    let other = std::fs::read(another.folder().path().join("jobs.sqlite3")).expect("a store");
    // removed, emptied, from before its jobs, and another one
    std::fs::remove_file(&store).expect("removed");
    for content in [None, Some(Vec::new()), Some(older), Some(other)] {
        if let Some(content) = content {
            std::fs::write(&store, content).expect("written");
        }
        let why = refusal(&folder).await;
        assert!(why.contains("missing, empty, older than its files") && why.contains("move uploads, results"), "{why}");
        assert_eq!(found(&folder.path().join("results"), "labels.npy").len(), 1);
    }
    // put back, all is as before
    std::fs::write(&store, kept).expect("written");
    let service = service.again(|_| {}).await;
    assert_eq!(service.job(&job).await["state"], "succeeded");
    let mut service = service;
    service.stopped().await;

    // moved out of the folder, as the message says
    std::fs::remove_file(&store).expect("removed");
    for name in ["results", "owner", "ballast"] {
        std::fs::rename(folder.path().join(name), folder.path().join(format!("old-{name}"))).expect("moved");
    }
    let service = service.again(|_| {}).await;
    assert_eq!(found(&folder.path().join("old-results"), "labels.npy").len(), 1);
    refused(service.get(path(&job)), 404, "not-found").await;
}

#[tokio::test]
async fn a_store_of_small_jobs_that_was_lost_is_missed() {
    let service = Service::start().await;
    let job = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
    let mut service = service;
    service.stopped().await;
    let folder = service.folder();
    std::fs::remove_file(folder.path().join("jobs.sqlite3")).expect("removed");
    let why = refusal(&folder).await;
    assert!(why.contains("missing, empty, older") && why.contains("empty store"), "{why}");
    for name in ["owner", "ballast"] {
        std::fs::remove_file(folder.path().join(name)).expect("removed");
    }
    let service = service.again(|_| {}).await;
    refused(service.get(path(&job)), 404, "not-found").await;
    let mut service = service;
    service.stopped().await;
    service.again(|_| {}).await;
}

#[tokio::test]
async fn results_that_an_older_copy_of_the_store_does_not_know_stay_and_are_counted() {
    let service = Service::start().await;
    let known = service.submit("clusters=5&quality=fast", sphere(70_000)).await;
    assert_eq!(service.ended(&known).await["state"], "succeeded");
    let mut service = service;
    service.stopped().await;
    let folder = service.folder();
    let store = folder.path().join("jobs.sqlite3");
    let older = std::fs::read(&store).expect("a store");
    let service = service.again(|_| {}).await;
    let lost = service.submit("clusters=5&quality=fast", sphere(70_000)).await;
    assert_eq!(service.ended(&lost).await["state"], "succeeded");
    let mut service = service;
    service.stopped().await;
    std::fs::write(&store, older).expect("written");
    let service = service.again(|_| {}).await;
    assert_eq!(service.job(&known).await["state"], "succeeded");
    refused(service.get(path(&lost)), 404, "not-found").await;
    assert_eq!(found(&folder.path().join(format!("results/{}", text(&lost["id"]))), "labels.npy").len(), 1);
    let metrics = service.get("/metrics").send().await.expect("answered").text().await.expect("text");
    assert!(metrics.contains("\ntesserae_unknown_jobs 1\n"), "{metrics}");
}

#[tokio::test]
async fn results_are_unavailable_and_not_gone_while_the_folder_is_away() {
    let service = Service::start().await;
    let job = service.submit("clusters=5&quality=fast", sphere(70_000)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
    let folder = service.folder();
    let away = folder.path().with_extension("away");
    std::fs::rename(folder.path(), &away).expect("moved");
    let labels = text(&job["urls"]["labels"]);
    let post = |faces| service.obj("clusters=5", sphere(faces));
    for request in [service.get(labels), post(300), post(70_000)] {
        let detail = refused(request, 503, "unavailable").await;
        assert!(detail.contains("storage") && !detail.contains('/'), "clients learn no path: {detail}");
    }
    // the watch looks at the folder twice a second
    until(async || {
        let why = service.get("/readyz").send().await.expect("answered").text().await.expect("text");
        why.contains(&*folder.path().to_string_lossy())
    })
    .await;
    std::fs::rename(&away, folder.path()).expect("moved back");
    std::fs::remove_file(folder.path().join("lock")).expect("there");
    until(async || service.get("/readyz").send().await.expect("answered").status() == 200).await;
    assert_eq!(service.get(labels).send().await.expect("answered").status(), 200);
}

#[tokio::test]
async fn the_upload_of_a_job_that_ran_before_goes_when_it_is_cancelled() {
    let change = |meshes: usize| {
        move |settings: &mut Settings| {
            settings.meshes_in_memory = meshes;
            settings.grace_period = 0;
        }
    };
    let (device, _first) = Held::behind_gate();
    let mut service = Service::with(change(2), device).await;
    let mut jobs = Vec::new();
    for _ in 0..2 {
        let request = service.post("/v1/jobs?clusters=5").header("content-type", "model/gltf-binary");
        let job = json(request.body(sphere_glb(20_000))).await;
        service.reaches(&job, "running").await;
        jobs.push(job);
    }
    service.stopped().await;
    let (device, gate) = Held::behind_gate();
    let service = Service::on(service.folder(), change(1), device, None, Extras::default()).await;
    service.reaches(&jobs[0], "running").await;
    let cancelled = service.delete(path(&jobs[1])).send().await.expect("answered");
    assert_eq!(cancelled.status(), 202);
    let uploads = service.folder().path().join("uploads");
    assert!(!uploads.join(text(&jobs[1]["id"])).exists(), "it goes at once");
    assert!(uploads.join(text(&jobs[0]["id"])).exists());
    gate.open();
    assert_eq!(service.ended(&jobs[0]).await["state"], "succeeded");
}

#[cfg(unix)]
#[tokio::test]
async fn nobody_else_can_read_what_is_in_the_data_folder() {
    use std::os::unix::fs::PermissionsExt as _;

    let mode = |path: &Path| path.metadata().expect("there").permissions().mode() & 0o777;
    let folder = Arc::new(tempfile::tempdir().expect("a folder"));
    let data = folder.path().join("data");
    let place = data.clone();
    let change = |settings: &mut Settings| settings.data_dir = Some(place);
    let service = Service::on(folder, change, Box::new(CpuDevice::new()), None, Extras::default()).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    service.ended(&job).await;
    for name in ["", "uploads", "results", "scratch"] {
        assert_eq!(mode(&data.join(name)), 0o700, "{name}");
    }
    for name in ["jobs.sqlite3", "jobs.sqlite3-wal", "jobs.sqlite3-shm", "lock", "ballast", "ballast.last"] {
        assert_eq!(mode(&data.join(name)), 0o600, "{name}");
    }
}
