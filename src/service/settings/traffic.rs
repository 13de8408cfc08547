//! Limits of traffic.

use crate::error::{Error, Result};
use crate::service::Network;

/// Connections at a time that have not begun, or wait for a place. More stay with the system.
pub(in crate::service) const BEGINNINGS: usize = 256;

/// Files that are open beside those of connections that have a place: of the store, of jobs, of the device.
const OTHER_FILES: u64 = 256 + BEGINNINGS as u64;

/// Files of a connection that has a place: its socket, and one that it sends or receives.
const FILES_OF_CONNECTION: u64 = 2;

/// Settings of traffic. A client is a tenant, or an address where there are no tokens.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct TrafficSettings {
    /// Jobs of one tenant that may wait; more are answered with 429
    #[arg(long, env = "TESSERAE_MAX_QUEUED_JOBS_PER_TENANT", value_name = "N",
          default_value_t = Self::default().max_queued_jobs_per_tenant)]
    pub max_queued_jobs_per_tenant: u64,

    /// Requests a second of one client, averaged over 5 seconds; more are answered with 429, 0 is any number
    #[arg(long, env = "TESSERAE_MAX_REQUEST_RATE", value_name = "N",
          default_value_t = Self::default().max_request_rate)]
    pub max_request_rate: u32,

    /// Requests of one client at a time, event streams aside; more are answered with 429
    #[arg(long, env = "TESSERAE_MAX_REQUESTS_AT_ONCE", value_name = "N",
          default_value_t = Self::default().max_requests_at_once)]
    pub max_requests_at_once: u32,

    /// Event streams of one client at a time; more are answered with 429
    #[arg(long, env = "TESSERAE_MAX_STREAMS_PER_CLIENT", value_name = "N",
          default_value_t = Self::default().max_streams_per_client)]
    pub max_streams_per_client: u32,

    /// Event streams at a time; more are answered with 503
    #[arg(long, env = "TESSERAE_MAX_STREAMS", value_name = "N", default_value_t = Self::default().max_streams)]
    pub max_streams: u32,

    /// Connections at a time; more wait to be accepted
    #[arg(long, env = "TESSERAE_MAX_CONNECTIONS", value_name = "N", default_value_t = Self::default().max_connections,
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub max_connections: u32,

    /// Connections from one address at a time; more are closed
    #[arg(long, env = "TESSERAE_MAX_CONNECTIONS_PER_ADDRESS", value_name = "N",
          default_value_t = Self::default().max_connections_per_address,
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub max_connections_per_address: u32,

    /// Connections that the system keeps before they are accepted; it may have a lower limit of its own
    #[arg(long, env = "TESSERAE_LISTEN_BACKLOG", value_name = "N", default_value_t = Self::default().listen_backlog,
          value_parser = clap::value_parser!(u32).range(1..=65_535))]
    pub listen_backlog: u32,

    /// Addresses of proxies, such as 10.0.0.0/8, whose X-Forwarded-For says where requests come from; without any the
    /// other end of a connection is the client
    #[arg(long, env = "TESSERAE_TRUSTED_PROXIES", value_name = "NETWORK,…", value_delimiter = ',')]
    pub trusted_proxies: Vec<Network>,

    /// Bytes of all uploads that are coming in at a time; more are answered with 503
    #[arg(long, env = "TESSERAE_MAX_BYTES_IN_FLIGHT", value_name = "BYTES",
          default_value_t = Self::default().max_bytes_in_flight)]
    pub max_bytes_in_flight: u64,

    /// How many times as large as its compressed form (gzip, zstd) an upload may be, after the first MiB
    #[arg(long, env = "TESSERAE_MAX_INFLATION", value_name = "N", default_value_t = Self::default().max_inflation,
          value_parser = clap::value_parser!(u64).range(1..))]
    pub max_inflation: u64,

    /// Time for the head of a request, on a connection that is new or used before, in seconds
    #[arg(long, env = "TESSERAE_HEADER_TIMEOUT", value_name = "SECONDS",
          default_value_t = Self::default().header_timeout,
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub header_timeout: u64,

    /// Time without a byte of an upload after which it is given up (408), in seconds
    #[arg(long, env = "TESSERAE_BODY_TIMEOUT", value_name = "SECONDS", default_value_t = Self::default().body_timeout,
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub body_timeout: u64,

    /// Bytes a second that an upload must bring on average, once it took longer than the body timeout
    #[arg(long, env = "TESSERAE_MIN_UPLOAD_RATE", value_name = "N", default_value_t = Self::default().min_upload_rate)]
    pub min_upload_rate: u64,

    /// Time in which a client must take something of an answer, in seconds
    #[arg(long, env = "TESSERAE_WRITE_TIMEOUT", value_name = "SECONDS", default_value_t = Self::default().write_timeout,
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub write_timeout: u64,
}

impl Default for TrafficSettings {
    fn default() -> Self {
        Self {
            max_queued_jobs_per_tenant: 256,
            max_request_rate: 200,
            max_requests_at_once: 64,
            max_streams_per_client: 1024,
            max_streams: 4096,
            max_connections: 8192,
            max_connections_per_address: 2048,
            listen_backlog: 1024,
            trusted_proxies: Vec::new(),
            max_bytes_in_flight: 16 << 30,
            max_inflation: 100,
            header_timeout: 15,
            body_timeout: 30,
            min_upload_rate: 1024,
            write_timeout: 60,
        }
    }
}

impl TrafficSettings {
    durations!(header_timeout, body_timeout, write_timeout);

    /// Lowers [`max_connections`](Self::max_connections) to what a process may have that may open so many files, and
    /// says so: jobs could not read and write theirs otherwise. Refuses when there is room for none.
    pub(crate) fn fit(&mut self, files: u64) -> Result<()> {
        let most = files.saturating_sub(OTHER_FILES) / FILES_OF_CONNECTION;
        match u32::try_from(most).unwrap_or(u32::MAX) {
            0 => Err(Error::parameter(format_args!(
                "this process may open too few files for a service (ulimit -n, LimitNOFILE of systemd): allow it 4096 \
                 or more; it is {files}"
            ))),
            most if most < self.max_connections => {
                tracing::warn!(files, "--max-connections is lowered to {most}: this process may open so few files");
                self.max_connections = most;
                Ok(())
            }
            _ => Ok(()),
        }
    }
}
