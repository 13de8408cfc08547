//! Start-time fair queueing over the tenants at the device, by the time that each used it.
//!
//! Every tenant has a virtual time that advances by what it used, divided by its weight. A tenant that comes back after
//! a pause starts at the current virtual time: it neither waits for what it did not use, nor gets credit for it.

use std::collections::HashMap;
use std::sync::Arc;

use crate::queue::Share;

/// The virtual times.
#[derive(Debug, Default)]
pub(super) struct VirtualTimes {
    /// Virtual start time of the tenant that was served last.
    clock: f64,
    /// Virtual time at which each tenant's next turn starts; only those after `clock` matter.
    next: HashMap<Arc<str>, f64>,
}

/// Number of tenants above which those at or before the clock are dropped.
const KEPT: usize = 1024;

impl VirtualTimes {
    /// Virtual time at which the next turn of a tenant starts: smaller is sooner.
    pub fn start(&self, tenant: &str) -> f64 {
        self.next.get(tenant).map_or(self.clock, |next| next.max(self.clock))
    }

    /// A tenant is served: the clock advances to its start.
    pub fn serve(&mut self, tenant: &str) {
        self.clock = self.start(tenant);
    }

    /// A tenant used `amount`, in a unit that is the same for all tenants.
    pub fn charge(&mut self, tenant: &str, amount: f64, share: Share) {
        let next = self.start(tenant) + amount / f64::from(share.weight.max(1));
        if self.next.len() >= KEPT {
            let clock = self.clock;
            self.next.retain(|_, next| *next > clock);
        }
        self.next.insert(tenant.into(), next);
    }
}
