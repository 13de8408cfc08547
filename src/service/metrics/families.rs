//! All metrics of the service, each defined once.

use std::sync::atomic::AtomicU64;

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

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

/// Defines metrics that are registered together: field, type, how it is made unless by default, name, unit if it has
/// one, and description.
macro_rules! metrics {
    ($(#[$doc:meta])* $group:ident {
        $($field:ident: $type:ty $(= $new:expr)?, $name:literal $([$unit:ident])?, $help:literal;)+
    }) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub(crate) struct $group { $(pub(crate) $field: $type),+ }

        impl $group {
            /// Registers all of them.
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
    /// What is counted and measured.
    Families {
        build: Family<By<1>, Gauge>, "build_info", "The release that runs";
        device: Family<ByText<3>, Gauge>, "device_info", "The device that clusters here";
        attempts_failed: Family<By<1>, Counter>, "attempts_failed",
            "Attempts at a job that failed in a way that another may not, by kind of problem";
        poison: Family<By<1>, Counter>, "poison",
            "Jobs that were given up after as many attempts as may be made, by the kind of the last problem";
        jobs: Family<By<1>, Gauge>, "jobs", "Jobs that the service knows, by state";
        queue_wait: Histogram = long(), "queue_wait" [Seconds],
            "Time between acceptance and claim of a job";
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
        store_errors: Family<By<1>, Counter>, "store_errors",
            "Operations of the store that failed for its own reasons";
        store_commits: Counter, "store_commits", "Transactions that the store committed";
        store_commands: Counter, "store_commands", "Changes in committed transactions";
        store_failed_commits: Counter, "store_failed_commits", "Transactions of the store that failed";
        file_errors: Counter, "file_errors", "Files that could not be written or read for reasons of their place";
        stuck_jobs: Gauge, "stuck_jobs", "Jobs that repeat what they cannot read or write in their files";
        unknown_jobs: Gauge, "unknown_jobs",
            "Folders in the data folder of jobs that the store does not know, as of the last sweep";
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
        disk_free: Gauge, "disk_free" [Bytes],
            "Bytes that may still be written to the file system of the data folder";
        disk_reserve: Gauge, "disk_reserve" [Bytes], "Free bytes below which uploads are refused";
        queue_limit: Gauge, "queue_limit", "Jobs that may wait";
        queue_oldest: Gauge<f64, AtomicU64>, "queue_oldest" [Seconds],
            "Age of the job that waits longest; 0 when none waits";
    }
}

metrics! {
    /// Numbers of the process, `process_…`, as every Prometheus client library gives them; 0 where the system does not
    /// say.
    Process {
        started: Gauge<f64, AtomicU64>, "start_time_seconds", "When the service started, in seconds since 1970";
        cpu_seconds: Seconds, "cpu_seconds", "Processor time of the process";
        open_fds: Gauge, "open_fds", "Open file descriptors";
        max_fds: Gauge, "max_fds", "File descriptors that may be open";
        resident: Gauge, "resident_memory_bytes", "Memory that is in use";
    }
}
