//! Settings of webhooks.

use std::net::IpAddr;
use std::path::PathBuf;
use std::str::FromStr;

use reqwest::Url;
use tesserae_mesh::error::{Error, Result};

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
