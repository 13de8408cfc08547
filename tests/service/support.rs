//! A server in this process, a client for it, meshes, and a device that can be held.

use std::io::Write;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use reqwest::{Client, RequestBuilder, Response};
use serde_json::Value;
use tempfile::TempDir;
use tesserae_mesh::dev::sample::{self, Sample};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Device, MergeSteps, Steps};
use tesserae_mesh::report::DeviceInfo;
use tesserae_mesh::surface::DualGraph;
use tesserae_service::{DeviceDescription, Extras, Server, Settings};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tracing_subscriber::fmt::MakeWriter;

/// Longer than anything here should take on a slow machine.
pub const PATIENCE: Duration = Duration::from_secs(180);

/// The processor as the device.
pub fn description() -> DeviceDescription {
    let (info, chosen) = (CpuDevice::new().info().clone(), "by the test".to_owned());
    DeviceDescription { info, chosen, cpu_below_faces: None, adapters: Vec::new() }
}

/// A running server; stopped when dropped.
pub struct Service {
    pub address: SocketAddr,
    pub client: Client,
    data: Arc<TempDir>,
    stop: Option<oneshot::Sender<()>>,
    running: Option<JoinHandle<tesserae_mesh::Result<()>>>,
}

impl Service {
    /// One with default settings on the cpu.
    pub async fn start() -> Self {
        Self::with(|_| {}, Box::new(CpuDevice::new())).await
    }

    /// One with changed settings and a device.
    pub async fn with(change: impl FnOnce(&mut Settings), device: Box<dyn Device>) -> Self {
        Self::with_choice(change, device, None).await
    }

    /// One whose device was chosen by name or, with a number, left to the service.
    pub async fn with_choice(
        change: impl FnOnce(&mut Settings),
        device: Box<dyn Device>,
        cpu_below_faces: Option<u64>,
    ) -> Self {
        let data = Arc::new(tempfile::tempdir().expect("a folder"));
        Self::on(data, change, device, cpu_below_faces, Extras::default()).await
    }

    /// One that works in a folder that may have been worked in before.
    pub async fn on(
        data: Arc<TempDir>,
        change: impl FnOnce(&mut Settings),
        device: Box<dyn Device>,
        cpu_below_faces: Option<u64>,
        extras: Extras,
    ) -> Self {
        let mut settings = Settings {
            listen: SocketAddr::from(([127, 0, 0, 1], 0)),
            data_dir: Some(data.path().to_owned()),
            ..Settings::default()
        };
        change(&mut settings);
        let info = device.info().clone();
        let description = DeviceDescription { info, cpu_below_faces, ..description() };
        let server = Server::bind(settings, device, description, extras).await.expect("bound");
        let address = server.address();
        let (stop, stopped) = oneshot::channel();
        let running = tokio::spawn(server.run(async {
            let _ = stopped.await;
        }));
        let client = Client::builder().timeout(PATIENCE).build().expect("a client");
        Self { address, client, data, stop: Some(stop), running: Some(running) }
    }

    /// Stops the server and starts another one, with changed settings, in the same folder.
    pub async fn again(mut self, change: impl FnOnce(&mut Settings)) -> Self {
        self.stopped().await;
        Self::on(Arc::clone(&self.data), change, Box::new(CpuDevice::new()), None, Extras::default()).await
    }

