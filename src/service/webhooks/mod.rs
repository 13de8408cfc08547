//! Telling the end of a job to who asked for it (parameter `webhook`).
//!
//! Which ends are still to be told is known by the store, so that a restart loses none: [`Teller`] asks it at the start
//! and whenever a job with a webhook ended. A delivery is signed as [Standard Webhooks](https://www.standardwebhooks.com)
//! says, tried again with growing pauses, and given up a day after the end of the job, or when the receiver answers 410.
//! Deleting the job changes nothing about that. An end may be told twice: `webhook-id` is the id of the job, by which receivers know it again.

mod target;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit as _, Mac as _};
use reqwest::{StatusCode, Url};
use serde::Serialize;
use sha2::Sha256;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use self::target::Targets;
pub use self::target::WebhookHost;
use super::jobs;
use super::metrics::Metrics;
use super::problem::Problem;
use super::settings::WebhookSettings;
use super::store::{JobId, JobStore, Notice, State};
use super::timestamp::rfc3339;
use crate::error::{Error, Kind, Result};

/// Deliveries at a time.
const AT_ONCE: usize = 8;

/// Time for one delivery.
const PATIENCE: Duration = Duration::from_secs(15);

/// Pauses after the first attempts, in seconds; the last one is repeated.
const PAUSES: [u64; 6] = [5, 30, 120, 600, 1800, 3600];

/// Time after the end of a job after which it is not told any more.
const GIVEN_UP_AFTER: Duration = Duration::from_secs(24 * 3600);

/// How long the store is left alone after it failed.
const BREATHER: Duration = Duration::from_secs(5);

/// What a secret begins with.
const SECRET_PREFIX: &str = "whsec_";

/// What is allowed, and how deliveries are signed.
#[derive(Debug)]
pub(super) struct Webhooks {
    targets: Targets,
    /// None where no webhooks are allowed.
    sender: Option<Sender>,
}

struct Sender {
    client: reqwest::Client,
    key: Vec<u8>,
}

impl std::fmt::Debug for Sender {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sender").finish_non_exhaustive()
    }
}

/// What is told.
#[derive(Debug, Serialize)]
struct Message<'a> {
    #[serde(rename = "type")]
    kind: &'static str,
    timestamp: String,
    data: Data<'a>,
}

#[derive(Debug, Serialize)]
struct Data<'a> {
    id: JobId,
    state: State,
    problem: Option<Problem>,
    /// Path of the job on this service, where it is as long as nobody deletes it.
    url: &'a str,
}

impl Webhooks {
    /// What the settings say.
    pub fn new(settings: &WebhookSettings) -> Result<Self> {
        let targets = Targets::new(&settings.webhook_hosts);
        let sender = match &settings.webhook_secret {
            Some(path) if !settings.webhook_hosts.is_empty() => {
                let client = reqwest::Client::builder()
                    .user_agent(concat!("tesserae/", env!("CARGO_PKG_VERSION")))
                    // what is allowed is one host, not wherever that points to
                    .redirect(reqwest::redirect::Policy::none())
                    .no_proxy()
                    .timeout(PATIENCE)
                    .dns_resolver(Arc::new(targets.clone()))
                    .build()
                    .map_err(|error| {
                        Error::new(
                            Kind::Unavailable,
                            format_args!("webhooks cannot be sent (are there CA certificates?): {error:?}"),
                        )
                    })?;
                Some(Sender { client, key: read_secret(path)? })
            }
            _ => None,
        };
        Ok(Self { targets, sender })
    }

    /// Refuses a webhook that would go where none may.
    pub fn check(&self, webhook: &str) -> Result<()> {
        self.targets.check(webhook).map(drop)
    }
}

