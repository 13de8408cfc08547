//! Neighbouring jobs: what one does before and after the device has it goes on while the device is at another.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use serde_json::Value;
use tesserae::device::cpu::CpuDevice;
use tesserae::device::select::{self, DeviceChoice};
use tesserae::device::{Device, MergeSteps, Steps, Uploaded, Uploader};
use tesserae::report::DeviceInfo;
use tesserae::service::{Extras, FaultPoint, Faults, Reopen, Settings};
use tesserae::surface::DualGraph;
use tesserae::{Error, Kind};

use crate::support::*;

/// A service that can be held at named points.
async fn held(change: impl FnOnce(&mut Settings), device: Box<dyn Device>) -> (Service, Faults) {
    let faults = Faults::default();
    let extras = Extras { faults: faults.clone(), ..Extras::default() };
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    (Service::on(data, change, device, None, extras).await, faults)
}

fn cpu() -> Box<dyn Device> {
    Box::new(Plain(CpuDevice::new()))
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
    // room for all of these while nobody knows their faces, and then for no two that have many beside all small ones
    let change = |settings: &mut Settings| {
        settings.meshes_in_memory = 3 * threads;
        settings.work.memory_budget = Some(7_500_000 * threads as u64);
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
    let next = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.job(&next).await["state"], "queued");
    faults.disarm();
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
    let next = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&next).await["state"], "succeeded");
}

/// Jobs of each kind, the first of which is at the device while the others come.
const QUERIES: [&str; 3] = ["clusters=9&seeds=morton", "clusters=40", "algorithm=pml&levels=20"];

fn meshes() -> [Vec<u8>; 3] {
    [sphere(300), sphere(2000), sphere(700)]
}

/// What is the same wherever and however a job ran.
async fn essence(service: &Service, job: &Value) -> Value {
    let mut report = json(service.get(text(&job["urls"]["report"]))).await;
    report["timings_ms"].take();
    report["device"].take();
    for row in report["iterations"].as_array_mut().expect("rows") {
        row["elapsed_us"].take();
    }
    report
}

/// The reports of [`QUERIES`] from a service on the cpu.
async fn expected() -> Vec<Value> {
    let service = Service::start().await;
    let mut expected = Vec::new();
    for (query, mesh) in QUERIES.into_iter().zip(meshes()) {
        let job = service.submit(query, mesh).await;
        assert_eq!(service.ended(&job).await["state"], "succeeded");
        expected.push(essence(&service, &job).await);
    }
    expected
}

/// A service on a gpu behind a gate, with the first job of [`QUERIES`] at it.
async fn at_the_gate(seen: &Arc<Seen>) -> (Service, Vec<Value>) {
    let again = Arc::clone(seen);
    let reopen: Reopen = Arc::new(move || {
        again.opened_anew.fetch_add(1, Ordering::SeqCst);
        Ok(Watched::boxed(&again))
    });
    let extras = Extras { reopen: Some(reopen), ..Extras::default() };
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    let service = Service::on(data, |_| {}, Watched::boxed(seen), None, extras).await;
    let first = service.submit(QUERIES[0], meshes()[0].clone()).await;
    until(async || seen.came.load(Ordering::SeqCst) == 1).await;
    (service, vec![first])
}

/// Submits the others of [`QUERIES`], each once the one before has been brought to the device, or could not be.
async fn submit_the_others(service: &Service, seen: &Arc<Seen>, jobs: &mut Vec<Value>) {
    for (query, mesh) in QUERIES.into_iter().zip(meshes()).skip(1) {
        jobs.push(service.submit(query, mesh).await);
        until(async || seen.uploads.load(Ordering::SeqCst) == 1).await;
    }
}

async fn assert_right(service: &Service, jobs: &[Value]) {
    for (job, expected) in jobs.iter().zip(expected().await) {
        assert_eq!(service.ended(job).await["state"], "succeeded");
        assert_eq!(essence(service, job).await, expected);
    }
}

