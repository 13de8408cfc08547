//! Structured logs: lines for people or JSON for machines, on standard error.

use std::io::IsTerminal;

use tesserae_mesh::error::{Error, Kind, Result};
use tracing::Metadata;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::{Targets, filter_fn};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::settings::heading;

/// Target of the audit log.
pub(crate) const AUDIT: &str = "tesserae::audit";

/// What the lines of the log look like.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// One readable line an event
    #[default]
    Text,
    /// One JSON object an event
    Json,
}

/// Settings of the log.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct LogSettings {
    /// What the lines of the log look like
    #[arg(long, env = "TESSERAE_LOG_FORMAT", value_enum,
          hide_short_help = true, help_heading = heading::LOG, default_value_t)]
    pub log_format: LogFormat,

    /// What is logged: a level, or a list such as `info,tesserae::access=warn`, which is no access log
    #[arg(
        long,
        env = "TESSERAE_LOG",
        value_name = "FILTER",
        help_heading = heading::LOG,
        default_value = "info,wgpu_core=warn,wgpu_hal=warn,naga=warn"
    )]
    pub log: String,
}

impl LogSettings {
    /// Starts logging for the whole process. A second call is an error.
    pub fn start(&self) -> Result<()> {
        let filter: Targets = self.log.parse().map_err(|error| {
            Error::parameter(format_args!("the log filter cannot be read ({error}): {:?}", self.log))
        })?;
        let lines =
            || tracing_subscriber::fmt::layer().with_ansi(std::io::stderr().is_terminal()).with_writer(std::io::stderr);
        // all spans around an event are listed; the innermost one need not be there twice
        let json = || lines().json().with_current_span(false);
        let is_audit = |metadata: &Metadata<'_>| metadata.target() == AUDIT;
        let lines = match self.log_format {
            LogFormat::Text => lines().boxed(),
            // audit lines have the fields of their spans themselves
            LogFormat::Json => json()
                .with_filter(filter_fn(move |metadata| !is_audit(metadata)))
                .and_then(json().with_span_list(false).with_filter(filter_fn(is_audit)))
                .boxed(),
        };
        tracing_subscriber::registry()
            .with(filter)
            .with(lines)
            .try_init()
            .map_err(|error| Error::new(Kind::Internal, format_args!("logging cannot be started: {error}")))
    }
}