    /// The folder it works in.
    pub fn folder(&self) -> Arc<TempDir> {
        Arc::clone(&self.data)
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    pub fn get(&self, path: &str) -> RequestBuilder {
        self.client.get(self.url(path))
    }

    pub fn post(&self, path: &str) -> RequestBuilder {
        self.client.post(self.url(path))
    }

    pub fn delete(&self, path: &str) -> RequestBuilder {
        self.client.delete(self.url(path))
    }

    /// The request for a job on an OBJ.
    pub fn obj(&self, query: &str, obj: impl Into<reqwest::Body>) -> RequestBuilder {
        self.post(&format!("/v1/jobs?{query}")).header("content-type", "model/obj").body(obj)
    }

    /// Submits an OBJ and gives the accepted job.
    pub async fn submit(&self, query: &str, obj: Vec<u8>) -> Value {
        let response = self.obj(query, obj).send().await.expect("answered");
        let status = response.status();
        let job: Value = response.json().await.expect("JSON");
        assert_eq!(status, 202, "{job}");
        job
    }

    /// The job as it is now.
    pub async fn job(&self, job: &Value) -> Value {
        json(self.get(path(job))).await
    }

    /// The job once it has ended.
    pub async fn ended(&self, job: &Value) -> Value {
        let started = Instant::now();
        loop {
            let job = self.job(job).await;
            if !["queued", "running"].contains(&text(&job["state"])) {
                return job;
            }
            assert!(started.elapsed() < PATIENCE, "the job does not end: {job}");
            tokio::time::sleep(Duration::from_millis(15)).await;
        }
    }

    /// The job once it is in a state.
    pub async fn reaches(&self, job: &Value, state: &str) -> Value {
        let started = Instant::now();
        loop {
            let job = self.job(job).await;
            if text(&job["state"]) == state {
                return job;
            }
            assert!(started.elapsed() < PATIENCE, "the job is not {state}: {job}");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    /// Asks the server to stop.
    pub fn ask_to_stop(&mut self) {
        self.stop.take();
    }

    /// Stops the server and waits until it has.
    pub async fn stopped(&mut self) {
        self.ask_to_stop();
        let Some(running) = self.running.take() else { return };
        tokio::time::timeout(PATIENCE, running).await.expect("in time").expect("no panic").expect("no error");
    }

    /// Uploads and results that the service keeps.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut found = Vec::new();
        for folder in ["uploads", "results", "scratch"] {
            collect(&self.data.path().join(folder), &mut found);
        }
        found
    }

    /// Waits until the service keeps no file whose path holds `part`.
    pub async fn keeps_no(&self, part: &str) {
        let started = Instant::now();
        while let Some(file) = self.files().into_iter().find(|file| file.to_string_lossy().contains(part)) {
            assert!(started.elapsed() < PATIENCE, "still there: {}", file.display());
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }
}

fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            collect(&path, found);
        } else {
            found.push(path);
        }
    }
}

/// The text of a JSON string.
pub fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_else(|| panic!("no text: {value}"))
}

/// Path of a job.
pub fn path(job: &Value) -> &str {
    text(&job["urls"]["self"])
}

/// The body of a successful answer.
pub async fn json(request: RequestBuilder) -> Value {
    let response = request.send().await.expect("answered");
    assert!(response.status().is_success(), "{}", response.status());
    response.json().await.expect("JSON")
}

/// Checks that an answer is a problem document of that status and kind; gives its detail.
pub async fn problem(response: Response, status: u16, kind: &str) -> String {
    let media_type = response.headers().get("content-type").cloned();
    let (answered, path) = (response.status().as_u16(), response.url().path().to_owned());
    let body = response.text().await.expect("text");
    assert_eq!(answered, status, "{body}");
    assert_eq!(media_type.expect("a media type"), "application/problem+json", "{body}");
    let problem: Value = serde_json::from_str(&body).expect("JSON");
    assert_eq!(problem["type"], format!("/problems/{kind}"), "{body}");
    assert_eq!(problem["status"], status, "{body}");
    assert!(!text(&problem["title"]).is_empty());
    assert!(path == text(&problem["instance"]) || text(&problem["instance"]).starts_with("/v1/jobs/"), "{body}");
    text(&problem["detail"]).to_owned()
}

/// [`problem`] of the answer to a request.
pub async fn refused(request: RequestBuilder, status: u16, kind: &str) -> String {
    problem(request.send().await.expect("answered"), status, kind).await
}

