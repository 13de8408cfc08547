//! Settings of access.

use std::path::PathBuf;

use super::heading;

/// Settings of access.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub struct AccessSettings {
    /// File of tokens, as `tesserae token new` makes it; read again when it changes. When left out, no request needs a
    /// token
    #[arg(long, env = "TESSERAE_TOKENS", value_name = "FILE", help_heading = heading::ACCESS)]
    pub tokens: Option<PathBuf>,

    /// Listen to other machines without tokens, and answer for any name (Host): every client that reaches the service
    /// can read and delete every job
    #[arg(long, env = "TESSERAE_INSECURE_NO_AUTH", help_heading = heading::ACCESS)]
    pub insecure_no_auth: bool,
}
