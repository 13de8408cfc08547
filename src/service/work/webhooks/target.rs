//! Where webhooks may go: to hosts that the operator listed, and by no name into the operator's network.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;

use ipnet::IpNet;
use reqwest::Url;
use reqwest::dns::{Addrs, Name, Resolve, Resolving};
use tesserae_mesh::error::{Error, Result};
use tokio::sync::Semaphore;

use crate::settings::WebhookHost;

#[derive(Debug, Clone, Default)]
pub(super) struct Targets {
    hosts: Arc<HashMap<WebhookHost, Semaphore>>,
}

impl Targets {
    pub fn new(hosts: &[WebhookHost]) -> Self {
        // deliveries to one host at a time
        let places = |host: &WebhookHost| (host.clone(), Semaphore::new(8));
        Self { hosts: Arc::new(hosts.iter().map(places).collect()) }
    }

    /// The URL, if webhooks may go there, and the places of its host.
    pub fn check(&self, text: &str) -> Result<(Url, &Semaphore)> {
        let (bytes, most) = (text.len(), 2048);
        if bytes > most {
            return Err(Error::parameter(format_args!("webhook must have at most {most} bytes, not {bytes}")));
        }
        let url = Url::parse(text)
            .map_err(|error| Error::parameter(format_args!("webhook must be a URL ({error}), not {text:?}")))?;
        let host = WebhookHost::of(&url).ok_or_else(|| {
            Error::parameter(format_args!("webhook must be an https URL without user and password, not {text:?}"))
        })?;
        match self.hosts.get(&host) {
            Some(places) => Ok((url, places)),
            None => Err(Error::parameter(format_args!(
                "webhooks go only to hosts that the operator allows (the service's --webhook-hosts), not to {}://{}:{}",
                host.scheme, host.host, host.port
            ))),
        }
    }

    fn may_reach(&self, address: IpAddr) -> bool {
        is_public(address) || self.hosts.keys().any(|host| host.address() == Some(address.to_canonical()))
    }
}

/// Resolves names, and leaves out private addresses unless they are listed themselves.
impl Resolve for Targets {
    fn resolve(&self, name: Name) -> Resolving {
        let this = self.clone();
        Box::pin(async move {
            let found = tokio::net::lookup_host((name.as_str(), 0)).await?;
            let allowed: Vec<SocketAddr> = found.filter(|address| this.may_reach(address.ip())).collect();
            if allowed.is_empty() {
                return Err(format!("{} leads to no address that webhooks may go to", name.as_str()).into());
            }
            Ok(Box::new(allowed.into_iter()) as Addrs)
        })
    }
}

/// IPv4 networks that are not of the public internet (RFC 6890 and the registries that it made).
const SPECIAL_V4: &str = "0.0.0.0/8 10.0.0.0/8 100.64.0.0/10 127.0.0.0/8 169.254.0.0/16 172.16.0.0/12 192.0.0.0/24 \
                          192.0.2.0/24 192.168.0.0/16 198.18.0.0/15 198.51.100.0/24 203.0.113.0/24 224.0.0.0/3";

/// IPv6 networks with public addresses, and those in them that are not: Teredo, benchmarks, ORCHID, documentation.
const PUBLIC_V6: &str = "2000::/3";
const SPECIAL_V6: &str = "2001::/23 2001:db8::/32 3fff::/20";

fn is_public(address: IpAddr) -> bool {
    let address = address.to_canonical();
    let is_in = |networks: &str| {
        let mut networks = networks.split(' ').map(str::parse::<IpNet>);
        networks.any(|network| network.is_ok_and(|network| network.contains(&address)))
    };
    let IpAddr::V6(new) = address else { return !is_in(SPECIAL_V4) };
    match new.segments() {
        // addresses of the old kind in the new: translated, 6to4
        [0x64, 0xff9b, 0, 0, 0, 0, high, low] | [0x2002, high, low, ..] => {
            is_public(Ipv4Addr::from(u32::from(high) << 16 | u32::from(low)).into())
        }
        _ => is_in(PUBLIC_V6) && !is_in(SPECIAL_V6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn targets(hosts: &[&str]) -> Targets {
        Targets::new(&hosts.iter().map(|host| host.parse().expect("a host")).collect::<Vec<_>>())
    }

    #[test]
    fn only_listed_hosts_are_allowed_and_by_their_scheme_and_port() {
        let targets =
            targets(&["hooks.example", "other.example:8443", "http://plain.example:81", "10.0.0.5", "[fd00::1]"]);
        for good in "https://hooks.example/x?y=1 https://HOOKS.example:443/ https://other.example:8443/ \
                     http://plain.example:81/ https://10.0.0.5/a https://[fd00::1]/a"
            .split(' ')
        {
            assert!(targets.check(good).is_ok(), "{good}: {:?}", targets.check(good));
        }
        for bad in "http://hooks.example/ https://hooks.example:444/ https://hooks.example.evil/ \
                    https://evil@hooks.example/ https://user:pw@hooks.example/ https://hooks.example@evil/ \
                    https://other.example/ ftp://hooks.example/ file:///etc/passwd /etc/passwd hooks.example \
                    https://167772165.evil/ https://10.0.0.6/"
            .split(' ')
            .chain([""])
        {
            assert!(targets.check(bad).is_err(), "{bad}");
        }
        assert!(Targets::default().check("https://hooks.example/").is_err(), "nobody is allowed by default");
        for wrong in ["", "a/b", "https://a/", "http://u@a", "a?b", "ftp://a"] {
            assert!(wrong.parse::<WebhookHost>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn addresses_of_private_networks_are_reached_only_when_they_are_listed() {
        let targets = targets(&["hooks.example", "10.0.0.5"]);
        let may = |text: &str| targets.may_reach(text.parse().expect("an address"));
        for public in "1.1.1.1 93.184.216.34 2606:4700::1111 64:ff9b::101:101 10.0.0.5 ::ffff:10.0.0.5".split(' ') {
            assert!(may(public), "{public}");
        }
        for private in "127.0.0.1 10.0.0.6 172.16.0.1 192.168.1.1 169.254.169.254 100.64.0.1 0.0.0.0 224.0.0.1 \
                        255.255.255.255 198.18.0.1 192.0.0.8 192.0.2.1 198.51.100.1 203.0.113.1 ::1 :: fe80::1 \
                        fd00::1 ff02::1 ::ffff:127.0.0.1 64:ff9b::7f00:1 2002:7f00:1:: 2001::1 2001:db8::1 3fff::1 \
                        ::7f00:1"
            .split(' ')
        {
            assert!(!may(private), "{private}");
        }
    }
}
