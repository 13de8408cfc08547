//! Structured logs: lines for people or JSON for machines, on standard error.

use std::fmt::Display;
use std::io::IsTerminal;

use tesserae_mesh::error::{Error, Result};
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

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
#[command(next_help_heading = "Log")]
pub struct LogSettings {
    /// What the lines of the log look like
    #[arg(long, env = "TESSERAE_LOG_FORMAT", value_enum, hide_short_help = true, default_value_t)]
    pub log_format: LogFormat,

    /// What is logged: a level, or a list such as `info,tesserae::access=warn`, which is no access log
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
        let wrong =
            |why: &dyn Display| Error::parameter(format_args!("the log filter cannot be read ({why}): {:?}", self.log));
        let filter: Targets = self.log.parse().map_err(|error| wrong(&error))?;
        // a part without `=` that is no level is read as a target, and turns everything else off: a misspelt level
        if let Some(part) = self.log.split(',').find(|part| !part.contains('=') && part.parse::<LevelFilter>().is_err())
        {
            return Err(wrong(&format_args!("not a level, off, error, warn, info, debug or trace: {part}")));
        }
        let lines =
            tracing_subscriber::fmt::layer().with_ansi(std::io::stderr().is_terminal()).with_writer(std::io::stderr);
        let lines = match self.log_format {
            LogFormat::Text => lines.boxed(),
            // all spans around an event are listed; the innermost one need not be there twice
            LogFormat::Json => lines.json().with_current_span(false).boxed(),
        };
        tracing_subscriber::registry()
            .with(filter)
            .with(lines)
            .try_init()
            .map_err(|error| Error::internal(format_args!("logging cannot be started: {error}")))
    }
}
