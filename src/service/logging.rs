//! Structured logs: lines for people or JSON for machines, on standard error; and spans for a collector of traces.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use opentelemetry::KeyValue;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig as _};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::error::OTelSdkResult;
use opentelemetry_sdk::trace::{SdkTracerProvider, SpanData};
use tracing::Metadata;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::{Targets, filter_fn};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::error::{Error, Kind, Result};

/// Target of the audit log.
pub(super) const AUDIT: &str = "tesserae::audit";

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
        let filter: Targets = self.log.parse().map_err(|error| {
            Error::parameter(format_args!("the log filter cannot be read ({error}): {:?}", self.log))
        })?;
        let spans = self.otlp_endpoint.as_deref().map(collector).transpose()?;
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

/// Spans that the collector did not take, since the process began.
static LOST_SPANS: AtomicU64 = AtomicU64::new(0);

/// Number of spans that the collector did not take.
pub(super) fn lost_spans() -> u64 {
    LOST_SPANS.load(Ordering::Relaxed)
}

/// An exporter that counts what is lost, and logs when the collector fails and when it works again, once each.
#[derive(Debug)]
struct Watched {
    exporter: SpanExporter,
    fails: AtomicBool,
}

impl opentelemetry_sdk::trace::SpanExporter for Watched {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        let spans = batch.len() as u64;
        let exported = self.exporter.export(batch).await;
        match &exported {
            Ok(()) if self.fails.swap(false, Ordering::Relaxed) => tracing::info!("the collector of spans works again"),
            Ok(()) => {}
            Err(error) => {
                LOST_SPANS.fetch_add(spans, Ordering::Relaxed);
                if !self.fails.swap(true, Ordering::Relaxed) {
                    tracing::warn!(%error, "the collector (--otlp-endpoint) does not take spans; they are lost");
                }
            }
        }
        exported
    }

    fn shutdown_with_timeout(&self, timeout: Duration) -> OTelSdkResult {
        self.exporter.shutdown_with_timeout(timeout)
    }

    fn force_flush(&self) -> OTelSdkResult {
        self.exporter.force_flush()
    }

    fn set_resource(&mut self, resource: &Resource) {
        self.exporter.set_resource(resource);
    }
}

/// Sends spans to `endpoint`, in batches, from a thread of its own. Spans are lost while a collector does not answer;
/// requests and jobs do not wait for it.
fn collector(endpoint: &str) -> Result<SdkTracerProvider> {
    super::tls::prepare();
    let wrong = |error: &dyn std::fmt::Display| {
        Error::parameter(format_args!(
            "--otlp-endpoint must be a URL such as http://127.0.0.1:4318/v1/traces ({error}), not {endpoint:?}"
        ))
    };
    let url = reqwest::Url::parse(endpoint).map_err(|error| wrong(&error))?;
    if !matches!(url.scheme(), "http" | "https") || url.host_str().is_none() {
        return Err(wrong(&"neither http nor https, or without a host"));
    }
    let exporter = SpanExporter::builder()
        .with_http()
        .with_protocol(Protocol::HttpBinary)
        .with_endpoint(endpoint)
        .build()
        .map_err(|error| wrong(&error))?;
    let exporter = Watched { exporter, fails: AtomicBool::new(false) };
    let resource = Resource::builder()
        .with_service_name("tesserae")
        .with_attribute(KeyValue::new("service.version", env!("CARGO_PKG_VERSION")))
        .build();
    Ok(SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build())
}
