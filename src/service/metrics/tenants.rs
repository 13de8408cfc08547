//! What tenants use. The number of label values is bounded: tenants beyond the first [`MOST`] count as `other`.

use std::collections::HashSet;
use std::time::Duration;

use parking_lot::Mutex;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::registry::Registry;

use super::families::{Seconds, metrics};

/// Tenants with numbers of their own, in the order in which they come.
const MOST: usize = 100;

/// The label of all other tenants; no tenant can have this name.
const OTHER: &str = "(other)";

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(crate) struct ByTenant {
    tenant: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(crate) struct ByTenantAndState {
    tenant: String,
    state: &'static str,
}

metrics! {
    Families {
        jobs: Family<ByTenantAndState, Counter>, "tenant_jobs",
            "Jobs of a tenant that were accepted, or ended in a state";
        job_seconds: Family<ByTenant, Seconds>, "tenant_job" [Seconds],
            "Time between claim and end of the jobs of a tenant";
        queue_seconds: Family<ByTenant, Seconds>, "tenant_queue_wait" [Seconds],
            "Time between acceptance and claim of the jobs of a tenant";
        requests: Family<ByTenant, Counter>, "tenant_requests", "Requests of a tenant that were answered";
        rejections: Family<ByTenant, Counter>, "tenant_rejections", "Requests of a tenant answered with an error";
    }
}

#[derive(Debug)]
pub(super) struct Tenants {
    named: Mutex<HashSet<String>>,
    families: Families,
}

impl Tenants {
    pub fn register(registry: &mut Registry) -> Self {
        Self { named: Mutex::default(), families: Families::register(registry) }
    }

    pub fn accepted(&self, tenant: &str) {
        self.families.jobs.get_or_create(&ByTenantAndState { tenant: self.name(tenant), state: "accepted" }).inc();
    }

    /// A job was claimed, so long after its acceptance.
    pub fn claimed(&self, tenant: &str, waited: Duration) {
        self.families.queue_seconds.get_or_create(&ByTenant { tenant: self.name(tenant) }).inc_by(waited.as_secs_f64());
    }

    /// A job ended in `state`, so long after its claim.
    pub fn ended(&self, tenant: &str, state: &'static str, elapsed: Duration) {
        let tenant = self.name(tenant);
        self.families.job_seconds.get_or_create(&ByTenant { tenant: tenant.clone() }).inc_by(elapsed.as_secs_f64());
        self.families.jobs.get_or_create(&ByTenantAndState { tenant, state }).inc();
    }

    pub fn answered(&self, tenant: &str, is_error: bool) {
        let label = ByTenant { tenant: self.name(tenant) };
        self.families.requests.get_or_create(&label).inc();
        if is_error {
            self.families.rejections.get_or_create(&label).inc();
        }
    }

    fn name(&self, tenant: &str) -> String {
        let mut named = self.named.lock();
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
    fn the_number_of_tenants_with_labels_is_bounded() {
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
