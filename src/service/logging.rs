//! Structured logs: lines for people or JSON for machines, on standard error; and spans for a collector of traces.

use std::io::IsTerminal;

use opentelemetry::KeyValue;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig as _};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _};

use crate::error::{Error, Kind, Result};

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

    /// Collector that spans are sent to (OTLP over HTTP), such as http://127.0.0.1:4318/v1/traces; none when left out
    #[arg(long, env = "TESSERAE_OTLP_ENDPOINT", value_name = "URL")]
    pub otlp_endpoint: Option<String>,
}

/// Logging under way. What a collector did not get yet is sent when this is dropped, outside of any runtime.
#[derive(Debug)]
#[must_use]
pub struct Logging {
    spans: Option<SdkTracerProvider>,
}

impl Drop for Logging {
    fn drop(&mut self) {
        if let Some(Err(error)) = self.spans.take().map(|spans| spans.shutdown()) {
            tracing::warn!(%error, "the last spans were not sent");
        }
    }
}

impl LogSettings {
    /// Starts logging for the whole process. A second call is an error.
    pub fn start(&self) -> Result<Logging> {
        let filter = EnvFilter::try_new(&self.log).map_err(|error| {
            Error::parameter(format_args!("the log filter cannot be read ({error}): {:?}", self.log))
        })?;
        let spans = self.otlp_endpoint.as_deref().map(collector).transpose()?;
        let lines =
            tracing_subscriber::fmt::layer().with_ansi(std::io::stderr().is_terminal()).with_writer(std::io::stderr);
        let lines = match self.log_format {
            LogFormat::Text => lines.boxed(),
            LogFormat::Json => lines.json().boxed(),
        };
        let tracer = spans.as_ref().map(|spans| tracing_opentelemetry::layer().with_tracer(spans.tracer("tesserae")));
        tracing_subscriber::registry()
            .with(filter)
            .with(lines)
            .with(tracer)
            .try_init()
            .map_err(|error| Error::new(Kind::Internal, format_args!("logging cannot be started: {error}")))?;
        Ok(Logging { spans })
    }
}

/// Sends spans to `endpoint`, in batches, from a thread of its own. A collector that does not answer loses spans and holds
/// nobody up.
fn collector(endpoint: &str) -> Result<SdkTracerProvider> {
    super::tls::prepare();
    let wrong = |error: &dyn std::fmt::Display| {
        Error::parameter(format_args!("spans cannot be sent to this collector ({error}): {endpoint:?}"))
    };
    let exporter = SpanExporter::builder()
        .with_http()
        .with_protocol(Protocol::HttpBinary)
        .with_endpoint(endpoint)
        .build()
        .map_err(|error| wrong(&error))?;
    let resource = Resource::builder()
        .with_service_name("tesserae")
        .with_attribute(KeyValue::new("service.version", env!("CARGO_PKG_VERSION")))
        .build();
    Ok(SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build())
}