#[tokio::test]
async fn the_next_mesh_is_brought_to_the_device_while_it_works_and_nothing_else_changes() {
    let seen = Arc::<Seen>::default();
    let (service, mut jobs) = at_the_gate(&seen).await;
    submit_the_others(&service, &seen, &mut jobs).await;
    until(async || metric(&service, "tesserae_uploads_ahead_total").await == 1.0).await;
    assert_eq!(seen.received.load(Ordering::SeqCst), 0);
    seen.gate.open();
    assert_right(&service, &jobs).await;
    assert!(seen.received.load(Ordering::SeqCst) >= 1, "it was taken");
    assert_eq!(Arc::strong_count(&seen.alive), 1, "nothing is left");
}

#[tokio::test]
async fn a_mesh_that_cannot_be_brought_ahead_is_brought_at_its_turn() {
    let seen = Arc::new(Seen { failures: AtomicUsize::new(usize::MAX), ..Seen::default() });
    let (service, mut jobs) = at_the_gate(&seen).await;
    submit_the_others(&service, &seen, &mut jobs).await;
    seen.gate.open();
    assert_right(&service, &jobs).await;
    assert_eq!(metric(&service, "tesserae_uploads_ahead_total").await, 0.0);
    assert_eq!(seen.received.load(Ordering::SeqCst), 0);
}

#[tokio::test]
async fn what_was_brought_to_a_device_that_is_lost_is_brought_to_the_next() {
    let seen = Arc::new(Seen { losses: AtomicUsize::new(1), ..Seen::default() });
    let (service, mut jobs) = at_the_gate(&seen).await;
    submit_the_others(&service, &seen, &mut jobs).await;
    seen.gate.open();
    assert_right(&service, &jobs).await;
    assert_eq!(seen.opened_anew.load(Ordering::SeqCst), 1);
    assert!(
        seen.received.load(Ordering::SeqCst) >= 1,
        "the other device was given it, and knew that it was not its own"
    );
    assert_eq!(Arc::strong_count(&seen.alive), 1, "nothing is left");
}

#[tokio::test]
async fn a_job_that_is_cancelled_frees_what_was_brought_of_its_mesh() {
    let seen = Arc::<Seen>::default();
    let (service, mut jobs) = at_the_gate(&seen).await;
    let cancelled = service.submit("clusters=5", sphere(500)).await;
    until(async || seen.uploads.load(Ordering::SeqCst) == 1).await;
    let answer = service.delete(path(&cancelled)).send().await.expect("answered");
    assert_eq!(answer.status(), 202);
    assert_eq!(service.ended(&cancelled).await["state"], "cancelled");
    until(async || Arc::strong_count(&seen.alive) == 1).await;
    // the next is brought in its place
    jobs.push(service.submit(QUERIES[1], meshes()[1].clone()).await);
    until(async || seen.uploads.load(Ordering::SeqCst) == 2).await;
    seen.gate.open();
    assert_right(&service, &jobs).await;
}

#[tokio::test]
async fn a_device_without_work_rests_and_works_again() {
    let seen = Arc::<Seen>::default();
    seen.gate.open();
    let extras = Extras { idle: Some(Duration::from_millis(1)), ..Extras::default() };
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    let service = Service::on(data, |_| {}, Watched::boxed(&seen), None, extras).await;
    let mut jobs = Vec::new();
    for (query, mesh) in QUERIES.into_iter().zip(meshes()) {
        let before = seen.rested.load(Ordering::SeqCst);
        let job = service.submit(query, mesh).await;
        assert_eq!(service.ended(&job).await["state"], "succeeded");
        jobs.push(job);
        until(async || seen.rested.load(Ordering::SeqCst) > before).await;
    }
    assert_right(&service, &jobs).await;
}

#[tokio::test]
async fn what_the_cpu_will_take_is_not_brought_to_the_device() {
    let seen = Arc::<Seen>::default();
    let device = Watched::boxed(&seen);
    let service = Service::with_choice(|_| {}, device, Some(400)).await;
    let first = service.submit("clusters=9", sphere(1000)).await;
    until(async || seen.came.load(Ordering::SeqCst) == 1).await;
    let few = service.submit("clusters=5", sphere(300)).await;
    let sequential = service.submit("clusters=5&algorithm=acvd", sphere(1000)).await;
    let last = service.submit("clusters=5", sphere(1000)).await;
    seen.gate.open();
    for job in [first, few, sequential, last] {
        assert_eq!(service.ended(&job).await["state"], "succeeded");
    }
    assert!(seen.faces.lock().expect("unpoisoned").iter().all(|&faces| faces > 400), "{seen:?}");
    assert!(seen.uploads.load(Ordering::SeqCst) <= 1, "{seen:?}");
}

