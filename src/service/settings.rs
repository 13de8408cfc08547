//! The settings of the service: each defined once, here, with its flag, variable, meaning and default.

pub(crate) mod logging;
mod traffic;

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use reqwest::Url;
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::mesh::Limits;

pub(crate) use self::traffic::BEGINNINGS;
pub use self::traffic::{TrafficConstants, TrafficSettings};
use crate::blobs::place::BlobPlace;
use crate::files::check_prefixes;
use crate::store::StoreUrl;

/// Settings of `tesserae serve`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct Settings {
    /// Address and port to listen on; port 0 takes any free one
    #[arg(long, env = "TESSERAE_LISTEN", value_name = "ADDRESS:PORT", help_heading = "Places",
          default_value_t = Self::default().listen)]
    pub listen: SocketAddr,

    /// Folder for jobs, uploads and results, which outlast the service there; a temporary one when left out
    #[arg(long, env = "TESSERAE_DATA_DIR", value_name = "DIR", help_heading = "Places")]
    pub data_dir: Option<PathBuf>,

    /// Access.
    #[command(flatten)]
    pub access: AccessSettings,

    /// Largest upload, in bytes, all its parts together
    #[arg(long, env = "TESSERAE_MAX_UPLOAD_BYTES", value_name = "BYTES", help_heading = "Limits",
          default_value_t = Self::default().max_upload_bytes, value_parser = clap::value_parser!(u64).range(1..))]
    pub max_upload_bytes: u64,

    /// Largest number of faces of a mesh
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", hide_short_help = true, help_heading = "Limits",
          default_value_t = Self::default().max_faces, value_parser = clap::value_parser!(u64).range(1..))]
    pub max_faces: u64,

    /// Jobs that may wait; more are answered with 429
    #[arg(long, env = "TESSERAE_MAX_QUEUED_JOBS", value_name = "N", hide_short_help = true, help_heading = "Limits",
          default_value_t = Self::default().max_queued_jobs,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    pub max_queued_jobs: usize,

    /// Jobs that are worked on at a time: some are read and some written while the device works on others, as memory
    /// allows
    #[arg(long, env = "TESSERAE_MESHES_IN_MEMORY", value_name = "N", hide_short_help = true, help_heading = "Work",
          default_value_t = Self::default().meshes_in_memory,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=1024))]
    pub meshes_in_memory: usize,

    /// Time that running jobs get to finish when the service is asked to stop, in seconds
    #[arg(long, env = "TESSERAE_GRACE_PERIOD", value_name = "SECONDS", hide_short_help = true, help_heading = "Stop",
          default_value_t = Self::default().grace_period, value_parser = clap::value_parser!(u64).range(0..=86_400))]
    pub grace_period: u64,

    /// Time between the failure of /readyz and the refusal of jobs when the service is asked to stop, so that load
    /// balancers notice, in seconds
    #[arg(long, env = "TESSERAE_DRAIN_DELAY", value_name = "SECONDS", help_heading = "Stop", hide_short_help = true,
          default_value_t = Self::default().drain_delay, value_parser = clap::value_parser!(u64).range(0..=3600))]
    pub drain_delay: u64,

    /// Places.
    #[command(flatten)]
    pub storage: StorageSettings,

    /// Work.
    #[command(flatten)]
    pub work: WorkSettings,

    /// Traffic.
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
        #[cfg(feature = "postgres")]
        if let Some(url) = &self.storage.store {
            crate::store::address::parse(url)?;
        }
        #[cfg(not(feature = "postgres"))]
        if self.storage.store.is_some() {
            return Err(Error::parameter("this build has no --store: build tesserae with the cargo feature postgres"));
        }
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

/// Settings of access.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
#[command(next_help_heading = "Access")]
pub struct AccessSettings {
    /// File of tokens, as `tesserae token new` makes it; read again when it changes. When left out, no request needs a
    /// token
    #[arg(long, env = "TESSERAE_TOKENS", value_name = "FILE")]
    pub tokens: Option<PathBuf>,

    /// Listen to other machines without tokens, and answer for any name (Host): every client that reaches the service
    /// can read and delete every job
    #[arg(long, env = "TESSERAE_INSECURE_NO_AUTH")]
    pub insecure_no_auth: bool,
}

/// Whether a service works on jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Switch {
    /// Jobs are worked on here
    On,
    /// Other services work on them
    Off,
}

/// Limits of work on jobs.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
#[command(next_help_heading = "Work")]
pub struct WorkSettings {
    /// Whether this service works on jobs: with off it only answers, and others that share its --store work
    #[arg(long, env = "TESSERAE_WORK", value_name = "on|off", value_enum, hide_short_help = true,
          default_value_t = Self::default().work)]
    pub work: Switch,

    /// Time that a job may take on the device and until its results are made, in seconds; 0 for any
    #[arg(long, env = "TESSERAE_MAX_JOB_SECONDS", value_name = "SECONDS", hide_short_help = true,
          default_value_t = Self::default().max_job_seconds)]
    pub max_job_seconds: u64,

    /// Counted attempts after which a job has failed: two may be lost by chance. Tests that kill the process change it
    #[arg(long, hide = true, default_value_t = Self::default().max_attempts,
          value_parser = clap::value_parser!(u32).range(1..))]
    pub max_attempts: u32,

    /// Seconds that a job pauses after a crash: a supervisor starts the service again within them. Tests that kill the
    /// process change it
    #[arg(long, hide = true, default_value_t = Self::default().crash_pause,
          value_parser = clap::value_parser!(u64).range(0..=600))]
    pub crash_pause: u64,

    /// Bytes that all meshes in memory take at most; three quarters of the container's or machine's if none. For tests.
    #[arg(skip)]
    pub memory_budget: Option<u64>,

    /// Time after which a device that shows no sign of life counts as lost: longer than the longest step of a mesh of
    /// 50,000,000 faces. Tests change it.
    #[arg(skip = Self::default().device_timeout)]
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

