//! Limits of traffic.

use std::net::IpAddr;
use std::time::Duration;

use ipnet::IpNet;
use tesserae_mesh::error::{Error, Result};

/// Connections at a time that have not begun, or wait for a place. More stay with the system.
pub(crate) const BEGINNINGS: usize = 256;

/// Settings of traffic. A client is a tenant, or an address where there are no tokens.
#[derive(Debug, Clone, PartialEq, clap::Args)]
#[command(next_help_heading = "Limits")]
pub struct TrafficSettings {
    /// Jobs of one tenant that may wait, where there are tokens; more are answered with 429
    #[arg(long, env = "TESSERAE_MAX_QUEUED_JOBS_PER_TENANT", value_name = "N", hide_short_help = true,
          default_value_t = Self::default().max_queued_jobs_per_tenant,
          value_parser = clap::value_parser!(u64).range(1..))]
    pub max_queued_jobs_per_tenant: u64,

    /// Addresses of proxies, such as 10.0.0.0/8, whose X-Forwarded-For says where requests come from; without any the
    /// other end of a connection is the client
    #[arg(long, env = "TESSERAE_TRUSTED_PROXIES", value_name = "NETWORK,…", value_delimiter = ',',
          value_parser = network, help_heading = "Access", hide_short_help = true)]
    pub trusted_proxies: Vec<IpNet>,

    /// What is the same in every service.
    #[arg(skip)]
    pub constants: TrafficConstants,
}

impl Default for TrafficSettings {
    fn default() -> Self {
        Self { max_queued_jobs_per_tenant: 256, trusted_proxies: Vec::new(), constants: TrafficConstants::default() }
    }
}

/// Reads a network, or the address of one proxy.
fn network(text: &str) -> Result<IpNet, String> {
    let found = text.parse().ok().or_else(|| text.parse::<IpAddr>().ok().map(IpNet::from));
    found.ok_or_else(|| format!("a network is an address, or an address, / and the bits of its prefix, not {text:?}"))
}

/// Limits that no flag changes. Tests lower them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrafficConstants {
    /// Requests of one client at a time, event streams aside: ten times what a browser opens. Quotas have another.
    pub requests_at_once: u32,
    /// Event streams of one client at a time: as many as jobs may wait by default. Quotas have another.
    pub streams_per_client: u32,
    /// Event streams at a time: some 17 KiB of memory each.
    pub streams: u32,
    /// Connections at a time: an eighth of the open files that the process requests.
    pub connections: u32,
    /// Connections from one address at a time: one client leaves room for three others.
    pub connections_per_address: u32,
    /// Time for the head of a request, on a connection that is new or used before: it fits into few packets.
    pub header_timeout: Duration,
    /// Time without a byte of an upload: TCP repeats a lost packet several times within it.
    pub body_timeout: Duration,
    /// Time in which a client must take something of an answer: a page in the background may read late.
    pub write_timeout: Duration,
}

impl Default for TrafficConstants {
    fn default() -> Self {
        Self {
            requests_at_once: 64,
            streams_per_client: 1024,
            streams: 4096,
            connections: 8192,
            connections_per_address: 2048,
            header_timeout: Duration::from_secs(15),
            body_timeout: Duration::from_secs(30),
            write_timeout: Duration::from_secs(60),
        }
    }
}

impl TrafficConstants {
    /// Lowers [`connections`](Self::connections) to what a process may have that may open so many files, and
    /// says so: jobs could not read and write theirs otherwise. Refuses when there is room for none.
    pub fn fit(&mut self, files: u64) -> Result<()> {
        // files of the store, of jobs, of the device, and of connections that have not begun
        let others = 256 + BEGINNINGS as u64;
        // a connection has two: its socket, and one that it sends or receives
        let most = u32::try_from(files.saturating_sub(others) / 2).unwrap_or(u32::MAX);
        if most == 0 {
            return Err(Error::parameter(format_args!(
                "this process may open too few files for a service (ulimit -n, LimitNOFILE of systemd): allow it 4096 \
                 or more; it is {files}"
            )));
        }
        if most < self.connections {
            tracing::warn!(files, "connections at a time are at most {most}: this process may open so few files");
            self.connections = most;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_proxy_is_a_network_or_an_address() {
        for (text, is_one) in [("10.0.0.0/8", true), ("fd00::1", true), ("10.0.0.0/33", false), ("proxy", false)] {
            assert_eq!(network(text).is_ok(), is_one, "{text}");
        }
        assert_eq!(network("10.0.0.1"), network("10.0.0.1/32"));
    }
}
