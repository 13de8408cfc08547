//! Webhooks: the end of a job is sent to the URL of its parameter `webhook`.
//!
//! The store keeps the notices that are not settled, so that a restart loses none: [`Teller`] reads them at the start
//! and whenever a job with a webhook ended. A delivery is signed as [Standard
//! Webhooks](https://www.standardwebhooks.com) says, tried again with growing pauses, and given up a day after the end
//! of the job, or when the receiver answers 410. Deleting the job changes nothing about that. An end may be delivered
//! twice: receivers recognise it by its `webhook-id`, the id of the job, with `.2` behind it for the second end of a
//! job that was retried, and so on. Each host has its own places for deliveries, so that no host delays another one's.

mod target;

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit as _, Mac as _};
use reqwest::StatusCode;
use serde_json::json;
use sha2::Sha256;
use tesserae_mesh::error::{Error, Result};
use tokio::task::{AbortHandle, JoinSet};
use tokio_util::sync::CancellationToken;

use self::target::Targets;
use crate::guard::problem::Problem;
use crate::metrics::Metrics;
use crate::ops::rfc3339;
use crate::settings::WebhookSettings;
use crate::store::{JobId, Notice, Store};
use crate::work::urls;

const SECRET_PREFIX: &str = "whsec_";

pub(crate) struct Webhooks {
    targets: Targets,
    /// What sends, and what signs with the key; none where no webhooks are allowed.
    sender: Option<(reqwest::Client, Hmac<Sha256>)>,
}

impl Webhooks {
    pub fn new(settings: &WebhookSettings) -> Result<Self> {
        let targets = Targets::new(&settings.webhook_hosts);
        if settings.webhook_secret.is_some() && settings.webhook_hosts.is_empty() {
            tracing::warn!("--webhook-secret without --webhook-hosts: no webhook is sent, because no host is allowed");
        }
        let sender = match &settings.webhook_secret {
            Some(path) if !settings.webhook_hosts.is_empty() => {
                let client = reqwest::Client::builder()
                    .user_agent(concat!("tesserae/", env!("CARGO_PKG_VERSION")))
                    // what is allowed is one host, not wherever that points to
                    .redirect(reqwest::redirect::Policy::none())
                    .no_proxy()
                    .timeout(Duration::from_secs(15))
                    .dns_resolver(Arc::new(targets.clone()))
                    .build()
                    .map_err(|error| {
                        let why = format_args!("webhooks cannot be sent (are there CA certificates?): {error:?}");
                        Error::unavailable(why)
                    })?;
                Some((client, read_secret(path)?))
            }
            _ => None,
        };
        Ok(Self { targets, sender })
    }

    pub fn check(&self, webhook: &str) -> Result<()> {
        self.targets.check(webhook).map(drop)
    }
}

fn read_secret(path: &Path) -> Result<Hmac<Sha256>> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| Error::io(format_args!("the secret of webhooks cannot be read: {}", path.display()), error))?;
    let text = text.trim();
    let key = STANDARD.decode(text.strip_prefix(SECRET_PREFIX).unwrap_or(text)).ok();
    let key = key.filter(|key| (24..=64).contains(&key.len()));
    key.and_then(|key| Hmac::new_from_slice(&key).ok()).ok_or_else(|| {
        Error::parameter(format_args!(
            "the secret of webhooks must be {SECRET_PREFIX} and 24 to 64 bytes in base64 (`echo {SECRET_PREFIX}$(head \
             -c 32 /dev/urandom | base64)` makes one); it is not, in {}",
            path.display()
        ))
    })
}

pub(crate) struct Teller {
    pub store: Arc<Store>,
    pub webhooks: Arc<Webhooks>,
    pub metrics: Arc<Metrics>,
}

