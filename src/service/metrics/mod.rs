//! Numbers for a dashboard: counted as things happen, written for Prometheus when it asks.
//!
//! Labels have few values: routes are templates, never paths; no job or address is a label, and only so many tenants
//! are. `deploy/grafana.json` draws these; a test compares the names.

mod busy;
mod limits;
mod process;
mod tenants;
pub(super) mod timed_store;

use std::borrow::Cow;
use std::fmt;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::{encode_eof, encode_registry};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::{Family, MetricConstructor};
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

use self::busy::Busy;
use self::limits::Limits;
pub(super) use self::limits::Room;
use self::process::Process;
use self::tenants::{Seconds, Tenants};
use super::health::{Health, Part, Severity};
use super::logging;
use super::settings::Settings;
use super::store::{Job, State, Statistics};
use crate::device::MemoryMeter;
use crate::error::{Error, Kind, Result};
use crate::report::{DeviceInfo, DeviceKind, Report};

type Histograms<L> = Family<L, Histogram, Buckets>;

/// Media type of [`Metrics::text`]: OpenMetrics, which Prometheus reads.
pub(super) const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Upper ends of the buckets for what takes milliseconds: requests, the store.
const SHORT: [f64; 11] = [0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.5, 2.5, 10.0];
/// Upper ends of the buckets for what takes seconds: jobs, and waiting for them.
const LONG: [f64; 12] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3600.0];

/// How much a new job counts in the average duration of jobs.
const NEWEST: f64 = 0.2;

