//! Numbers for a dashboard: counted as things happen, written when Prometheus reads `/metrics`.
//!
//! [`families`] defines all metrics. Labels have few values: routes are templates, never paths; no job, address
//! or tenant is a label. `deploy/grafana.json` draws these; a test compares the names.

mod families;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use parking_lot::Mutex;
use prometheus_client::encoding::text::encode;
use prometheus_client::registry::Registry;
use tesserae_mesh::device::MemoryMeter;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::report::{DeviceInfo, DeviceKind, Report};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

use self::families::{Families, Process};
use crate::files::Files;
use crate::ops::health::{Health, Part, Severity};
use crate::ops::proc_bytes;
use crate::settings::Settings;
use crate::store::{Job, State, Store};

/// Media type of [`Metrics::text`]: OpenMetrics, which Prometheus reads.
pub(crate) const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Time between two looks at [`Families::request_lag`].
const LOOK_AT_LAG: Duration = Duration::from_millis(250);

pub(crate) struct Metrics {
    registry: Registry,
    pub families: Families,
    process: Process,
    /// Of the device that was opened last.
    pub memory_meter: Mutex<Option<MemoryMeter>>,
}

impl Metrics {
    pub fn new(device: &DeviceInfo, settings: &Settings) -> Self {
        let mut registry = Registry::default();
        let families = Families::register(registry.sub_registry_with_prefix("tesserae"));
        let process = Process::register(registry.sub_registry_with_prefix("process"));
        process.started.set(SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64());
        families.build.get_or_create(&[("version", env!("CARGO_PKG_VERSION"))]).set(1);
        let kind = match device.kind {
            DeviceKind::Cpu => "cpu",
            DeviceKind::Gpu => "gpu",
        };
        let labels = [("kind", kind.to_owned()), ("name", device.name.clone()), ("backend", device.backend.clone())];
        families.device.get_or_create(&labels).set(1);
        families.disk_reserve.set(i64::try_from(settings.storage.min_free_bytes).unwrap_or(i64::MAX));
        families.queue_limit.set(i64::try_from(settings.max_queued_jobs).unwrap_or(i64::MAX));
        // what never happened is 0, not absent
        for operation in ["create", "get", "claim", "append", "finish"] {
            families.store_errors.get_or_create(&[("operation", operation)]).inc_by(0);
        }
        for kind in [Kind::DeviceLost, Kind::Unavailable] {
            families.attempts_failed.get_or_create(&[("reason", kind.slug())]).inc_by(0);
            families.poison.get_or_create(&[("reason", kind.slug())]).inc_by(0);
        }
        for outcome in ["delivered", "failed", "given_up"] {
            families.webhooks.get_or_create(&[("outcome", outcome)]).inc_by(0);
        }
        Self { registry, families, process, memory_meter: Mutex::default() }
    }

    pub fn claimed(&self, job: &Job) {
        let claimed = job.started_at.unwrap_or_else(SystemTime::now);
        let waited = claimed.duration_since(job.created_at).unwrap_or_default();
        self.families.queue_wait.observe(waited.as_secs_f64());
    }

    /// An attempt at a job failed in a way that another may not.
    pub fn attempt_failed(&self, kind: Kind) {
        self.families.attempts_failed.get_or_create(&[("reason", kind.slug())]).inc();
        if kind == Kind::DeviceLost {
            self.families.device_lost.inc();
        }
    }

    pub fn ended(&self, job: &Job, state: State, elapsed: Duration) {
        let labels = [("algorithm", job.spec.parameters.algorithm.name()), ("state", state.name())];
        self.families.job_seconds.get_or_create(&labels).observe(elapsed.as_secs_f64());
    }

    pub fn written(&self, job: &Job, elapsed: Duration) {
        let labels = [("algorithm", job.spec.parameters.algorithm.name()), ("stage", "write")];
        self.families.stage_seconds.get_or_create(&labels).observe(elapsed.as_secs_f64());
    }

    /// What a job did that has a result, which is not written yet.
    pub fn reported(&self, report: &Report) {
        let algorithm = report.parameters.algorithm.name();
        let timings = &report.timings_ms;
        for (stage, milliseconds) in [
            ("read", timings.read),
            ("parse", timings.parse),
            ("topology", timings.topology),
            ("upload", timings.upload),
            ("cluster", timings.cluster),
            ("download", timings.download),
        ] {
            let labels = [("algorithm", algorithm), ("stage", stage)];
            self.families.stage_seconds.get_or_create(&labels).observe(milliseconds / 1000.0);
        }
        let label = [("algorithm", algorithm)];
        let steps = report.iterations.last().map_or(0, |row| row.iteration);
        let rounds = report.levels.last().map_or(0, |row| row.round);
        self.families.iterations.get_or_create(&label).inc_by(u64::from(steps) + u64::from(rounds));
        self.families.faces.get_or_create(&label).inc_by(report.input.items());
    }

