//! Structured logs: lines for people or JSON for machines, on standard error.

use std::io::IsTerminal;

use tracing_subscriber::EnvFilter;

use crate::error::{Error, Result};

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
    #[arg(long, env = "TESSERAE_LOG_FORMAT", value_enum, default_value_t)]
    pub log_format: LogFormat,

    /// What is logged: a level, or a list such as `info,tesserae=debug`
    #[arg(
        long,
        env = "TESSERAE_LOG",
        value_name = "FILTER",
        default_value = "info,wgpu_core=warn,wgpu_hal=warn,naga=warn"
    )]
    pub log: String,
}

impl LogSettings {
    /// Starts logging for the whole process. A second call is an error.
    pub fn start(&self) -> Result<()> {
        let filter = EnvFilter::try_new(&self.log).map_err(|error| {
            Error::parameter(format_args!("the log filter cannot be read ({error}): {:?}", self.log))
        })?;
        let builder = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_ansi(std::io::stderr().is_terminal())
            .with_writer(std::io::stderr);
        match self.log_format {
            LogFormat::Text => builder.try_init(),
            LogFormat::Json => builder.json().try_init(),
        }
        .map_err(|error| Error::new(crate::Kind::Internal, format_args!("logging cannot be started: {error}")))
    }
}
