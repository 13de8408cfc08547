//! The address of the database: its URL with what this service reads of it beside the driver.
//!
//! TLS is on or off, and on means that the certificate of the server is verified: `sslmode=require` of other programs,
//! which takes any certificate, does not keep another server from answering. What the driver would take as well
//! (`prefer`) is refused. Without `sslmode` it is on, except for a server on this machine.

use std::path::PathBuf;
use std::time::Duration;

use percent_encoding::percent_decode_str;
use tesserae_mesh::error::{Error, Result};
use tokio_postgres::Config;
use tokio_postgres::config::{Host, SslMode};

use super::super::super::url::StoreUrl;

/// Time for a connection to be made.
const CONNECT: Duration = Duration::from_secs(5);

/// What a session begins with. Statements are short here: one that is not waits for something that does not come. Every
/// statement finds its rows by an index: the statistics of a queue are those of a moment that is over, and a plan by
/// them may read all jobs.
const SESSION: &str = "-c search_path=tesserae -c statement_timeout=20s -c lock_timeout=10s \
    -c idle_in_transaction_session_timeout=20s -c timezone=UTC -c synchronous_commit=on -c jit=off \
    -c plan_cache_mode=force_generic_plan -c enable_seqscan=off -c enable_bitmapscan=off -c enable_hashjoin=off \
    -c enable_mergejoin=off -c enable_material=off";

/// How to reach the database.
#[derive(Debug, Clone)]
pub struct Address {
    /// For the driver.
    pub config: Config,
    /// Whether connections are encrypted.
    pub is_encrypted: bool,
    /// A file with the certificates that servers are verified by; those of the system when none.
    pub authorities: Option<PathBuf>,
}

impl Address {
    /// Reads a URL. No error shows any of it, except for names of parameters.
    pub fn parse(url: &StoreUrl) -> Result<Self> {
        let text = url.expose();
        if !["postgres://", "postgresql://"].iter().any(|scheme| text.starts_with(scheme)) {
            return Err(Error::parameter(
                "--store must be postgres://USER:PASSWORD@HOST/DATABASE; leave it out to keep jobs in --data-dir",
            ));
        }
        let (place, parameters) = text.split_once('?').unwrap_or((text, ""));
        let (mut mode, mut authorities, mut others) = (None, None, Vec::new());
        for parameter in parameters.split('&').filter(|parameter| !parameter.is_empty()) {
            match parameter.split_once('=') {
                Some(("sslmode", value)) => mode = Some(value),
                Some(("sslrootcert", value)) => {
                    authorities = Some(PathBuf::from(percent_decode_str(value).decode_utf8_lossy().into_owned()));
                }
                _ => others.push(parameter),
            }
        }
        let separator = if others.is_empty() { "" } else { "?" };
        let mut config: Config = format!("{place}{separator}{}", others.join("&")).parse().map_err(|error| {
            let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}")).unwrap_or_default();
            Error::parameter(format_args!("--store is not a URL of a PostgreSQL database{cause}"))
        })?;
        let is_encrypted = match mode {
            None => !config.get_hosts().iter().all(is_local),
            Some("disable") => false,
            Some("require" | "verify-full") => true,
            Some(_) => {
                return Err(Error::parameter(
                    "sslmode in --store must be disable, require or verify-full; the last two both verify the server",
                ));
            }
        };
        let session = match config.get_options() {
            Some(options) => format!("{SESSION} {options}"),
            None => SESSION.to_owned(),
        };
        config.options(session).ssl_mode(if is_encrypted { SslMode::Require } else { SslMode::Disable });
        if config.get_application_name().is_none() {
            config.application_name("tesserae");
        }
        if config.get_connect_timeout().is_none() {
            config.connect_timeout(CONNECT);
        }
        config.keepalives_idle(Duration::from_secs(15)).tcp_user_timeout(Duration::from_secs(15));
        Ok(Self { config, is_encrypted, authorities })
    }
}

/// Whether a server is on this machine.
fn is_local(host: &Host) -> bool {
    match host {
        Host::Tcp(name) => name == "localhost" || name.parse().is_ok_and(|ip: std::net::IpAddr| ip.is_loopback()),
        #[cfg(unix)]
        Host::Unix(_) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Address> {
        Address::parse(&text.parse().expect("any text"))
    }

    #[test]
    fn connections_to_other_machines_are_encrypted_unless_that_is_turned_off() {
        for (url, is_encrypted) in [
            ("postgres://me@db.example/farm", true),
            ("postgres://me@db.example/farm?sslmode=disable", false),
            ("postgresql://me@localhost/farm", false),
            ("postgres://me@127.0.0.1:5433/farm", false),
            ("postgres://me@%2Ftmp%2Fx/farm", false),
            ("postgres://me@127.0.0.1/farm?sslmode=require&sslrootcert=%2Fx%20y.pem&connect_timeout=3", true),
        ] {
            let address = parse(url).expect(url);
            assert_eq!(address.is_encrypted, is_encrypted, "{url}");
            assert_eq!(address.authorities.is_some(), url.contains("sslrootcert"), "{url}");
            assert!(address.config.get_options().is_some_and(|options| options.starts_with(SESSION)), "{url}");
        }
    }

    #[test]
    fn what_is_wrong_with_a_url_is_said_without_its_password() {
        for url in [
            "me:secret@db/farm",
            "mysql://me:secret@db/farm",
            "postgres://me:secret@db/farm?sslmode=prefer",
            "postgres://me:secret@db:x/farm",
            "postgres://me:secret@db/farm?no_such=1",
        ] {
            let error = parse(url).expect_err(url);
            assert!(!error.message.contains("secret") && error.message.contains("--store"), "{error}");
        }
        assert!(!format!("{:?}", parse("postgres://me:secret@db/farm")).contains("secret"));
    }
}
