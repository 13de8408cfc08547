//! The settings of the service: each defined once, here, with its flag, variable, meaning and default.

mod access;
pub mod heading;
pub(crate) mod logging;
mod storage;
mod traffic;
mod webhooks;
mod work;

use std::net::SocketAddr;
use std::path::PathBuf;

use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::mesh::Limits;

pub use self::access::AccessSettings;
pub use self::storage::StorageSettings;
pub(crate) use self::traffic::BEGINNINGS;
pub use self::traffic::{TrafficConstants, TrafficSettings};
pub use self::webhooks::{WebhookHost, WebhookSettings};
pub use self::work::{Switch, WorkSettings};
use crate::files::check_prefixes;

/// Settings of `tesserae serve`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct Settings {
    /// Address and port to listen on; port 0 takes any free one
    #[arg(long, env = "TESSERAE_LISTEN", value_name = "ADDRESS:PORT", help_heading = heading::PLACES,
          default_value_t = Settings::default().listen)]
    pub listen: SocketAddr,

    /// Folder for jobs, uploads and results, which outlast the service there; a temporary one when left out
    #[arg(long, env = "TESSERAE_DATA_DIR", value_name = "DIR", help_heading = heading::PLACES)]
    pub data_dir: Option<PathBuf>,

    /// Access.
    #[command(flatten)]
    pub access: AccessSettings,

    /// Largest upload, in bytes, all its parts together
    #[arg(long, env = "TESSERAE_MAX_UPLOAD_BYTES", value_name = "BYTES", help_heading = heading::LIMITS,
          default_value_t = Settings::default().max_upload_bytes, value_parser = clap::value_parser!(u64).range(1..))]
    pub max_upload_bytes: u64,

    /// Largest number of faces of a mesh
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", hide_short_help = true, help_heading = heading::LIMITS,
          default_value_t = Settings::default().max_faces, value_parser = clap::value_parser!(u64).range(1..))]
    pub max_faces: u64,

    /// Jobs that may wait; more are answered with 429
    #[arg(long, env = "TESSERAE_MAX_QUEUED_JOBS", value_name = "N",
          hide_short_help = true, help_heading = heading::LIMITS,
          default_value_t = Settings::default().max_queued_jobs,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    pub max_queued_jobs: usize,

    /// Jobs that are worked on at a time: some are read and some written while the device works on others, as memory
    /// allows
    #[arg(long, env = "TESSERAE_MESHES_IN_MEMORY", value_name = "N",
          hide_short_help = true, help_heading = heading::WORK,
          default_value_t = Settings::default().meshes_in_memory,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=1024))]
    pub meshes_in_memory: usize,

    /// Time that running jobs get to finish when the service is asked to stop, in seconds
    #[arg(long, env = "TESSERAE_GRACE_PERIOD", value_name = "SECONDS",
          hide_short_help = true, help_heading = heading::STOP,
          default_value_t = Settings::default().grace_period,
          value_parser = clap::value_parser!(u64).range(0..=86_400))]
    pub grace_period: u64,

    /// Time between the failure of /readyz and the refusal of jobs when the service is asked to stop, so that load
    /// balancers notice, in seconds
    #[arg(long, env = "TESSERAE_DRAIN_DELAY", value_name = "SECONDS", help_heading = heading::STOP,
          hide_short_help = true, default_value_t = Settings::default().drain_delay,
          value_parser = clap::value_parser!(u64).range(0..=3600))]
    pub drain_delay: u64,

    /// What is kept.
    #[command(flatten)]
    pub storage: StorageSettings,

    /// What a job may cost.
    #[command(flatten)]
    pub work: WorkSettings,

    /// Limits of traffic.
    #[command(flatten)]
    pub traffic: TrafficSettings,

    /// Webhooks.
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
            max_queued_jobs: 1024,
            meshes_in_memory: 8,
            grace_period: 10,
            drain_delay: 0,
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
                "without tokens the service listens to this machine only, because any client that reaches it could \
                 read and delete every job: make a token (`tesserae token new NAME --tokens FILE`) and give --tokens \
                 FILE, or say --insecure-no-auth, to listen on {}",
                self.listen
            )));
        }
        if self.storage.store.is_some() && self.storage.blobs.is_none() {
            return Err(Error::parameter(
                "services that share a --store must share the files of its jobs: give --blobs beside it",
            ));
        }
        let has_store = self.data_dir.is_some() || self.storage.store.is_some();
        if let Some(blobs) = self.storage.blobs.as_ref().filter(|_| !has_store) {
            return Err(Error::parameter(format_args!(
                "a service that forgets its jobs when it ends would leave their files at {blobs}: give --data-dir \
                 beside --blobs, or --store, for the store of jobs"
            )));
        }
        self.storage.check_store()?;
        check_prefixes(&self.storage.mesh_prefixes, self.storage.blobs.as_ref())?;
        if self.work.work == Switch::Off && self.storage.store.is_none() {
            return Err(Error::parameter(
                "with --work off nothing works on the jobs: give --store, which others share",
            ));
        }
        if !self.webhooks.webhook_hosts.is_empty() && self.webhooks.webhook_secret.is_none() {
            return Err(Error::parameter(
                "webhooks must be signed: give a file with the secret, --webhook-secret FILE, beside --webhook-hosts",
            ));
        }
        Ok(())
    }

    /// Seconds between a request to stop and the end of the process, at the most.
    pub fn seconds_to_stop(&self) -> u64 {
        self.drain_delay + self.grace_period + 10
    }

    pub(crate) fn limits(&self) -> Limits {
        Limits { max_bytes: self.max_upload_bytes, max_faces: self.max_faces, ..Limits::default() }
    }
}

#[cfg(test)]
mod tests {
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
}
