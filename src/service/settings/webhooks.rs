//! Settings of webhooks.

use std::path::PathBuf;

use super::heading;
use crate::WebhookHost;

/// Settings of webhooks.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub struct WebhookSettings {
    /// Hosts that webhooks may go to: HOST or HOST:PORT by https, with http:// before it in the clear; a name that
    /// leads to a private address needs that address listed too. None when left out
    #[arg(long, env = "TESSERAE_WEBHOOK_HOSTS", value_name = "HOST,…", value_delimiter = ',',
          help_heading = heading::WEBHOOKS, hide_short_help = true)]
    pub webhook_hosts: Vec<WebhookHost>,

    /// File with the secret that webhooks are signed with: `whsec_` and 24 to 64 bytes in base64
    #[arg(long, env = "TESSERAE_WEBHOOK_SECRET", value_name = "FILE", help_heading = heading::WEBHOOKS,
          hide_short_help = true)]
    pub webhook_secret: Option<PathBuf>,
}