/// Reads the secret that deliveries are signed with.
fn read_secret(path: &Path) -> Result<Vec<u8>> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| Error::io(format_args!("the secret of webhooks cannot be read: {}", path.display()), error))?;
    let text = text.trim();
    let key = STANDARD.decode(text.strip_prefix(SECRET_PREFIX).unwrap_or(text)).ok();
    key.filter(|key| (24..=64).contains(&key.len())).ok_or_else(|| {
        Error::parameter(format_args!(
            "the secret of webhooks must be {SECRET_PREFIX} and 24 to 64 bytes in base64 (`echo {SECRET_PREFIX}$(head -c 32 \
             /dev/urandom | base64)` makes one); it is not, in {}",
            path.display()
        ))
    })
}

/// What came of an attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Delivered,
    /// To be tried again.
    Failed,
    /// Not to be tried again, or gone.
    GivenUp,
}

/// Tells ends.
#[derive(Debug)]
pub(super) struct Teller {
    store: Arc<dyn JobStore>,
    webhooks: Arc<Webhooks>,
    metrics: Arc<Metrics>,
}

/// Attempts so far, and when the next one is due.
type Attempts = HashMap<JobId, (usize, Instant)>;

impl Teller {
    pub fn new(store: Arc<dyn JobStore>, webhooks: Arc<Webhooks>, metrics: Arc<Metrics>) -> Self {
        Self { store, webhooks, metrics }
    }

    /// Tells ends until `stop`.
    pub async fn run(self, stop: CancellationToken) {
        let this = Arc::new(self);
        let mut attempts = Attempts::new();
        let mut endings = this.store.endings();
        let mut under_way: JoinSet<(JobId, Outcome)> = JoinSet::new();
        let mut busy: Vec<JobId> = Vec::new();
        while !stop.is_cancelled() {
            endings.borrow_and_update();
            let untold = match this.store.untold().await {
                Ok(untold) => untold,
                Err(error) => {
                    tracing::error!(%error, "it cannot be read which ends are to be told");
                    let _ = stop.run_until_cancelled(tokio::time::sleep(BREATHER)).await;
                    continue;
                }
            };
            this.metrics.webhooks_pending(untold.len());
            attempts.retain(|id, _| untold.contains(id));
            let now = Instant::now();
            let mut next_due = None;
            for id in untold {
                let (_, due) = attempts.get(&id).copied().unwrap_or((0, now));
                if busy.contains(&id) {
                    continue;
                }
                if due <= now && busy.len() < AT_ONCE {
                    busy.push(id);
                    let this = Arc::clone(&this);
                    under_way.spawn(async move { (id, this.attempt(id).await) });
                } else {
                    next_due = Some(next_due.map_or(due, |other: Instant| other.min(due)));
                }
            }
            let pause = async {
                match next_due.filter(|_| busy.len() < AT_ONCE) {
                    Some(due) => tokio::time::sleep_until(due.into()).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = stop.cancelled() => break,
                changed = endings.changed() => if changed.is_err() { break },
                Some(done) = under_way.join_next() => {
                    let Ok((id, outcome)) = done else {
                        // a defect, which was logged: all are tried again
                        busy.clear();
                        continue;
                    };
                    busy.retain(|other| *other != id);
                    this.note(id, outcome, &mut attempts).await;
                }
                () = pause => {}
            }
        }
    }

    /// Takes account of an attempt.
    async fn note(&self, id: JobId, outcome: Outcome, attempts: &mut Attempts) {
        let name = match outcome {
            Outcome::Delivered => "delivered",
            Outcome::Failed => "failed",
            Outcome::GivenUp => "given_up",
        };
        self.metrics.told(name);
        if outcome == Outcome::Failed {
            let made = attempts.get(&id).map_or(0, |(made, _)| *made);
            let pause = PAUSES.get(made).or(PAUSES.last()).copied().unwrap_or_default();
            attempts.insert(id, (made + 1, Instant::now() + Duration::from_secs(pause)));
        } else if let Err(error) = self.store.settle_webhook(id).await {
            tracing::error!(%error, job = %id, "it cannot be stored that an end was told");
            attempts.insert(id, (0, Instant::now() + BREATHER));
        }
    }

    /// Tells the end of a job once.
    async fn attempt(&self, id: JobId) -> Outcome {
        let notice = match self.store.notice(id).await {
            Ok(Some(notice)) => notice,
            Ok(None) => return Outcome::GivenUp,
            Err(_) => return Outcome::Failed,
        };
        let why = match self.send(&notice).await {
            Ok(status) if status.is_success() => return Outcome::Delivered,
            Ok(StatusCode::GONE) => return Outcome::GivenUp,
            Ok(status) => format!("the receiver answered {status}"),
            Err(error) => error.message,
        };
        let age = notice.ended_at.elapsed().unwrap_or_default();
        tracing::warn!(job = %id, seconds_since_end = age.as_secs(), "a webhook was not delivered: {why}");
        if age > GIVEN_UP_AFTER { Outcome::GivenUp } else { Outcome::Failed }
    }

    /// Sends a notice, if that is allowed now: the list of hosts may be another than when the job was accepted, and may
    /// be the same again later.
    async fn send(&self, notice: &Notice) -> Result<StatusCode> {
        let url = self.webhooks.targets.check(&notice.webhook)?;
        let sender = self.webhooks.sender.as_ref();
        let sender = sender.ok_or_else(|| Error::new(Kind::Unavailable, "there is no secret to sign it with"))?;
        sender.send(url, notice).await
    }
}

impl Sender {
    async fn send(&self, url: Url, notice: &Notice) -> Result<StatusCode> {
        let path = jobs::path(notice.job);
        let message = Message {
            kind: "job.ended",
            timestamp: rfc3339(notice.ended_at),
            data: Data {
                id: notice.job,
                state: notice.state,
                problem: notice.problem.as_ref().map(|error| Problem::new(error, &path)),
                url: &path,
            },
        };
        let internal = |error: &dyn std::fmt::Display| {
            Error::new(Kind::Internal, format_args!("a webhook cannot be written: {error}"))
        };
        let body = serde_json::to_string(&message).map_err(|error| internal(&error))?;
        let timestamp = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let signature = sign(&self.key, notice.job, timestamp, &body).ok_or_else(|| internal(&"no key"))?;
        let mut request = self
            .client
            .post(url)
            .header("content-type", "application/json")
            .header("webhook-id", notice.job.to_string())
            .header("webhook-timestamp", timestamp)
            .header("webhook-signature", signature);
        if let Some(parent) = &notice.trace_parent {
            request = request.header("traceparent", parent);
        }
        let response = request.body(body).send().await;
        // without the URL, which may hold a secret
        response.map(|response| response.status()).map_err(|error| {
            let error = error.without_url();
            let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}")).unwrap_or_default();
            Error::new(Kind::Unavailable, format_args!("{error}{cause}"))
        })
    }
}