    pub fn answered(&self, method: &axum::http::Method, route: &str, status: u16, elapsed: Duration) {
        let known = ["GET", "HEAD", "POST", "DELETE", "OPTIONS"].contains(&method.as_str());
        let method = if known { method.as_str() } else { "other" };
        let route = ("route", route.to_owned());
        let labels = [("method", method.to_owned()), route.clone(), ("status", status.to_string())];
        self.families.answers.get_or_create(&labels).inc();
        self.families.answer_seconds.get_or_create(&[route]).observe(elapsed.as_secs_f64());
    }

    /// The store took so long for an operation; `failed` when that was its fault.
    pub fn stored(&self, operation: &'static str, elapsed: Duration, failed: bool) {
        let label = [("operation", operation)];
        self.families.store_seconds.get_or_create(&label).observe(elapsed.as_secs_f64());
        if failed {
            self.families.store_errors.get_or_create(&label).inc();
        }
    }

    /// Measures how late the threads that answer requests begin what is due, on the runtime of this task, until
    /// `close`: much later only while all of them are busy or blocked.
    pub async fn watch_lag(self: Arc<Self>, close: CancellationToken) {
        let mut due = Instant::now() + LOOK_AT_LAG;
        while close.run_until_cancelled(sleep_until(due)).await.is_some() {
            self.families.request_lag.observe(due.elapsed().as_secs_f64());
            due = Instant::now() + LOOK_AT_LAG;
        }
    }

    /// All metrics, after those are set that others count.
    pub async fn text(&self, store: &Store, files: &Files, health: &Health) -> Result<String> {
        let families = &self.families;
        let (jobs, oldest) = (store.counts().await?, store.oldest_queued().await?);
        for (state, count) in State::ALL.into_iter().zip(jobs) {
            families.jobs.get_or_create(&[("state", state.name())]).set(count.cast_signed());
        }
        let of_store = store.statistics();
        families.store_commits.inner().store(of_store.commits, Ordering::Relaxed);
        families.store_commands.inner().store(of_store.commands, Ordering::Relaxed);
        families.store_failed_commits.inner().store(of_store.failures, Ordering::Relaxed);
        families.results_damaged.inner().store(files.damages.load(Ordering::Relaxed), Ordering::Relaxed);
        families.file_errors.inner().store(files.failures.load(Ordering::Relaxed), Ordering::Relaxed);
        families.store_commit_seconds.inner().store(of_store.commit_seconds.to_bits(), Ordering::Relaxed);
        // only the store ends attempts for this reason
        let unavailable = [("reason", Kind::Unavailable.slug())];
        let attempts_failed = families.attempts_failed.get_or_create(&unavailable);
        attempts_failed.inner().store(of_store.attempts_failed, Ordering::Relaxed);
        families.poison.get_or_create(&unavailable).inner().store(of_store.given_up, Ordering::Relaxed);
        families.ready.set(i64::from(health.why_not_ready().is_none()));
        for part in Part::ALL {
            let now = health.severity(part);
            for (severity, name) in [(Severity::Degraded, "degraded"), (Severity::Failing, "failing")] {
                let labels = [("part", part.name()), ("severity", name)];
                families.conditions.get_or_create(&labels).set(i64::from(now == Some(severity)));
            }
        }
        families.stuck_jobs.set(files.stuck.load(Ordering::Relaxed).cast_signed());
        families.unknown_jobs.set(files.unknown.load(Ordering::Relaxed).cast_signed());
        if let Some(free) = files.free_bytes() {
            families.disk_free.set(free.cast_signed());
        }
        let age = oldest.and_then(|oldest| oldest.elapsed().ok()).unwrap_or_default();
        families.queue_oldest.set(age.as_secs_f64());
        let meter = self.memory_meter.lock().clone();
        families.device_memory.set(meter.and_then(|meter| meter()).unwrap_or(0).cast_signed());
        self.measure_process();
        let mut text = String::new();
        let encoded = encode(&mut text, &self.registry);
        encoded.map_err(|error| Error::new(Kind::Internal, format_args!("metrics cannot be written: {error}")))?;
        Ok(text)
    }

    fn measure_process(&self) {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        let seconds = time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9;
        self.process.cpu_seconds.inner().store(seconds.to_bits(), Ordering::Relaxed);
        // the folder that is read is one of them
        let open = std::fs::read_dir("/proc/self/fd").map_or(0, |entries| entries.count().saturating_sub(1));
        self.process.open_fds.set(open as i64);
        if let Ok((limit, _)) = rlimit::Resource::NOFILE.get() {
            self.process.max_fds.set(i64::try_from(limit).unwrap_or(i64::MAX));
        }
        if let Some(bytes) = proc_bytes("/proc/self/status", "VmRSS:") {
            self.process.resident.set(bytes.cast_signed());
        }
    }
}
