//! Numbers for a dashboard: counted as things happen, written when Prometheus reads `/metrics`.
//!
//! [`Families`] and [`Process`] define all metrics. Labels have few values: routes are templates, never paths; no job,
//! address or tenant is a label. `deploy/grafana.json` draws these; a test compares the names.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use parking_lot::Mutex;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};
use tesserae_mesh::device::MemoryMeter;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::report::{DeviceInfo, Report};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

use crate::files::Files;
use crate::ops::health::{Health, Part, Severity, why_not_ready};
use crate::ops::proc_bytes;
use crate::settings::Settings;
use crate::store::{Job, State, Store};

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
        let labels = [
            ("kind", device.kind.name().to_owned()),
            ("name", device.name.clone()),
            ("backend", device.backend.clone()),
        ];
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
        loop {
            let due = Instant::now() + Duration::from_millis(250);
            if close.run_until_cancelled(sleep_until(due)).await.is_none() {
                return;
            }
            self.families.request_lag.observe(due.elapsed().as_secs_f64());
        }
    }

    /// All metrics as OpenMetrics, which Prometheus reads, after those are set that others count.
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
        families.attempts_failed.get_or_create(&unavailable).inner().store(of_store.attempts_failed, Ordering::Relaxed);
        families.poison.get_or_create(&unavailable).inner().store(of_store.given_up, Ordering::Relaxed);
        families.ready.set(i64::from(why_not_ready(&health.conditions()).is_none()));
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
        encoded.map_err(|error| Error::internal(format_args!("metrics cannot be written: {error}")))?;
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

/// For what takes milliseconds: requests, the store.
fn short() -> Histogram {
    Histogram::new([0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.5, 2.5, 10.0])
}

/// For what takes seconds: jobs, and waiting for them.
fn long() -> Histogram {
    Histogram::new([0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3600.0])
}