/// The signature of a delivery: `v1,` and the HMAC-SHA256 of id, timestamp and body, joined by dots.
fn sign(key: &[u8], id: impl std::fmt::Display, timestamp: u64, body: &str) -> Option<String> {
    let mut mac = Hmac::<Sha256>::new_from_slice(key).ok()?;
    mac.update(format!("{id}.{timestamp}.{body}").as_bytes());
    Some(format!("v1,{}", STANDARD.encode(mac.finalize().into_bytes())))
}

/// Reads a URL and a host.
#[cfg(fuzzing)]
pub(super) fn for_fuzzing(text: &str) {
    let host: std::result::Result<WebhookHost, _> = text.parse();
    let targets = Targets::new(&host.into_iter().collect::<Vec<_>>());
    let _ = targets.check(text);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the standard's own libraries.
    #[test]
    fn deliveries_are_signed_as_the_standard_says() {
        let key = STANDARD.decode("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw").expect("base64");
        let signature = sign(&key, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, r#"{"test": 2432232314}"#);
        assert_eq!(signature.as_deref(), Some("v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="));
    }

    #[test]
    fn a_secret_that_is_none_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("secret");
        for (text, good) in [
            ("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\n", true),
            ("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", true),
            ("whsec_short", false),
            ("", false),
        ] {
            std::fs::write(&path, text).expect("written");
            assert_eq!(read_secret(&path).is_ok(), good, "{text:?}");
        }
        assert!(read_secret(&folder.path().join("missing")).is_err());
    }
}
