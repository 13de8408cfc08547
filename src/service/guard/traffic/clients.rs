//! The requests and streams of each client, and their rate.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::Arc;
use std::time::Instant;

use parking_lot::Mutex;
use tesserae_mesh::error::{Error, Kind};

use crate::guard::problem::Failure;

/// Seconds over which the rate of requests is averaged: a burst may be as large as this many seconds allow.
const BURST_SECONDS: f64 = 5.0;

/// Number of clients above which quiet ones are dropped.
const SWEEP_ABOVE: usize = 4096;

/// A client: its requests share one allowance.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum Client {
    Tenant(String),
    /// An address: of IPv6, the first half, which is what one machine has to itself.
    Address(IpAddr),
}

impl Client {
    pub fn of_address(address: IpAddr) -> Self {
        Self::Address(match address.to_canonical() {
            IpAddr::V6(address) => IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() >> 64 << 64)),
            v4 @ IpAddr::V4(_) => v4,
        })
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Allowance {
    /// Requests a second; 0 for any number.
    pub rate: u32,
    pub requests: u32,
    pub streams: u32,
}

/// All clients with recent requests.
#[derive(Debug, Default)]
pub(super) struct Clients(Mutex<HashMap<Client, Account>>);

#[derive(Debug)]
struct Account {
    /// Requests that it may still make at once.
    credit: f64,
    /// When the credit was that.
    at: Instant,
    requests: u32,
    streams: u32,
}

/// The right to one request or stream, until it is dropped.
#[derive(Debug)]
pub(super) struct Permit {
    clients: Arc<Clients>,
    client: Client,
    is_stream: bool,
}

impl Clients {
    /// Admits one more request, or gives the reason for a refusal.
    pub fn admit(self: &Arc<Self>, client: Client, allowance: Allowance, is_stream: bool) -> Result<Permit, Failure> {
        self.admit_at(client, allowance, is_stream, Instant::now())
    }

    fn admit_at(
        self: &Arc<Self>,
        client: Client,
        allowance: Allowance,
        is_stream: bool,
        now: Instant,
    ) -> Result<Permit, Failure> {
        let mut accounts = self.0.lock();
        if accounts.len() > SWEEP_ABOVE {
            accounts.retain(|_, account| !account.is_forgettable(now));
        }
        let full = f64::from(allowance.rate) * BURST_SECONDS;
        let account =
            accounts.entry(client.clone()).or_insert(Account { credit: full, at: now, requests: 0, streams: 0 });
        if allowance.rate > 0 {
            let earned = now.saturating_duration_since(account.at).as_secs_f64() * f64::from(allowance.rate);
            account.credit = (account.credit + earned).min(full);
            account.at = now;
            if account.credit < 1.0 {
                let wait = (1.0 - account.credit) / f64::from(allowance.rate);
                let message =
                    format_args!("more requests than a client may make a second; try again later: {}", allowance.rate);
                return Err(Failure::retry_after(Error::new(Kind::RateLimited, message), wait.ceil() as u32));
            }
            account.credit -= 1.0;
        }
        let (count, limit, what) = match is_stream {
            true => (&mut account.streams, allowance.streams, "event streams"),
            false => (&mut account.requests, allowance.requests, "requests"),
        };
        if *count >= limit {
            let message = format_args!("as many {what} at a time as a client may have; try again later: {limit}");
            return Err(Error::new(Kind::RateLimited, message).into());
        }
        *count += 1;
        Ok(Permit { clients: Arc::clone(self), client, is_stream })
    }
}

impl Account {
    /// Whether a new account would be the same: nothing goes on, and the credit is full again.
    fn is_forgettable(&self, now: Instant) -> bool {
        let quiet = now.saturating_duration_since(self.at).as_secs_f64();
        self.requests == 0 && self.streams == 0 && quiet > BURST_SECONDS
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        if let Some(account) = self.clients.0.lock().get_mut(&self.client) {
            let count = if self.is_stream { &mut account.streams } else { &mut account.requests };
            *count = count.saturating_sub(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const ALLOWANCE: Allowance = Allowance { rate: 2, requests: 100, streams: 1 };

    fn client(name: &str) -> Client {
        Client::Tenant(name.to_owned())
    }

    #[test]
    fn quiet_clients_are_forgotten_and_busy_ones_are_not() {
        let clients = Arc::new(Clients::default());
        let start = Instant::now();
        let busy = clients.admit_at(client("busy"), ALLOWANCE, true, start).expect("the first");
        for number in 0..3 * SWEEP_ABOVE {
            let at = start + Duration::from_millis(10 * number as u64);
            clients.admit_at(client(&number.to_string()), ALLOWANCE, false, at).expect("the first");
        }
        assert!(clients.0.lock().len() <= SWEEP_ABOVE + 1, "{}", clients.0.lock().len());
        assert!(clients.0.lock().contains_key(&client("busy")));
        drop(busy);
    }

    #[test]
    fn an_ipv6_machine_is_one_client_under_all_its_addresses() {
        let of = |text: &str| Client::of_address(text.parse().expect("an address"));
        assert_eq!(of("2001:db8:1:2::1"), of("2001:db8:1:2:ffff::9"));
        assert_ne!(of("2001:db8:1:2::1"), of("2001:db8:1:3::1"));
        assert_eq!(of("::ffff:10.0.0.1"), of("10.0.0.1"));
    }
}