/// One label: its name is in the type, because there are few of them.
macro_rules! labels {
    ($($(#[$doc:meta])* $name:ident { $($label:ident: $kind:ty),+ })+) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
        struct $name { $($label: $kind),+ }
    )+};
}

labels! {
    /// A state of jobs.
    ByState { state: &'static str }
    /// An algorithm and how its job ended.
    ByEnd { algorithm: &'static str, state: &'static str }
    /// An algorithm and a stage of its work.
    ByStage { algorithm: &'static str, stage: &'static str }
    /// An algorithm.
    ByAlgorithm { algorithm: &'static str }
    /// A request: its method, the template of its route, the status of its answer.
    ByAnswer { method: &'static str, route: Cow<'static, str>, status: u16 }
    /// The template of a route.
    ByRoute { route: Cow<'static, str> }
    /// A method of the store.
    ByOperation { operation: &'static str }
    /// Why a request was refused.
    ByReason { reason: &'static str }
    /// A part of the service and how bad it is.
    ByPart { part: &'static str, severity: &'static str }
    /// What came of telling the end of a job.
    ByOutcome { outcome: &'static str }
    /// The device.
    DeviceLabels { kind: &'static str, name: String, backend: String }
    /// The release.
    BuildLabels { version: &'static str }
}

/// Makes histograms with given buckets.
#[derive(Debug, Clone)]
struct Buckets(&'static [f64]);

impl MetricConstructor<Histogram> for Buckets {
    fn new_metric(&self) -> Histogram {
        Histogram::new(self.0.iter().copied())
    }
}

/// What is counted.
#[derive(Debug)]
pub(super) struct Metrics {
    registry: Registry,
    process: Process,
    limits: Limits,
    tenants: Tenants,
    attempts_failed: Family<ByReason, Counter>,
    poison: Family<ByReason, Counter>,
    spans_lost: Counter,
    jobs: Family<ByState, Gauge>,
    queue_wait: Histogram,
    job_seconds: Histograms<ByEnd>,
    stage_seconds: Histograms<ByStage>,
    iterations: Family<ByAlgorithm, Counter>,
    faces: Family<ByAlgorithm, Counter>,
    device_busy: Seconds,
    device_works: Busy,
    device_lost: Counter,
    answers: Family<ByAnswer, Counter>,
    answer_seconds: Histograms<ByRoute>,
    store_seconds: Histograms<ByOperation>,
    store_errors: Family<ByOperation, Counter>,
    store_commits: Counter,
    store_commands: Counter,
    store_failed_commits: Counter,
    store_commit_seconds: Seconds,
    rejections: Family<ByReason, Counter>,
    connections: Gauge,
    connections_refused: Counter,
    streams: Gauge,
    upload_bytes_in_flight: Gauge,
    upload_bytes: Counter,
    ready: Gauge,
    conditions: Family<ByPart, Gauge>,
    webhooks: Family<ByOutcome, Counter>,
    webhooks_pending: Gauge,
    resident: Gauge,
    device_memory: Gauge,
    memory_meter: Mutex<Option<Meter>>,
    disk_used: Gauge,
    /// Average seconds between claim and end of a job; none before the first.
    pace: Mutex<Option<f64>>,
}

/// What is measured when somebody looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Snapshot {
    /// Jobs in each state, in the order of [`State::ALL`].
    pub jobs: [u64; State::ALL.len()],
    /// Open event streams.
    pub streams: u64,
    /// Bytes of uploads that are coming in.
    pub upload_bytes_in_flight: u64,
    /// What the store counted.
    pub store: Statistics,
    /// Bytes in the data folder.
    pub disk_used: u64,
    /// What is left.
    pub room: Room,
}

/// A [`MemoryMeter`] that can be printed.
struct Meter(MemoryMeter);

impl fmt::Debug for Meter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Meter")
    }
}

impl Metrics {
    /// Nothing counted yet, on that device.
    pub fn new(device: &DeviceInfo) -> Self {
        let mut registry = Registry::with_prefix("tesserae");
        let (limits, tenants) = (Limits::register(&mut registry), Tenants::register(&mut registry));
        let registry_ = &mut registry;
        macro_rules! register {
            ($name:literal, $help:literal, $metric:expr) => {{
                let metric = $metric;
                registry_.register($name, $help, metric.clone());
                metric
            }};
            ($name:literal, $help:literal, $unit:expr, $metric:expr) => {{
                let metric = $metric;
                registry_.register_with_unit($name, $help, $unit, metric.clone());
                metric
            }};
        }
        let short = || Buckets(&SHORT);
        let long = || Buckets(&LONG);
        let build = register!("build_info", "The release that runs", Family::<BuildLabels, Gauge>::default());
        build.get_or_create(&BuildLabels { version: env!("CARGO_PKG_VERSION") }).set(1);
        let info = register!("device_info", "What clusters here", Family::<DeviceLabels, Gauge>::default());
        let kind = match device.kind {
            DeviceKind::Cpu => "cpu",
            DeviceKind::Gpu => "gpu",
        };
        let labels = DeviceLabels { kind, name: device.name.clone(), backend: device.backend.clone() };
        info.get_or_create(&labels).set(1);
        let metrics = Self {
            process: Process::new(),
            limits,
            tenants,
            attempts_failed: register!(
                "attempts_failed",
                "Attempts at a job that failed in a way that another may not, by kind of problem",
                Family::default()
            ),
            poison: register!(
                "poison",
                "Jobs that were given up after as many attempts as may be made, by the kind of the last problem",
                Family::default()
            ),
            spans_lost: register!("spans_lost", "Spans that the collector did not take", Counter::default()),
            jobs: register!("jobs", "Jobs that the service knows, by state", Family::default()),
            queue_wait: register!(
                "queue_wait",
                "Time between acceptance and claim of a job",
                Unit::Seconds,
                long().new_metric()
            ),
            job_seconds: register!(
                "job",
                "Time between claim and end of a job",
                Unit::Seconds,
                Family::new_with_constructor(long())
            ),
            stage_seconds: register!(
                "job_stage",
                "Time in a stage of a job that succeeded",
                Unit::Seconds,
                Family::new_with_constructor(long())
            ),
            iterations: register!("iterations", "Iterations and rounds made by jobs that succeeded", Family::default()),
            faces: register!("faces", "Faces of jobs that succeeded", Family::default()),
            device_busy: register!(
                "device_busy",
                "Time in which the device worked on a job, or several at once; its rate is the busy share",
                Unit::Seconds,
                Seconds::default()
            ),
            device_works: Busy::default(),
            device_lost: register!(
                "device_lost",
                "Attempts at a job that ended because the device was lost",
                Counter::default()
            ),
            answers: register!("http_requests", "Requests answered, by route template", Family::default()),
            answer_seconds: register!(
                "http_request",
                "Time until the head of an answer",
                Unit::Seconds,
                Family::new_with_constructor(short())
            ),
            store_seconds: register!(
                "store",
                "Time that the store took for an operation",
                Unit::Seconds,
                Family::new_with_constructor(short())
            ),
            store_errors: register!(
                "store_errors",
                "Operations of the store that failed for its own reasons",
                Family::default()
            ),
            store_commits: register!("store_commits", "Transactions that the store committed", Counter::default()),
            store_commands: register!("store_commands", "Changes in committed transactions", Counter::default()),
            store_failed_commits: register!(
                "store_failed_commits",
                "Transactions of the store that failed",
                Counter::default()
            ),
            store_commit_seconds: register!(
                "store_commit",
                "Time that the store spent in transactions",
                Unit::Seconds,
                Seconds::default()
            ),
            rejections: register!(
                "rejections",
                "Requests answered with an error, by kind of problem",
                Family::default()
            ),
            connections: register!("connections", "Open connections", Gauge::default()),
            connections_refused: register!(
                "connections_refused",
                "Connections closed because their address had too many",
                Counter::default()
            ),
            streams: register!("event_streams", "Open event streams", Gauge::default()),
            upload_bytes_in_flight: register!(
                "upload_in_flight",
                "Bytes of uploads that are coming in",
                Unit::Bytes,
                Gauge::default()
            ),
            upload_bytes: register!("upload", "Bytes of meshes of accepted jobs", Unit::Bytes, Counter::default()),
            ready: register!("ready", "1 when jobs are taken", Gauge::default()),
            conditions: register!("condition", "1 for each part that is degraded or failing", Family::default()),
            webhooks: register!(
                "webhooks",
                "Attempts to tell the end of a job, by what came of them",
                Family::default()
            ),
            webhooks_pending: register!("webhooks_pending", "Ends of jobs that are still to be told", Gauge::default()),
            resident: register!(
                "resident_memory",
                "Memory of the process that is in use",
                Unit::Bytes,
                Gauge::default()
            ),
            device_memory: register!(
                "device_memory",
                "Memory of its own that the device has allocated; 0 where it has none, as on the cpu",
                Unit::Bytes,
                Gauge::default()
            ),
            memory_meter: Mutex::default(),
            disk_used: register!(
                "disk_used",
                "Bytes of uploads, results and the store of jobs in the data folder",
                Unit::Bytes,
                Gauge::default()
            ),
            pace: Mutex::default(),
            registry,
        };
        // what never happened is 0, not absent
        for operation in ["create", "get", "claim", "append", "finish"] {
            metrics.store_errors.get_or_create(&ByOperation { operation }).inc_by(0);
        }
        for kind in [Kind::DeviceLost, Kind::Unavailable] {
            metrics.attempts_failed.get_or_create(&ByReason { reason: kind.slug() }).inc_by(0);
            metrics.poison.get_or_create(&ByReason { reason: kind.slug() }).inc_by(0);
        }
        for outcome in ["delivered", "failed", "given_up"] {
            metrics.webhooks.get_or_create(&ByOutcome { outcome }).inc_by(0);
        }
        metrics
    }

    /// What the settings allow.
    pub fn limits(&self, settings: &Settings) {
        self.limits.set(settings);
    }

    /// A job was given up after its last attempt failed.
    pub fn poisoned(&self, kind: Kind) {
        self.poison.get_or_create(&ByReason { reason: kind.slug() }).inc();
    }

    /// A request of `tenant` was answered.
    pub fn answered_to(&self, tenant: Option<&str>, status: u16) {
        if let Some(tenant) = tenant {
            self.tenants.answered(tenant, status >= 400);
        }
    }

    /// A job was accepted.
    pub fn accepted(&self, job: &Job) {
        self.tenants.accepted(&job.spec.tenant);
        self.upload_bytes.inc_by(job.spec.bytes);
    }

    /// A job was claimed.
    pub fn claimed(&self, job: &Job) {
        let claimed = job.started_at.unwrap_or_else(SystemTime::now);
        let waited = claimed.duration_since(job.created_at).unwrap_or_default();
        self.queue_wait.observe(waited.as_secs_f64());
        self.tenants.claimed(&job.spec.tenant, waited);
    }

    /// An attempt at a job failed in a way that another may not.
    pub fn attempt_failed(&self, kind: Kind) {
        self.attempts_failed.get_or_create(&ByReason { reason: kind.slug() }).inc();
        if kind == Kind::DeviceLost {
            self.device_lost.inc();
        }
    }

    /// A job ended in `state`, so long after its claim.
    pub fn ended(&self, job: &Job, state: State, elapsed: Duration, error: Option<Kind>) {
        let algorithm = job.spec.parameters.algorithm.name();
        let seconds = elapsed.as_secs_f64();
        self.tenants.ended(&job.spec.tenant, state.name(), elapsed);
        self.job_seconds.get_or_create(&ByEnd { algorithm, state: state.name() }).observe(seconds);
        if error == Some(Kind::DeviceLost) {
            self.device_lost.inc();
        }
        let mut pace = self.pace.lock().unwrap_or_else(PoisonError::into_inner);
        *pace = Some(pace.map_or(seconds, |average| average + NEWEST * (seconds - average)));
    }

    /// The result of a job was written.
    pub fn written(&self, job: &Job, elapsed: Duration) {
        let label = ByStage { algorithm: job.spec.parameters.algorithm.name(), stage: "write" };
        self.stage_seconds.get_or_create(&label).observe(elapsed.as_secs_f64());
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
            self.stage_seconds.get_or_create(&ByStage { algorithm, stage }).observe(milliseconds / 1000.0);
        }
        let label = ByAlgorithm { algorithm };
        let steps = report.iterations.last().map_or(0, |row| row.iteration);
        let rounds = report.levels.last().map_or(0, |row| row.round);
        self.iterations.get_or_create(&label).inc_by(u64::from(steps) + u64::from(rounds));
        self.faces.get_or_create(&label).inc_by(report.input.faces);
    }

    /// A device was opened, which tells of its memory so.
    pub fn device_opened(&self, memory: MemoryMeter) {
        *self.memory_meter.lock().unwrap_or_else(PoisonError::into_inner) = Some(Meter(memory));
    }

    fn device_memory(&self) -> Option<u64> {
        let meter = self.memory_meter.lock().unwrap_or_else(PoisonError::into_inner).as_ref()?.0.clone();
        meter()
    }

    /// The device works on a job until what this gives is dropped.
    pub fn device_works(&self) -> busy::Working<'_> {
        self.device_works.begin()
    }

    /// A request was answered.
    pub fn answered(&self, method: &axum::http::Method, route: &str, status: u16, elapsed: Duration) {
        let method = match method.as_str() {
            "GET" => "GET",
            "HEAD" => "HEAD",
            "POST" => "POST",
            "DELETE" => "DELETE",
            "OPTIONS" => "OPTIONS",
            _ => "other",
        };
        let route: Cow<'static, str> = route.to_owned().into();
        self.answers.get_or_create(&ByAnswer { method, route: route.clone(), status }).inc();
        self.answer_seconds.get_or_create(&ByRoute { route }).observe(elapsed.as_secs_f64());
    }

    /// A request was answered with an error.
    pub fn rejected(&self, kind: Kind) {
        self.rejections.get_or_create(&ByReason { reason: kind.slug() }).inc();
    }

    /// The store took so long for an operation; `failed` when that was its fault.
    pub fn stored(&self, operation: &'static str, elapsed: Duration, failed: bool) {
        let label = ByOperation { operation };
        self.store_seconds.get_or_create(&label).observe(elapsed.as_secs_f64());
        if failed {
            self.store_errors.get_or_create(&label).inc();
        }
    }

    /// The end of a job was told, or not.
    pub fn told(&self, outcome: &'static str) {
        self.webhooks.get_or_create(&ByOutcome { outcome }).inc();
    }

    /// So many ends are still to be told.
    pub fn webhooks_pending(&self, count: usize) {
        self.webhooks_pending.set(count as i64);
    }

    /// So many more connections are open.
    pub fn connections(&self, more: i64) {
        self.connections.inc_by(more);
    }

    /// A connection was closed because its address had too many.
    pub fn connection_refused(&self) {
        self.connections_refused.inc();
    }

    /// Seconds after which the last of `queued` jobs will have begun, as far as the past tells.
    pub fn seconds_to_empty(&self, queued: u64) -> Option<u32> {
        let pace = (*self.pace.lock().unwrap_or_else(PoisonError::into_inner))?;
        Some((pace * queued as f64).ceil().clamp(1.0, 300.0) as u32)
    }

    /// All metrics as text.
    pub fn text(&self, now: Snapshot, health: &Health) -> Result<String> {
        for (state, count) in State::ALL.into_iter().zip(now.jobs) {
            self.jobs.get_or_create(&ByState { state: state.name() }).set(count.cast_signed());
        }
        self.device_busy.inner().store(self.device_works.seconds().to_bits(), Ordering::Relaxed);
        self.streams.set(now.streams.cast_signed());
        self.upload_bytes_in_flight.set(now.upload_bytes_in_flight.cast_signed());
        self.store_commits.inner().store(now.store.commits, Ordering::Relaxed);
        self.store_commands.inner().store(now.store.commands, Ordering::Relaxed);
        self.store_failed_commits.inner().store(now.store.failures, Ordering::Relaxed);
        self.store_commit_seconds.inner().store(now.store.commit_seconds.to_bits(), Ordering::Relaxed);
        // only the store ends attempts for this reason
        let unavailable = ByReason { reason: Kind::Unavailable.slug() };
        let attempts_failed = self.attempts_failed.get_or_create(&unavailable);
        attempts_failed.inner().store(now.store.attempts_failed, Ordering::Relaxed);
        self.poison.get_or_create(&unavailable).inner().store(now.store.given_up, Ordering::Relaxed);
        self.ready.set(i64::from(health.why_not_ready().is_none()));
        for part in Part::ALL {
            let now = health.severity(part);
            for (severity, name) in [(Severity::Degraded, "degraded"), (Severity::Failing, "failing")] {
                let label = ByPart { part: part.name(), severity: name };
                self.conditions.get_or_create(&label).set(i64::from(now == Some(severity)));
            }
        }
        self.disk_used.set(now.disk_used.cast_signed());
        self.limits.measured(now.room);
        self.spans_lost.inner().store(logging::lost_spans(), Ordering::Relaxed);
        self.device_memory.set(self.device_memory().unwrap_or(0).cast_signed());
        if let Some(bytes) = process::resident_bytes() {
            self.resident.set(bytes);
        }
        let mut text = String::new();
        encode_registry(&mut text, &self.registry)
            .and_then(|()| encode_registry(&mut text, self.process.measured()))
            .and_then(|()| encode_eof(&mut text))
            .map_err(|error| Error::new(Kind::Internal, format_args!("metrics cannot be written: {error}")))?;
        Ok(text)
    }
}
