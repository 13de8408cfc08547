//! The address of the database: its URL, with what every session of this service has.
//!
//! TLS is on or off, and on means that the certificate of the server is verified: `sslmode=require` of other programs,
//! which takes any certificate, does not keep another server from answering. Without `sslmode` it is on, except for a
//! server on this machine.

use std::time::Duration;

use tesserae_mesh::error::{Error, Result};
use tokio_postgres::Config;
use tokio_postgres::config::{Host, SslMode};

use super::super::StoreUrl;

/// Options of each session. Statements are short, so that a long one is stuck: it fails at a timeout. Every statement
/// finds its rows by an index: a plan by the statistics of a queue, which are soon out of date, may read all jobs.
const SESSION: &str = "-c search_path=tesserae -c statement_timeout=20s -c lock_timeout=10s \
    -c idle_in_transaction_session_timeout=20s -c timezone=UTC -c synchronous_commit=on -c jit=off \
    -c plan_cache_mode=force_generic_plan -c enable_seqscan=off -c enable_bitmapscan=off -c enable_hashjoin=off \
    -c enable_mergejoin=off -c enable_material=off";

/// Reads a URL. No error shows any of it, except for names of parameters.
pub fn parse(url: &StoreUrl) -> Result<Config> {
    let text = &url.0;
    if !["postgres://", "postgresql://"].iter().any(|scheme| text.starts_with(scheme)) {
        return Err(Error::parameter(
            "--store must be postgres://USER:PASSWORD@HOST/DATABASE; leave it out to keep jobs in --data-dir",
        ));
    }
    let mut config: Config = text.parse().map_err(|error| {
        let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}")).unwrap_or_default();
        Error::parameter(format_args!("--store is not a URL of a PostgreSQL database{cause}"))
    })?;
    let is_encrypted = match config.get_ssl_mode() {
        SslMode::Disable => false,
        SslMode::Require => true,
        // where the URL says nothing
        _ => !config.get_hosts().iter().all(is_local),
    };
    let session = config.get_options().map_or(SESSION.to_owned(), |options| format!("{SESSION} {options}"));
    config.options(session).ssl_mode(if is_encrypted { SslMode::Require } else { SslMode::Disable });
    if config.get_application_name().is_none() {
        config.application_name("tesserae");
    }
    if config.get_connect_timeout().is_none() {
        config.connect_timeout(Duration::from_secs(5));
    }
    config.keepalives_idle(Duration::from_secs(15)).tcp_user_timeout(Duration::from_secs(15));
    Ok(config)
}

fn is_local(host: &Host) -> bool {
    match host {
        Host::Tcp(name) => name == "localhost" || name.parse().is_ok_and(|ip: std::net::IpAddr| ip.is_loopback()),
        Host::Unix(_) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Config> {
        parse(&text.into())
    }

    #[test]
    fn connections_to_other_machines_are_encrypted_unless_that_is_turned_off() {
        for (url, is_encrypted) in [
            ("postgres://me@db.example/farm", true),
            ("postgres://me@db.example/farm?sslmode=prefer", true),
            ("postgres://me@db.example/farm?sslmode=disable", false),
            ("postgresql://me@localhost/farm", false),
            ("postgres://me@127.0.0.1:5433/farm", false),
            ("postgres://me@%2Ftmp%2Fx/farm", false),
            ("postgres://me@127.0.0.1/farm?sslmode=require&connect_timeout=3", true),
        ] {
            let config = parsed(url).expect(url);
            assert_eq!(config.get_ssl_mode() == SslMode::Require, is_encrypted, "{url}");
            assert!(config.get_options().is_some_and(|options| options.starts_with(SESSION)), "{url}");
        }
    }

    #[test]
    fn what_is_wrong_with_a_url_is_said_without_its_password() {
        for url in [
            "me:secret@db/farm",
            "mysql://me:secret@db/farm",
            "postgres://me:secret@db/farm?sslmode=allow",
            "postgres://me:secret@db:x/farm",
            "postgres://me:secret@db/farm?no_such=1",
        ] {
            let error = parsed(url).expect_err(url);
            assert!(!error.message.contains("secret") && error.message.contains("--store"), "{error}");
        }
    }
}