/// Names and values of labels.
pub(crate) type By<const N: usize> = [(&'static str, &'static str); N];
pub(crate) type ByText<const N: usize> = [(&'static str, String); N];

type Histograms<L> = Family<L, Histogram, fn() -> Histogram>;

/// A sum of times, in seconds.
pub(crate) type Seconds = Counter<f64, AtomicU64>;

/// Defines metrics that are registered together: field, type, value if not the default, name, unit if any, description.
macro_rules! metrics {
    ($(#[$doc:meta])* $group:ident {
        $($field:ident: $type:ty $(= $new:expr)?, $name:literal $([$unit:ident])?, $help:literal;)+
    }) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub(crate) struct $group { $(pub(crate) $field: $type),+ }

        impl $group {
            pub(crate) fn register(registry: &mut Registry) -> Self {
                Self { $($field: {
                    let metric: $type = metrics!(@new $($new)?);
                    metrics!(@register registry, metric, $name, $help $(, Unit::$unit)?);
                    metric
                }),+ }
            }
        }
    };
    (@new) => { Default::default() };
    (@new $new:expr) => { $new };
    (@register $registry:ident, $metric:ident, $name:literal, $help:literal) => {
        $registry.register($name, $help, $metric.clone())
    };
    (@register $registry:ident, $metric:ident, $name:literal, $help:literal, $unit:expr) => {
        $registry.register_with_unit($name, $help, $unit, $metric.clone())
    };
}

metrics! {
    Families {
        build: Family<By<1>, Gauge>, "build_info", "The release that runs";
        device: Family<ByText<3>, Gauge>, "device_info", "The device that clusters here";
        attempts_failed: Family<By<1>, Counter>, "attempts_failed",
            "Attempts at a job that failed in a way that another may not, by kind of problem";
        poison: Family<By<1>, Counter>, "poison",
            "Jobs that were given up after as many attempts as may be made, by the kind of the last problem";
        jobs: Family<By<1>, Gauge>, "jobs", "Jobs that the service knows, by state";
        queue_wait: Histogram = long(), "queue_wait" [Seconds], "Time between acceptance and claim of a job";
        job_seconds: Histograms<By<2>> = Family::new_with_constructor(long), "job" [Seconds],
            "Time between claim and end of a job";
        stage_seconds: Histograms<By<2>> = Family::new_with_constructor(long), "job_stage" [Seconds],
            "Time in a stage of a job that succeeded";
        iterations: Family<By<1>, Counter>, "iterations", "Iterations and rounds made by jobs that succeeded";
        faces: Family<By<1>, Counter>, "faces", "Faces of jobs that succeeded";
        device_busy: Seconds, "device_busy" [Seconds],
            "Time for which the device worked on jobs that it is done with; several at once count each";
        device_lost: Counter, "device_lost", "Attempts at a job that ended because the device was lost";
        device_wrong: Counter, "device_wrong",
            "Jobs that the cpu ran again, because what the device gave contradicted itself";
        answers: Family<ByText<3>, Counter>, "http_requests", "Requests answered, by route template";
        answer_seconds: Histograms<ByText<1>> = Family::new_with_constructor(short), "http_request" [Seconds],
            "Time until the head of an answer";
        store_seconds: Histograms<By<1>> = Family::new_with_constructor(short), "store" [Seconds],
            "Time that the store took for an operation";
        store_errors: Family<By<1>, Counter>, "store_errors", "Operations of the store that failed for its own reasons";
        store_commits: Counter, "store_commits", "Transactions that the store committed";
        store_commands: Counter, "store_commands", "Changes in committed transactions";
        store_failed_commits: Counter, "store_failed_commits", "Transactions of the store that failed";
        file_errors: Counter, "file_errors", "Files that could not be written or read for reasons of their place";
        stuck_jobs: Gauge, "stuck_jobs", "Jobs that repeat what they cannot read or write in their files";
        unknown_jobs: Gauge, "unknown_jobs",
            "Folders of jobs that the store does not know, as of the last sweep; at a shared place those of a day ago";
        results_damaged: Counter, "results_damaged", "Stored results that were not what was stored when they were read";
        request_lag: Histogram = short(), "request_thread_lag" [Seconds],
            "How late the threads that answer requests began what was due, looked at four times a second";
        store_commit_seconds: Seconds, "store_commit" [Seconds], "Time that the store spent in transactions";
        rejections: Family<By<1>, Counter>, "rejections", "Requests answered with an error, by kind of problem";
        connections: Gauge, "connections", "Open connections";
        connections_refused: Counter, "connections_refused", "Connections closed because their address had too many";
        streams: Gauge, "event_streams", "Open event streams";
        upload_bytes: Counter, "upload" [Bytes], "Bytes of meshes of accepted jobs";
        ready: Gauge, "ready", "1 when jobs are taken";
        conditions: Family<By<2>, Gauge>, "condition", "1 for each part that is degraded or failing";
        webhooks: Family<By<1>, Counter>, "webhooks", "Attempts to tell the end of a job, by what came of them";
        webhooks_pending: Gauge, "webhooks_pending", "Ends of jobs that are still to be told";
        device_memory: Gauge, "device_memory" [Bytes],
            "Memory of its own that the device has allocated; 0 where it has none, as on the cpu";
        disk_free: Gauge, "disk_free" [Bytes], "Bytes that may still be written to the file system of the data folder";
        disk_reserve: Gauge, "disk_reserve" [Bytes], "Free bytes below which uploads are refused";
        queue_limit: Gauge, "queue_limit", "Jobs that may wait";
        queue_oldest: Gauge<f64, AtomicU64>, "queue_oldest" [Seconds],
            "Age of the job that waits longest; 0 when none waits";
    }
}

metrics! {
    /// Numbers of the process, `process_…`, as every Prometheus client gives them; 0 where the system does not say.
    Process {
        started: Gauge<f64, AtomicU64>, "start_time_seconds", "When the service started, in seconds since 1970";
        cpu_seconds: Seconds, "cpu_seconds", "Processor time of the process";
        open_fds: Gauge, "open_fds", "Open file descriptors";
        max_fds: Gauge, "max_fds", "File descriptors that may be open";
        resident: Gauge, "resident_memory_bytes", "Memory that is in use";
    }
}
