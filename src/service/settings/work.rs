//! Settings of what a job may cost.

use std::time::Duration;

/// What a job may cost.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct WorkSettings {
    /// Attempts at a job that the service or its device did not survive; after the last one the job has failed
    #[arg(long, env = "TESSERAE_MAX_ATTEMPTS", value_name = "N", default_value_t = WorkSettings::default().max_attempts,
          value_parser = clap::value_parser!(u32).range(1..))]
    pub max_attempts: u32,

    /// Time that a job may take on the device and until its results are made, in seconds; 0 for any
    #[arg(long, env = "TESSERAE_MAX_JOB_SECONDS", value_name = "SECONDS", default_value_t = WorkSettings::default().max_job_seconds)]
    pub max_job_seconds: u64,

    /// Bytes that all meshes in memory may take together, as estimated from their files and faces; others wait. Three
    /// quarters of the memory of the machine or container when left out
    #[arg(long, env = "TESSERAE_MEMORY_BUDGET", value_name = "BYTES")]
    pub memory_budget: Option<u64>,

    /// Time after which a device that shows no sign of life counts as lost, in seconds
    #[arg(long, env = "TESSERAE_DEVICE_TIMEOUT", value_name = "SECONDS", default_value_t = WorkSettings::default().device_timeout,
          value_parser = clap::value_parser!(u64).range(1..))]
    pub device_timeout: u64,
}

impl Default for WorkSettings {
    fn default() -> Self {
        Self { max_attempts: 3, max_job_seconds: 3600, memory_budget: None, device_timeout: 180 }
    }
}

impl WorkSettings {
    /// [`max_job_seconds`](Self::max_job_seconds) as a duration; none for any.
    pub(in crate::service) fn max_job(&self) -> Option<Duration> {
        (self.max_job_seconds > 0).then(|| Duration::from_secs(self.max_job_seconds))
    }

    /// [`device_timeout`](Self::device_timeout) as a duration.
    pub(in crate::service) fn device_timeout(&self) -> Duration {
        Duration::from_secs(self.device_timeout)
    }
}