/// Places of jobs and files, and how long they stay.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
#[command(next_help_heading = "Places")]
pub struct StorageSettings {
    /// Database that keeps the jobs of several services together, postgres://USER:PASSWORD@HOST/DATABASE; in the data
    /// folder when left out. Connections to other machines are encrypted, and the server is verified, unless the URL
    /// says ?sslmode=disable
    #[arg(long, env = "TESSERAE_STORE", value_name = "URL", hide_env_values = true, hide_short_help = true)]
    pub store: Option<StoreUrl>,

    /// Where uploads and results lie that are too large for the store of jobs: a folder, or s3://BUCKET/PREFIX with
    /// keys, region and endpoint in the usual variables AWS_…; in the data folder when left out
    #[arg(long, env = "TESSERAE_BLOBS", value_name = "PLACE", hide_short_help = true)]
    pub blobs: Option<BlobPlace>,

    /// Where jobs may name meshes that lie in a bucket (mesh_url): s3://BUCKET/PREFIX, with the keys of --blobs.
    /// {tenant} in it stands for the name of the tenant. Nowhere when left out
    #[arg(long, env = "TESSERAE_MESH_PREFIXES", value_name = "URL,…", value_delimiter = ',', hide_short_help = true)]
    pub mesh_prefixes: Vec<BlobPlace>,

    /// Time for which a job that has ended is kept with its results, in seconds; 0 until it is deleted
    #[arg(long, env = "TESSERAE_RETENTION", value_name = "SECONDS", help_heading = "Room",
          default_value_t = Self::default().retention)]
    pub retention: u64,

    /// Free bytes of the disk of the data folder that no upload takes, so that accepted jobs can end: at least 8 MiB.
    /// The default is enough for 1024 small jobs
    #[arg(long, env = "TESSERAE_MIN_FREE_BYTES", value_name = "BYTES", hide_short_help = true, help_heading = "Room",
          default_value_t = Self::default().min_free_bytes)]
    pub min_free_bytes: u64,
}

impl Default for StorageSettings {
    fn default() -> Self {
        Self { store: None, blobs: None, mesh_prefixes: Vec::new(), retention: 7 * 86_400, min_free_bytes: 256 << 20 }
    }
}

impl StorageSettings {
    /// [`retention`](Self::retention) as a duration; none for ever.
    pub(crate) fn retention(&self) -> Option<Duration> {
        (self.retention > 0).then(|| Duration::from_secs(self.retention))
    }
}

/// Settings of webhooks.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
#[command(next_help_heading = "Webhooks")]
pub struct WebhookSettings {
    /// Hosts that webhooks may go to: HOST or HOST:PORT by https, with http:// before it in the clear; a name that
    /// leads to a private address needs that address listed too. None when left out
    #[arg(long, env = "TESSERAE_WEBHOOK_HOSTS", value_name = "HOST,…", value_delimiter = ',', hide_short_help = true)]
    pub webhook_hosts: Vec<WebhookHost>,

    /// File with the secret that webhooks are signed with: `whsec_` and 24 to 64 bytes in base64
    #[arg(long, env = "TESSERAE_WEBHOOK_SECRET", value_name = "FILE", hide_short_help = true)]
    pub webhook_secret: Option<PathBuf>,
}

/// A host that webhooks may go to: `HOST[:PORT]` by https, `http://HOST[:PORT]` without encryption.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct WebhookHost {
    /// `https` or `http`.
    pub(crate) scheme: &'static str,
    /// A name or an address.
    pub(crate) host: String,
    pub(crate) port: u16,
}

impl FromStr for WebhookHost {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::parameter(format_args!(
                "a host for webhooks is HOST, HOST:PORT, http://HOST or http://HOST:PORT, not {text:?}"
            ))
        };
        let url = if text.contains("://") { text.to_owned() } else { format!("https://{text}") };
        let url = Url::parse(&url).map_err(|_| wrong())?;
        let is_bare = matches!(url.path(), "" | "/") && url.query().is_none() && url.fragment().is_none();
        Self::of(&url).filter(|_| is_bare && !text.ends_with('/')).ok_or_else(wrong)
    }
}

impl WebhookHost {
    /// The host of a URL without a name and a password.
    pub(crate) fn of(url: &Url) -> Option<Self> {
        let scheme = ["https", "http"].into_iter().find(|scheme| *scheme == url.scheme())?;
        let is_anonymous = url.username().is_empty() && url.password().is_none();
        let host = url.host_str().filter(|_| is_anonymous)?.to_owned();
        Some(Self { scheme, host, port: url.port_or_known_default()? })
    }

    /// The address that stands in place of a name.
    pub(crate) fn address(&self) -> Option<IpAddr> {
        self.host.trim_start_matches('[').trim_end_matches(']').parse().ok()
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
