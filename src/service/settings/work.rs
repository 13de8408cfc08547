//! Settings of what a job may cost.

use std::time::Duration;

/// On or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Switch {
    /// It happens.
    On,
    /// It does not.
    Off,
}

/// What a job may cost.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct WorkSettings {
    /// Whether this service works on jobs: with off it only answers, and others that share its --store work
    #[arg(long, env = "TESSERAE_WORK", value_name = "on|off", value_enum,
          default_value_t = WorkSettings::default().work)]
    pub work: Switch,

    /// Time after which a job of a service that died or hangs is given to another one, in seconds; a living service
    /// prolongs it in time
    #[arg(long, env = "TESSERAE_LEASE", value_name = "SECONDS", default_value_t = WorkSettings::default().lease,
          value_parser = clap::value_parser!(u64).range(2..=3600))]
    pub lease: u64,

    /// Attempts at a job that the service or its device did not survive; after the last one the job has failed. An
    /// attempt counts once the mesh is being read, and a crash of the service counts for the job that ran alone
    #[arg(long, env = "TESSERAE_MAX_ATTEMPTS", value_name = "N", default_value_t = WorkSettings::default().max_attempts,
          value_parser = clap::value_parser!(u32).range(1..))]
    pub max_attempts: u32,

    /// Pause of a job that was worked on when the service crashed, in seconds; ten times as long after each further
    /// crash, up to 600
    #[arg(long, env = "TESSERAE_CRASH_PAUSE", value_name = "SECONDS",
          default_value_t = WorkSettings::default().crash_pause,
          value_parser = clap::value_parser!(u64).range(0..=600))]
    pub crash_pause: u64,

    /// Name of this process in the jobs that it works on; host name and process id when left out
    #[arg(long, env = "TESSERAE_WORKER_NAME", value_name = "NAME", value_parser = worker_name)]
    pub worker_name: Option<String>,

    /// Time that a job may take on the device and until its results are made, in seconds; 0 for any
    #[arg(long, env = "TESSERAE_MAX_JOB_SECONDS", value_name = "SECONDS",
          default_value_t = WorkSettings::default().max_job_seconds)]
    pub max_job_seconds: u64,

    /// Bytes that all meshes in memory may take together, as estimated from their files and faces; others wait. Three
    /// quarters of the memory of the machine or container when left out
    #[arg(long, env = "TESSERAE_MEMORY_BUDGET", value_name = "BYTES")]
    pub memory_budget: Option<u64>,

    /// Time after which a device that shows no sign of life counts as lost, in seconds
    #[arg(long, env = "TESSERAE_DEVICE_TIMEOUT", value_name = "SECONDS",
          default_value_t = WorkSettings::default().device_timeout,
          value_parser = clap::value_parser!(u64).range(1..))]
    pub device_timeout: u64,
}

impl Default for WorkSettings {
    fn default() -> Self {
        Self {
            work: Switch::On,
            lease: 30,
            max_attempts: 3,
            crash_pause: 5,
            worker_name: None,
            max_job_seconds: 3600,
            memory_budget: None,
            device_timeout: 180,
        }
    }
}

/// Longest name of a worker, in bytes.
const MAX_NAME: usize = 128;

/// The name of a worker, as it is written into jobs and logs.
fn worker_name(name: &str) -> Result<String, String> {
    match !name.is_empty() && name.len() <= MAX_NAME && name.chars().all(|c| c.is_ascii_graphic()) {
        true => Ok(name.to_owned()),
        false => Err(format!("must have 1 to {MAX_NAME} printable ASCII characters without spaces")),
    }
}

impl WorkSettings {
    durations!(lease, crash_pause, device_timeout);

    /// [`worker_name`](Self::worker_name), or host name and process id.
    pub(in crate::service) fn worker(&self) -> String {
        let host = || {
            let file = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
            let host = file.or_else(|| std::env::var("HOSTNAME").ok()).and_then(|host| worker_name(host.trim()).ok());
            format!("{}-{}", host.as_deref().unwrap_or("tesserae"), std::process::id())
        };
        self.worker_name.clone().unwrap_or_else(host)
    }

    /// [`max_job_seconds`](Self::max_job_seconds) as a duration; none for any.
    pub(in crate::service) fn max_job(&self) -> Option<Duration> {
        (self.max_job_seconds > 0).then(|| Duration::from_secs(self.max_job_seconds))
    }
}
