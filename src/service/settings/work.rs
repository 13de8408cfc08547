//! Settings of what a job may cost.

use std::time::Duration;

use super::heading;

/// Whether a service works on jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Switch {
    /// Jobs are worked on here
    On,
    /// Other services work on them
    Off,
}

/// What a job may cost.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct WorkSettings {
    /// Whether this service works on jobs: with off it only answers, and others that share its --store work
    #[arg(long, env = "TESSERAE_WORK", value_name = "on|off", value_enum, help_heading = heading::WORK,
          hide_short_help = true, default_value_t = WorkSettings::default().work)]
    pub work: Switch,

    /// Time that a job may take on the device and until its results are made, in seconds; 0 for any
    #[arg(long, env = "TESSERAE_MAX_JOB_SECONDS", value_name = "SECONDS",
          hide_short_help = true, help_heading = heading::WORK,
          default_value_t = WorkSettings::default().max_job_seconds)]
    pub max_job_seconds: u64,

    /// Counted attempts after which a job has failed: two may be lost by chance. Tests that kill the process change it
    #[arg(long, hide = true, default_value_t = WorkSettings::default().max_attempts,
          value_parser = clap::value_parser!(u32).range(1..))]
    pub max_attempts: u32,

    /// Seconds that a job pauses after a crash: a supervisor starts the service again within them. Tests that kill the
    /// process change it
    #[arg(long, hide = true, default_value_t = WorkSettings::default().crash_pause,
          value_parser = clap::value_parser!(u64).range(0..=600))]
    pub crash_pause: u64,

    /// Bytes that all meshes in memory may take together; three quarters of the memory of the container or machine when
    /// left out. Tests change it.
    #[arg(skip)]
    pub memory_budget: Option<u64>,

    /// Time after which a device that shows no sign of life counts as lost: longer than the longest step of a mesh of
    /// 50,000,000 faces. Tests change it.
    #[arg(skip = WorkSettings::default().device_timeout)]
    pub device_timeout: Duration,
}

impl Default for WorkSettings {
    fn default() -> Self {
        Self {
            work: Switch::On,
            max_job_seconds: 3600,
            max_attempts: 3,
            crash_pause: 5,
            memory_budget: None,
            device_timeout: Duration::from_secs(180),
        }
    }
}

impl WorkSettings {
    /// [`max_job_seconds`](Self::max_job_seconds) as a duration; none for any.
    pub(crate) fn max_job(&self) -> Option<Duration> {
        (self.max_job_seconds > 0).then(|| Duration::from_secs(self.max_job_seconds))
    }
}
