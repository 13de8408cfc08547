//! Real disks that are full: a small tmpfs as the data folder. Where nothing can be mounted, these tests say so and
//! pass.
#![cfg(target_os = "linux")]

use std::io::Write as _;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use serde_json::Value;
use tempfile::TempDir;
use tesserae_mesh::device::Device;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Extras, Settings};

use crate::support::*;

const MIB: u64 = 1 << 20;

/// A disk of its own.
struct Disk(Arc<TempDir>);

impl Disk {
    /// One of so many bytes; none where nothing can be mounted.
    fn mount(bytes: u64) -> Option<Self> {
        let folder = Arc::new(tempfile::tempdir().expect("a folder"));
        let options = format!("size={bytes},mode=0700");
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &options, "tmpfs"]).arg(folder.path());
        match mount.output() {
            Ok(done) if done.status.success() => Some(Self(folder)),
            _ => {
                eprintln!("NOT TESTED: no tmpfs can be mounted here, which takes root");
                None
            }
        }
    }

    async fn service(&self, device: Box<dyn Device>, change: impl FnOnce(&mut Settings)) -> Service {
        Service::on(Arc::clone(&self.0), change, device, None, Extras::default()).await
    }

    /// Writes a file until the disk is full; where it is.
    fn fill(&self, name: &str) -> PathBuf {
        let path = self.0.path().join(name);
        let mut file = std::fs::File::create(&path).expect("a file");
        for piece in [MIB as usize, 4096, 1] {
            while file.write_all(&vec![1; piece]).is_ok() {}
        }
        path
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // lazily: a service may still be closing its files
        let _ = Command::new("umount").arg("-l").arg(self.0.path()).status();
    }
}

async fn jobs(service: &Service) -> usize {
    json(service.get("/v1/jobs?limit=1000")).await["jobs"].as_array().map_or(0, Vec::len)
}

#[tokio::test]
async fn a_disk_that_small_jobs_filled_takes_jobs_again_once_they_are_deleted() {
    let Some(disk) = Disk::mount(100_000_000) else { return };
    let cpu = Box::new(CpuDevice::new());
    let service = disk.service(cpu, |settings| settings.storage.min_free_bytes = 80_000_000).await;
    let mesh = sphere(1500);
    let post = async || {
        // a hierarchy that is kept in the store
        service.obj("algorithm=pml", mesh.clone()).header("prefer", "wait=60").send().await.expect("answered")
    };
    let mut accepted = Vec::new();
    loop {
        let answer = post().await;
        if answer.status() == 507 {
            break;
        }
        assert_eq!(answer.status(), 200);
        accepted.push(answer.json::<Value>().await.expect("JSON"));
    }
    assert!(accepted.len() > 10, "{}", accepted.len());
    for job in &accepted {
        assert_eq!(service.delete(path(job)).send().await.expect("answered").status(), 204);
    }
    until(async || post().await.status() == 200).await;
}

#[tokio::test]
async fn every_job_that_a_small_disk_accepts_ends() {
    let Some(disk) = Disk::mount(48 * MIB) else { return };
    let (device, gate) = Held::behind_gate();
    let service = disk.service(device, |settings| settings.storage.min_free_bytes = 16 * MIB).await;
    let mesh = sphere(20_000);
    let mut accepted = Vec::new();
    let detail = loop {
        let query = format!("/v1/jobs?algorithm=pml&levels={}", 500 + accepted.len());
        let request = service.post(&query).header("content-type", "model/obj").body(mesh.clone());
        let answer = request.send().await.expect("answered");
        if answer.status() != 202 {
            break problem(answer, 507, "insufficient-storage").await;
        }
        accepted.push(answer.json::<Value>().await.expect("JSON"));
        assert!(accepted.len() < 1000);
    };
    assert!(detail.contains("--min-free-bytes") && detail.contains("delete jobs"), "{detail}");
    assert!(accepted.len() > 1, "some fit");
    gate.open();
    for job in &accepted {
        let ended = service.ended(job).await;
        assert_eq!(ended["state"], "succeeded", "{ended}");
    }
    // without uploads, no room is kept for their results
    service.submit("clusters=5", sphere(300)).await;
}

