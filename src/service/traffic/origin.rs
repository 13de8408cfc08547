//! Which address a request comes from, also when proxies pass it on.
//!
//! The other end of a connection is known; what `X-Forwarded-For` says is believed of the operator's own proxies only
//! (`--trusted-proxies`), each of which appends the address that it was connected from. So the list is read from its
//! end, and the first address that is no such proxy is the client's.

use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

use axum::extract::{ConnectInfo, Request};
use axum::http::{HeaderMap, HeaderValue};

/// The header that proxies append to.
const FORWARDED: &str = "x-forwarded-for";

/// Addresses that a proxy may have: `10.0.0.0/8`, `fd00::/8`, or a single address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Network {
    address: IpAddr,
    /// Bits that an address must share with it.
    prefix: u8,
}

impl FromStr for Network {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("a network is an address, or an address, / and the bits of its prefix, not {text:?}");
        let (address, prefix) = match text.split_once('/') {
            Some((address, prefix)) => (address, Some(prefix)),
            None => (text, None),
        };
        let address: IpAddr = address.parse().map_err(|_| wrong())?;
        let bits = if address.is_ipv4() { 32 } else { 128 };
        let prefix = prefix.map_or(Ok(bits), str::parse).map_err(|_| wrong())?;
        if prefix > bits {
            return Err(wrong());
        }
        Ok(Self { address, prefix })
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.address, self.prefix)
    }
}

impl Network {
    /// Whether the address is in the network.
    pub fn contains(&self, address: IpAddr) -> bool {
        let differ = |one: u128, other: u128, bits: u32| {
            let kept = u32::from(self.prefix);
            kept > 0 && (one ^ other) >> (bits - kept) != 0
        };
        match (self.address, address.to_canonical()) {
            (IpAddr::V4(own), IpAddr::V4(other)) => !differ(own.to_bits().into(), other.to_bits().into(), 32),
            (IpAddr::V6(own), IpAddr::V6(other)) => !differ(own.to_bits(), other.to_bits(), 128),
            _ => false,
        }
    }
}

/// Whether an address is that of a proxy.
pub(crate) fn is_proxy(address: IpAddr, proxies: &[Network]) -> bool {
    proxies.iter().any(|network| network.contains(address))
}

/// Address of the client that sent a request.
pub(crate) fn client(request: &Request, proxies: &[Network]) -> IpAddr {
    let info = request.extensions().get::<ConnectInfo<SocketAddr>>();
    let peer = info.map_or(IpAddr::from([0, 0, 0, 0]), |ConnectInfo(address)| address.ip());
    behind(peer.to_canonical(), request.headers(), proxies)
}

/// The address behind `peer`. An entry that is no address ends the list: the proxy before it is then the client.
fn behind(peer: IpAddr, headers: &HeaderMap, proxies: &[Network]) -> IpAddr {
    let mut client = peer;
    let lines: Vec<&[u8]> = headers.get_all(FORWARDED).iter().map(HeaderValue::as_bytes).collect();
    let mut entries = lines.iter().rev().flat_map(|line| line.rsplit(|&byte| byte == b','));
    while is_proxy(client, proxies) {
        let entry = entries.next().and_then(|entry| str::from_utf8(entry).ok());
        let Some(address) = entry.and_then(|entry| address(entry.trim())) else { break };
        client = address;
    }
    client
}

/// Reads an entry: an address, which some proxies write with the port.
fn address(entry: &str) -> Option<IpAddr> {
    let address = entry.parse().or_else(|_| entry.parse().map(|socket: SocketAddr| socket.ip()));
    address.or_else(|_| entry.trim_matches(['[', ']']).parse()).ok().map(|address| address.to_canonical())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn networks(texts: &[&str]) -> Vec<Network> {
        texts.iter().map(|text| text.parse().expect("a network")).collect()
    }

    #[test]
    fn a_network_contains_the_addresses_of_its_prefix() {
        let contains =
            |network: &str, address: &str| networks(&[network])[0].contains(address.parse().expect("an address"));
        for (network, inside, outside) in [
            ("10.0.0.0/8", "10.255.1.2", "11.0.0.0"),
            ("192.168.1.4", "192.168.1.4", "192.168.1.5"),
            ("0.0.0.0/0", "203.0.113.9", "::1"),
            ("fd00::/8", "fdff::1", "fe00::1"),
            ("::/0", "::1", "1.1.1.1"),
            ("10.0.0.0/31", "::ffff:10.0.0.1", "10.0.0.2"),
        ] {
            assert!(contains(network, inside), "{network} {inside}");
            assert!(!contains(network, outside), "{network} {outside}");
        }
        for wrong in ["", "10.0.0.0/33", "::/129", "10.0.0.0/-1", "10.0.0/8", "proxy", "10.0.0.0/"] {
            assert!(wrong.parse::<Network>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn only_trusted_proxies_are_believed() {
        let proxies = networks(&["10.0.0.0/8", "127.0.0.1"]);
        let client = |peer: &str, lines: &[&'static str]| {
            let mut headers = HeaderMap::new();
            for line in lines {
                headers.append(FORWARDED, HeaderValue::from_bytes(line.as_bytes()).expect("a value"));
            }
            behind(peer.parse().expect("an address"), &headers, &proxies).to_string()
        };
        assert_eq!(client("203.0.113.7", &["1.2.3.4"]), "203.0.113.7", "a client says what it likes");
        assert_eq!(client("127.0.0.1", &[]), "127.0.0.1");
        assert_eq!(client("127.0.0.1", &["1.2.3.4"]), "1.2.3.4");
        assert_eq!(
            client("127.0.0.1", &["9.9.9.9, 1.2.3.4, 10.1.1.1"]),
            "1.2.3.4",
            "what it says before is not believed"
        );
        assert_eq!(client("127.0.0.1", &["9.9.9.9", "1.2.3.4", "10.1.1.1"]), "1.2.3.4");
        assert_eq!(client("10.0.0.2", &["[2001:db8::1]:443"]), "2001:db8::1");
        assert_eq!(client("10.0.0.2", &["1.2.3.4:5678"]), "1.2.3.4");
        assert_eq!(client("10.0.0.2", &["1.2.3.4, unknown"]), "10.0.0.2");
        assert_eq!(client("10.0.0.2", &["6.6.6.6", "\u{ff}, 1.2.3.4"]), "1.2.3.4");
        assert_eq!(
            client("10.0.0.2", &["6.6.6.6", "1.2.3.4, \u{ff}"]),
            "10.0.0.2",
            "an unreadable entry ends the list"
        );
        assert_eq!(client("10.0.0.2", &["10.0.0.3"]), "10.0.0.3", "a proxy may be a client itself");
    }
}
