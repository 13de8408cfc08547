//! The settings of the service: each defined once, here, with its flag, variable, meaning and default.

mod access;
mod storage;
mod traffic;
mod webhooks;
mod work;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

pub use self::access::AccessSettings;
pub use self::storage::StorageSettings;
pub use self::traffic::TrafficSettings;
pub use self::webhooks::WebhookSettings;
pub use self::work::WorkSettings;
use crate::error::{Error, Result};
use crate::mesh::Limits;

/// Settings of `tesserae serve`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct Settings {
    /// Address and port to listen on; port 0 takes any free one
    #[arg(long, env = "TESSERAE_LISTEN", value_name = "ADDRESS:PORT", default_value_t = Settings::default().listen)]
    pub listen: SocketAddr,

    /// Folder for jobs, uploads and results, which outlast the service there; a temporary one when left out, and jobs in
    /// memory only
    #[arg(long, env = "TESSERAE_DATA_DIR", value_name = "DIR")]
    pub data_dir: Option<PathBuf>,

    /// Largest upload, in bytes, all its parts together
    #[arg(long, env = "TESSERAE_MAX_UPLOAD_BYTES", value_name = "BYTES", default_value_t = Settings::default().max_upload_bytes)]
    pub max_upload_bytes: u64,

    /// Largest number of faces of a mesh
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", default_value_t = Settings::default().max_faces)]
    pub max_faces: u64,

    /// Largest number of faces of a mesh for each of its bytes, beyond the first 524,288: instances and nodes can place
    /// a mesh many times in few bytes
    #[arg(
        long,
        env = "TESSERAE_MAX_FACES_PER_BYTE",
        value_name = "N",
        default_value_t = Settings::default().max_faces_per_byte
    )]
    pub max_faces_per_byte: u64,

    /// Jobs that may wait; more are answered with 429
    #[arg(long, env = "TESSERAE_MAX_QUEUED_JOBS", value_name = "N", default_value_t = Settings::default().max_queued_jobs)]
    pub max_queued_jobs: usize,

    /// Jobs that are worked on at a time: some are read and some written while the device works on others, as memory allows
    #[arg(long, env = "TESSERAE_MESHES_IN_MEMORY", value_name = "N", default_value_t = Settings::default().meshes_in_memory,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=1024))]
    pub meshes_in_memory: usize,

    /// Longest time that `Prefer: wait` can ask for, in seconds
    #[arg(long, env = "TESSERAE_MAX_WAIT", value_name = "SECONDS", default_value_t = Settings::default().max_wait,
          value_parser = clap::value_parser!(u64).range(0..=86_400))]
    pub max_wait: u64,

    /// Time between the comments that keep a quiet event stream open, in seconds
    #[arg(long, env = "TESSERAE_KEEP_ALIVE", value_name = "SECONDS", default_value_t = Settings::default().keep_alive,
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub keep_alive: u64,

    /// Time that running jobs get to finish when the service is asked to stop, in seconds
    #[arg(long, env = "TESSERAE_GRACE_PERIOD", value_name = "SECONDS", default_value_t = Settings::default().grace_period,
          value_parser = clap::value_parser!(u64).range(0..=86_400))]
    pub grace_period: u64,

    /// What is kept.
    #[command(flatten)]
    pub storage: StorageSettings,

    /// What a job may cost.
    #[command(flatten)]
    pub work: WorkSettings,

    /// Who may use the service.
    #[command(flatten)]
    pub access: AccessSettings,

    /// How much clients may ask for at a time.
    #[command(flatten)]
    pub traffic: TrafficSettings,

    /// Where ends of jobs may be told.
    #[command(flatten)]
    pub webhooks: WebhookSettings,
}

impl Default for Settings {
    fn default() -> Self {
        let limits = Limits::default();
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 8080)),
            data_dir: None,
            max_upload_bytes: limits.max_bytes,
            max_faces: limits.max_faces,
            max_faces_per_byte: limits.max_faces_per_byte.unwrap_or(u64::MAX),
            max_queued_jobs: 1024,
            meshes_in_memory: 8,
            max_wait: 60,
            keep_alive: 15,
            grace_period: 10,
            storage: StorageSettings::default(),
            work: WorkSettings::default(),
            access: AccessSettings::default(),
            traffic: TrafficSettings::default(),
            webhooks: WebhookSettings::default(),
        }
    }
}

impl Settings {
    /// Checks what the settings say together.
    pub fn check(&self) -> Result<()> {
        let is_open = self.access.tokens.is_none() && !self.access.insecure_no_auth;
        if is_open && !self.listen.ip().to_canonical().is_loopback() {
            return Err(Error::parameter(format_args!(
                "without tokens the service listens to this machine only, because whoever reaches it may read and delete \
                 every job: make a token (`tesserae token new NAME --tokens FILE`) and give --tokens FILE, or say \
                 --insecure-no-auth, to listen on {}",
                self.listen
            )));
        }
        if !self.webhooks.webhook_hosts.is_empty() && self.webhooks.webhook_secret.is_none() {
            return Err(Error::parameter(
                "webhooks must be signed: give a file with the secret, --webhook-secret FILE, beside --webhook-hosts",
            ));
        }
        Ok(())
    }

    /// What a mesh may cost.
    pub(super) fn limits(&self) -> Limits {
        Limits {
            max_bytes: self.max_upload_bytes,
            max_faces: self.max_faces,
            max_faces_per_byte: Some(self.max_faces_per_byte),
        }
    }

    /// [`max_wait`](Self::max_wait) as a duration.
    pub(super) fn max_wait(&self) -> Duration {
        Duration::from_secs(self.max_wait)
    }

    /// [`keep_alive`](Self::keep_alive) as a duration.
    pub(super) fn keep_alive(&self) -> Duration {
        Duration::from_secs(self.keep_alive)
    }

    /// [`grace_period`](Self::grace_period) as a duration.
    pub(super) fn grace_period(&self) -> Duration {
        Duration::from_secs(self.grace_period)
    }
}

#[cfg(test)]
mod tests {
    use clap::{Args, Command};

    use super::*;

    #[test]
    fn others_are_listened_to_with_tokens_or_on_demand_only() {
        let settings = |listen: &str| Settings { listen: listen.parse().expect("an address"), ..Settings::default() };
        for loopback in ["127.0.0.1:1", "127.9.9.9:1", "[::1]:1", "[::ffff:127.0.0.1]:1"] {
            assert_eq!(settings(loopback).check(), Ok(()), "{loopback}");
        }
        for other in ["0.0.0.0:1", "[::]:1", "10.0.0.1:1", "[::ffff:10.0.0.1]:1"] {
            let mut settings = settings(other);
            let error = settings.check().expect_err(other);
            assert!(error.message.contains("--insecure-no-auth") && error.message.ends_with(other), "{error}");
            settings.access.insecure_no_auth = true;
            assert_eq!(settings.check(), Ok(()));
            settings.access = AccessSettings { tokens: Some("tokens.json".into()), ..AccessSettings::default() };
            assert_eq!(settings.check(), Ok(()));
        }
    }

    #[test]
    fn every_setting_is_a_flag_a_variable_and_explained() {
        let command = Settings::augment_args(Command::new("test"));
        for argument in command.get_arguments() {
            let name = argument.get_id().as_str();
            let flag = argument.get_long().expect("a flag");
            assert_eq!(flag, name.replace('_', "-"));
            let variable = argument.get_env().expect("a variable");
            assert_eq!(variable.to_str(), Some(format!("TESSERAE_{}", name.to_uppercase()).as_str()));
            assert!(argument.get_help().is_some(), "{name} is not explained");
        }
    }
}