/// Posts until the answer is 507; how many were accepted before.
async fn until_refused(post: impl AsyncFn() -> u16) -> usize {
    for accepted in 0..1000 {
        let status = post().await;
        if status != 202 {
            assert_eq!(status, 507);
            return accepted;
        }
    }
    panic!("the disk never fills up");
}

#[tokio::test]
async fn room_that_accepted_jobs_need_is_kept_after_a_restart() {
    let Some(disk) = Disk::mount(64 * MIB) else { return };
    let change = |settings: &mut Settings| {
        settings.storage.min_free_bytes = 16 * MIB;
        settings.grace_period = 0;
    };
    let (device, _gate) = Held::behind_gate();
    let mut service = disk.service(device, change).await;
    let mesh = sphere_glb(20_000);
    let post = async |service: &Service| {
        let request = service.post("/v1/jobs?clusters=5").header("content-type", "model/gltf-binary");
        request.body(mesh.clone()).send().await.expect("answered").status().as_u16()
    };
    let accepted = until_refused(async || post(&service).await).await;
    service.stopped().await;
    let (device, gate) = Held::behind_gate();
    let service = disk.service(device, change).await;
    // closing the store gives the room of its log back; room that is not kept would let as many in again
    let again = until_refused(async || post(&service).await).await;
    assert!(again * 4 <= accepted, "there is no more room than before: {accepted}, then {again}");
    gate.open();
    until(async || post(&service).await == 202).await;
}

#[tokio::test]
async fn a_job_without_room_for_its_results_goes_on_when_there_is_some_and_fails_for_a_retry_otherwise() {
    for is_in_time in [true, false] {
        let Some(disk) = Disk::mount(64 * MIB) else { return };
        let (device, gate) = Held::behind_gate();
        let patience = (!is_in_time).then_some(Duration::from_secs(1));
        let extras = Extras { patience, ..Extras::default() };
        let change = |settings: &mut Settings| settings.storage.min_free_bytes = 0;
        let service = Service::on(Arc::clone(&disk.0), change, device, None, extras).await;
        let job = service.submit("algorithm=pml", sphere(20_000)).await;
        service.reaches(&job, "running").await;
        let filler = disk.fill("filler");
        gate.open();
        if is_in_time {
            until(async || metric(&service, "tesserae_stuck_jobs").await == 1.0).await;
            std::fs::remove_file(filler).expect("removed");
        } else {
            let ended = service.ended(&job).await;
            assert_eq!(ended["problem"]["type"], "/problems/insufficient-storage", "{ended}");
            let another = service.obj("clusters=5", sphere(300));
            refused(another, 507, "insufficient-storage").await;
            std::fs::remove_file(filler).expect("removed");
            json(service.post(&format!("{}/retry", path(&job)))).await;
        }
        let ended = service.ended(&job).await;
        assert_eq!(ended["state"], "succeeded", "{ended}");
        service.keeps_no("uploads").await;
    }
}

#[tokio::test]
async fn deletions_work_on_a_full_disk() {
    let Some(disk) = Disk::mount(48 * MIB) else { return };
    let service = disk.service(Box::new(CpuDevice::new()), |settings| settings.storage.min_free_bytes = 0).await;
    let mut small = Vec::new();
    for _ in 0..2 {
        small.push(service.submit("clusters=5", sphere(300)).await);
    }
    let large = service.submit("clusters=50&quality=fast", sphere(70_000)).await;
    for job in small.iter().chain([&large]) {
        assert_eq!(service.ended(job).await["state"], "succeeded");
    }
    disk.fill("filler");
    let delete = async |job: &Value| service.delete(path(job)).send().await.expect("answered").status();
    assert_eq!(delete(&small[0]).await, 204, "with the ballast");
    disk.fill("filler again");
    assert_eq!(delete(&large).await, 204, "with the room of its own files");
    assert_eq!(jobs(&service).await, 1);
}