/// What happened at a device, and what shall.
#[derive(Debug, Default)]
struct Seen {
    gate: Gate,
    /// Surfaces that came to be opened, uploads that were begun, those that the device was given.
    came: AtomicUsize,
    uploads: AtomicUsize,
    received: AtomicUsize,
    opened_anew: AtomicUsize,
    rested: AtomicUsize,
    /// Faces of the surfaces whose upload was begun.
    faces: std::sync::Mutex<Vec<usize>>,
    /// Uploads that will fail, and devices that will be lost behind the gate.
    failures: AtomicUsize,
    losses: AtomicUsize,
    /// Held by everything that was uploaded.
    alive: Arc<()>,
}

/// Whether another one of so many is to happen.
fn happens(left: &AtomicUsize) -> bool {
    left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left: usize| left.checked_sub(1)).is_ok()
}

/// A gpu that lets nothing through before its gate opens.
struct Watched {
    gpu: Box<dyn Device>,
    seen: Arc<Seen>,
}

struct WatchedUploader {
    gpu: Arc<dyn Uploader>,
    seen: Arc<Seen>,
}

struct Counted {
    uploaded: Uploaded,
    _alive: Arc<()>,
}

impl Watched {
    fn boxed(seen: &Arc<Seen>) -> Box<dyn Device> {
        let gpu = select::open(DeviceChoice::Gpu, None, None)
            .expect("these tests need a Vulkan driver: install mesa-vulkan-drivers, as `make test` does");
        Box::new(Self { gpu, seen: Arc::clone(seen) })
    }

    fn pass(&self) -> tesserae::Result<()> {
        self.seen.came.fetch_add(1, Ordering::SeqCst);
        self.seen.gate.pass();
        if happens(&self.seen.losses) { Err(Error::new(Kind::DeviceLost, "the card fell out")) } else { Ok(()) }
    }
}

impl Uploader for WatchedUploader {
    fn upload(&self, graph: &DualGraph) -> tesserae::Result<Uploaded> {
        self.seen.faces.lock().expect("unpoisoned").push(graph.faces());
        let uploaded = match happens(&self.seen.failures) {
            true => Err(Error::new(Kind::DeviceLost, "no room")),
            false => self.gpu.upload(graph),
        };
        let counted =
            uploaded.map(|uploaded| Box::new(Counted { uploaded, _alive: Arc::clone(&self.seen.alive) }) as Uploaded);
        self.seen.uploads.fetch_add(1, Ordering::SeqCst);
        counted
    }
}

impl Device for Watched {
    fn info(&self) -> &DeviceInfo {
        self.gpu.info()
    }

    fn uploader(&self) -> Option<Arc<dyn Uploader>> {
        Some(Arc::new(WatchedUploader { gpu: self.gpu.uploader()?, seen: Arc::clone(&self.seen) }))
    }

    fn receive(&mut self, uploaded: Uploaded) {
        self.seen.received.fetch_add(1, Ordering::SeqCst);
        self.gpu.receive(uploaded.downcast::<Counted>().expect("counted").uploaded);
    }

    fn rest(&mut self) {
        self.seen.rested.fetch_add(1, Ordering::SeqCst);
        self.gpu.rest();
    }

    fn open<'a>(&'a mut self, graph: &'a DualGraph, components: &'a [u32]) -> tesserae::Result<Box<dyn Steps + 'a>> {
        self.pass()?;
        self.gpu.open(graph, components)
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph,
        components: &'a [u32],
    ) -> tesserae::Result<Box<dyn MergeSteps + 'a>> {
        self.pass()?;
        self.gpu.open_merging(graph, components)
    }
}

/// A cpu that works on one mesh at a time, small ones too.
struct Plain(CpuDevice);

impl Device for Plain {
    fn info(&self) -> &DeviceInfo {
        self.0.info()
    }

    fn open<'a>(&'a mut self, graph: &'a DualGraph, components: &'a [u32]) -> tesserae::Result<Box<dyn Steps + 'a>> {
        self.0.open(graph, components)
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph,
        components: &'a [u32],
    ) -> tesserae::Result<Box<dyn MergeSteps + 'a>> {
        self.0.open_merging(graph, components)
    }
}