/// Waits until something holds.
pub async fn until(holds: impl AsyncFn() -> bool) {
    let started = Instant::now();
    while !holds().await {
        assert!(started.elapsed() < PATIENCE, "it does not come to hold");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// The value of a metric, labels included in its name.
pub async fn metric(service: &Service, name: &str) -> f64 {
    let text = service.get("/metrics").send().await.expect("answered").text().await.expect("text");
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("no {name}:\n{text}")).parse().expect("a number")
}

/// A sphere of some `faces` triangles as OBJ.
pub fn sphere(faces: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    sample::write_obj(&mut bytes, &sample::generate(Sample::Sphere, faces).expect("a sphere")).expect("written");
    bytes
}

/// A sphere of some `faces` triangles as GLB.
pub fn sphere_glb(faces: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    sample::write_glb(&mut bytes, &sample::generate(Sample::Sphere, faces).expect("a sphere")).expect("written");
    bytes
}

/// A gate that is shut or open. It lets through what has waited longer than a test takes, so that a test that failed
/// ends.
#[derive(Debug, Clone, Default)]
pub struct Gate(Arc<(Mutex<bool>, Condvar)>);

impl Gate {
    pub fn open(&self) {
        *self.0.0.lock().expect("unpoisoned") = true;
        self.0.1.notify_all();
    }

    pub fn pass(&self) {
        let open = self.0.0.lock().expect("unpoisoned");
        let _open = self.0.1.wait_timeout_while(open, 2 * PATIENCE, |open| !*open).expect("unpoisoned");
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.ask_to_stop();
    }
}

/// A cpu device that looks at each mesh before it opens it.
pub struct Around {
    cpu: CpuDevice,
    pub info: DeviceInfo,
    before: Box<Before>,
    /// Makes a device for meshes beside, if it takes several.
    pub another: Option<Box<dyn Fn() -> Box<dyn Device> + Send>>,
}

/// Called with a mesh, and whether its clusters are to be merged.
type Before = dyn Fn(&DualGraph, bool) -> tesserae_mesh::Result<()> + Send;

impl Around {
    pub fn new(before: impl Fn(&DualGraph, bool) -> tesserae_mesh::Result<()> + Send + 'static) -> Self {
        let cpu = CpuDevice::new();
        Self { info: cpu.info().clone(), cpu, before: Box::new(before), another: None }
    }
}

impl Device for Around {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn another(&self) -> Option<Box<dyn Device>> {
        self.another.as_ref().map(|another| another())
    }

    fn open<'a>(
        &'a mut self,
        graph: &'a DualGraph,
        components: &'a [u32],
    ) -> tesserae_mesh::Result<Box<dyn Steps + 'a>> {
        (self.before)(graph, false)?;
        self.cpu.open(graph, components)
    }

    fn open_merging<'a>(
        &'a mut self,
        graph: &'a DualGraph,
        components: &'a [u32],
    ) -> tesserae_mesh::Result<Box<dyn MergeSteps + 'a>> {
        (self.before)(graph, true)?;
        self.cpu.open_merging(graph, components)
    }
}

/// A cpu device that lets nothing through before its gate opens, and that panics at meshes of exactly 66 faces.
pub struct Held;

/// Faces of the mesh that [`Held`] panics at: a [`strip`](Sample::Strip), which has exactly the requested number.
pub const PANIC_FACES: usize = 66;

impl Held {
    pub fn behind_gate() -> (Box<dyn Device>, Gate) {
        let gate = Gate::default();
        let held = gate.clone();
        let before = move |graph: &DualGraph, _| {
            held.pass();
            assert!(graph.faces() != PANIC_FACES, "a defect on purpose");
            Ok(())
        };
        (Box::new(Around::new(before)), gate)
    }
}

/// What was logged.
#[derive(Clone)]
pub struct Log {
    bytes: Arc<Mutex<Vec<u8>>>,
    _second: tracing::Dispatch,
}

impl Default for Log {
    /// With a single subscriber, tracing leaves a log line to the thread that meets it first: another test's.
    fn default() -> Self {
        Self { bytes: Arc::default(), _second: tracing::Dispatch::new(tracing_subscriber::registry()) }
    }
}

impl Log {
    pub fn text(&self) -> String {
        String::from_utf8(self.bytes.lock().expect("unpoisoned").clone()).expect("text")
    }

    /// The lines of a target, where each is a JSON object.
    pub fn lines(&self, target: &str) -> Vec<Value> {
        let text = self.text();
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
        lines.filter(|line| line["target"] == target).collect()
    }
}

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        Write::write(&mut *self.bytes.lock().expect("unpoisoned"), bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl MakeWriter<'_> for Log {
    type Writer = Self;

    fn make_writer(&self) -> Self {
        self.clone()
    }
}