#[tokio::test]
async fn jobs_are_cancelled_on_a_full_disk() {
    let Some(disk) = Disk::mount(48 * MIB) else { return };
    let (device, _gate) = Held::behind_gate();
    let change = |settings: &mut Settings| {
        settings.storage.min_free_bytes = 0;
        settings.meshes_in_memory = 1;
    };
    let service = disk.service(device, change).await;
    let running = service.submit("clusters=5", sphere(300)).await;
    service.reaches(&running, "running").await;
    let mut waiting = Vec::new();
    for _ in 0..50 {
        waiting.push(service.submit("clusters=5", sphere(300)).await);
    }
    disk.fill("filler");
    for job in waiting.iter().chain([&running]) {
        assert_eq!(service.delete(path(job)).send().await.expect("answered").status(), 202);
        assert_eq!(service.ended(job).await["state"], "cancelled");
    }
}

#[tokio::test]
async fn jobs_expire_on_a_full_disk() {
    let Some(disk) = Disk::mount(48 * MIB) else { return };
    let mut service = disk.service(Box::new(CpuDevice::new()), |settings| settings.storage.min_free_bytes = 0).await;
    let mut ended = Vec::new();
    for faces in [300, 70_000, 300, 70_000] {
        ended.push(service.submit("clusters=5&quality=fast", sphere(faces)).await);
    }
    for job in &ended {
        assert_eq!(service.ended(job).await["state"], "succeeded");
    }
    service.stopped().await;
    let filler = disk.fill("filler");
    let change = |settings: &mut Settings| {
        settings.storage.min_free_bytes = 0;
        settings.storage.retention = 1;
    };
    let service = disk.service(Box::new(CpuDevice::new()), change).await;
    until(async || jobs(&service).await == 0).await;
    std::fs::remove_file(filler).expect("removed");
    // the ballast is there again, and jobs go on
    until(async || disk.0.path().join("ballast").exists()).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
}

#[tokio::test]
async fn a_service_starts_on_a_disk_that_was_filled_when_the_ballast_was_gone() {
    for expires in [false, true] {
        let Some(disk) = Disk::mount(48 * MIB) else { return };
        let change = |settings: &mut Settings| settings.storage.min_free_bytes = 0;
        let mut service = disk.service(Box::new(CpuDevice::new()), change).await;
        let mut ended = Vec::new();
        for faces in [300, 70_000, 300] {
            let job = service.submit("clusters=5&quality=fast", sphere(faces)).await;
            assert_eq!(service.ended(&job).await["state"], "succeeded");
            ended.push(job);
        }
        let delete = async |service: &Service, job: &Value| {
            service.delete(path(job)).send().await.expect("answered").status().as_u16()
        };
        let filler = disk.fill("filler");
        assert_eq!(delete(&service, &ended[0]).await, 204, "with the ballast");
        service.stopped().await;
        // the room of the ballast, and of the log of the store
        let last = disk.fill("last");
        let restart = |settings: &mut Settings| {
            change(settings);
            if expires {
                settings.storage.retention = 1;
            }
        };
        let service = disk.service(Box::new(CpuDevice::new()), restart).await;
        if !expires {
            assert_eq!(jobs(&service).await, 2);
            assert_eq!(delete(&service, &ended[1]).await, 204, "with the room of its own files");
            assert_eq!(delete(&service, &ended[2]).await, 204);
        }
        until(async || jobs(&service).await == 0).await;
        for filler in [filler, last] {
            std::fs::remove_file(filler).expect("removed");
        }
        // both parts of the ballast are there again, and jobs go on
        until(async || ["ballast", "ballast.last"].iter().all(|name| disk.0.path().join(name).exists())).await;
        let job = service.submit("clusters=5", sphere(300)).await;
        assert_eq!(service.ended(&job).await["state"], "succeeded");
    }
}