impl Teller {
    /// Delivers ends until `stop`: a task for each that is not settled.
    pub async fn run(self, stop: CancellationToken) {
        let this = Arc::new(self);
        let mut endings = this.store.endings();
        let (mut tasks, mut by_job) = (JoinSet::new(), HashMap::<JobId, AbortHandle>::new());
        while !stop.is_cancelled() {
            endings.borrow_and_update();
            let untold = match this.store.untold().await {
                Ok(untold) => untold,
                Err(error) => {
                    tracing::error!(%error, "it cannot be read which ends are to be told");
                    let _ = stop.run_until_cancelled(tokio::time::sleep(Duration::from_secs(5))).await;
                    continue;
                }
            };
            this.metrics.families.webhooks_pending.set(untold.len() as i64);
            // another service may have taken over
            let ours: HashSet<JobId> = untold.iter().copied().collect();
            by_job.iter().filter(|(id, _)| !ours.contains(id)).for_each(|(_, task)| task.abort());
            by_job.retain(|id, task| ours.contains(id) && !task.is_finished());
            for id in untold {
                by_job.entry(id).or_insert_with(|| {
                    let this = Arc::clone(&this);
                    tasks.spawn(async move {
                        let mut pause = Duration::from_secs(5);
                        // boxed: most tasks wait
                        while !Box::pin(this.attempt(id)).await {
                            tokio::time::sleep(pause).await;
                            pause = (6 * pause).min(Duration::from_secs(3600));
                        }
                    })
                });
            }
            tokio::select! {
                () = stop.cancelled() => break,
                changed = endings.changed() => if changed.is_err() { break },
                // a retried job may have ended again meanwhile
                Some(_) = tasks.join_next() => {}
            }
        }
    }

    /// Delivers the end of a job once; whether that settled it.
    async fn attempt(&self, id: JobId) -> bool {
        let notice = match self.store.notice(id).await {
            Ok(Some(notice)) => notice,
            Ok(None) => return true,
            Err(error) => {
                tracing::warn!(%error, job = %id, "it cannot be read what is to be told");
                return false;
            }
        };
        let age = notice.ended_at.elapsed().unwrap_or_default();
        let outcome = match self.send(&notice).await {
            Ok(status) if status.is_success() => "delivered",
            failed => {
                let is_gone = failed == Ok(StatusCode::GONE);
                let why = failed.map_or_else(|error| error.message, |status| format!("the receiver answered {status}"));
                tracing::warn!(job = %id, seconds_since_end = age.as_secs(), "a webhook was not delivered: {why}");
                if is_gone || age > Duration::from_secs(24 * 3600) { "given_up" } else { "failed" }
            }
        };
        self.metrics.families.webhooks.get_or_create(&[("outcome", outcome)]).inc();
        if outcome == "failed" {
            return false;
        }
        let settled = self.store.settle_webhook(id, notice.ended_at).await;
        let settled = settled.inspect_err(|error| {
            tracing::error!(%error, job = %id, "it cannot be stored that an end was told: it will be told again");
        });
        settled.is_ok()
    }

    /// Sends a notice, if that is allowed now: the list of hosts may have changed since the job was accepted.
    async fn send(&self, notice: &Notice) -> Result<StatusCode> {
        let (url, places) = self.webhooks.targets.check(&notice.webhook)?;
        let no_secret = || Error::unavailable("there is no secret to sign it with");
        let (client, mac) = self.webhooks.sender.as_ref().ok_or_else(no_secret)?;
        // they are never closed
        let _place = places.acquire().await.ok();
        let path = urls::path(notice.job);
        let problem = notice.problem.as_ref().map(|error| Problem::new(error, &path));
        let data = json!({ "id": notice.job, "state": notice.state, "problem": problem, "url": path });
        let body = json!({ "type": "job.ended", "timestamp": rfc3339(notice.ended_at), "data": data }).to_string();
        let timestamp = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let id = webhook_id(notice.job, notice.end);
        let signature = sign(mac.clone(), &id, timestamp, &body);
        let mut request = client
            .post(url)
            .header("content-type", "application/json")
            .header("webhook-id", id)
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
            Error::unavailable(format_args!("{error}{cause}"))
        })
    }
}

/// The `webhook-id` of an end: the job's id, and for later ends of a retried job their number.
fn webhook_id(job: JobId, end: u32) -> String {
    if end > 1 { format!("{job}.{end}") } else { job.to_string() }
}

/// The signature of a delivery: `v1,` and the HMAC-SHA256 of id, timestamp and body, joined by dots.
fn sign(mac: Hmac<Sha256>, id: &str, timestamp: u64, body: &str) -> String {
    let signature = mac.chain_update(format!("{id}.{timestamp}.{body}")).finalize();
    format!("v1,{}", STANDARD.encode(signature.into_bytes()))
}

/// Reads a URL and a host.
#[cfg(any(fuzzing, test))]
pub(crate) fn for_fuzzing(text: &str) {
    let host: std::result::Result<crate::settings::WebhookHost, _> = text.parse();
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
        let mac = Hmac::new_from_slice(&key).expect("a key");
        let signature = sign(mac, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, r#"{"test": 2432232314}"#);
        assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn a_later_end_of_a_retried_job_has_an_id_of_its_own() {
        let job = JobId::random();
        assert_eq!(webhook_id(job, 1), job.to_string());
        assert_eq!(webhook_id(job, 2), format!("{job}.2"));
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
