//! What tenants use. The number of label values is bounded: tenants beyond the first [`MOST`] count as `other`.

use std::collections::HashSet;
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::registry::{Registry, Unit};

/// A sum of times, in seconds.
pub(super) type Seconds = Counter<f64, AtomicU64>;

/// Tenants with numbers of their own, in the order in which they come.
const MOST: usize = 100;

/// The label of all other tenants, which no tenant can have as its name.
const OTHER: &str = "(other)";

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct ByTenant {
    tenant: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct ByTenantAndState {
    tenant: String,
    state: &'static str,
}

/// Counters by tenant.
#[derive(Debug)]
pub(super) struct Tenants {
    named: Mutex<HashSet<String>>,
    jobs: Family<ByTenantAndState, Counter>,
    job_seconds: Family<ByTenant, Seconds>,
    queue_seconds: Family<ByTenant, Seconds>,
    requests: Family<ByTenant, Counter>,
    rejections: Family<ByTenant, Counter>,
}

impl Tenants {
    /// Registers the counters.
    pub fn register(registry: &mut Registry) -> Self {
        let new = Self {
            named: Mutex::default(),
            jobs: Family::default(),
            job_seconds: Family::default(),
            queue_seconds: Family::default(),
            requests: Family::default(),
            rejections: Family::default(),
        };
        registry.register("tenant_jobs", "Jobs of a tenant that were accepted, or ended in a state", new.jobs.clone());
        registry.register_with_unit(
            "tenant_job",
            "Time between claim and end of the jobs of a tenant",
            Unit::Seconds,
            new.job_seconds.clone(),
        );
        registry.register_with_unit(
            "tenant_queue_wait",
            "Time between acceptance and claim of the jobs of a tenant",
            Unit::Seconds,
            new.queue_seconds.clone(),
        );
        registry.register("tenant_requests", "Requests of a tenant that were answered", new.requests.clone());
        registry.register("tenant_rejections", "Requests of a tenant answered with an error", new.rejections.clone());
        new
    }

    /// A job was accepted.
    pub fn accepted(&self, tenant: &str) {
        self.jobs.get_or_create(&ByTenantAndState { tenant: self.name(tenant), state: "accepted" }).inc();
    }

    /// A job was claimed, so long after its acceptance.
    pub fn claimed(&self, tenant: &str, waited: Duration) {
        self.queue_seconds.get_or_create(&ByTenant { tenant: self.name(tenant) }).inc_by(waited.as_secs_f64());
    }

    /// A job ended in `state`, so long after its claim.
    pub fn ended(&self, tenant: &str, state: &'static str, elapsed: Duration) {
        let tenant = self.name(tenant);
        self.job_seconds.get_or_create(&ByTenant { tenant: tenant.clone() }).inc_by(elapsed.as_secs_f64());
        self.jobs.get_or_create(&ByTenantAndState { tenant, state }).inc();
    }

    /// A request was answered.
    pub fn answered(&self, tenant: &str, is_error: bool) {
        let label = ByTenant { tenant: self.name(tenant) };
        self.requests.get_or_create(&label).inc();
        if is_error {
            self.rejections.get_or_create(&label).inc();
        }
    }

    /// The label of a tenant.
    fn name(&self, tenant: &str) -> String {
        let mut named = self.named.lock().unwrap_or_else(PoisonError::into_inner);
        if named.contains(tenant) {
            return tenant.to_owned();
        }
        if named.len() >= MOST {
            return OTHER.to_owned();
        }
        named.insert(tenant.to_owned());
        tenant.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_so_many_tenants_have_labels() {
        let mut registry = Registry::default();
        let tenants = Tenants::register(&mut registry);
        for number in 0..10 * MOST {
            tenants.accepted(&format!("tenant-{number}"));
        }
        tenants.accepted("tenant-7");
        let mut text = String::new();
        prometheus_client::encoding::text::encode(&mut text, &registry).expect("written");
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with("tenant_jobs_total")).collect();
        assert_eq!(lines.len(), MOST + 1);
        let other = format!("tenant_jobs_total{{tenant=\"(other)\",state=\"accepted\"}} {}", 9 * MOST);
        assert!(lines.contains(&other.as_str()), "{lines:#?}");
        assert!(lines.contains(&"tenant_jobs_total{tenant=\"tenant-7\",state=\"accepted\"} 2"), "{lines:#?}");
    }
}
