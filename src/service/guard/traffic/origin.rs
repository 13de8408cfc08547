//! Which address a request comes from, also when proxies pass it on.
//!
//! The other end of a connection is known; what `X-Forwarded-For` says is believed of the operator's own proxies only
//! (`--trusted-proxies`), each of which appends the address that it was connected from. So the list is read from its
//! end, and the first address that is no such proxy is the client's.

use std::net::{IpAddr, SocketAddr};

use axum::extract::{ConnectInfo, Request};
use axum::http::{HeaderMap, HeaderValue};
use ipnet::IpNet;

pub(crate) fn is_proxy(address: IpAddr, proxies: &[IpNet]) -> bool {
    proxies.iter().any(|network| network.contains(&address))
}

pub(crate) fn client(request: &Request, proxies: &[IpNet]) -> IpAddr {
    let info = request.extensions().get::<ConnectInfo<SocketAddr>>();
    let peer = info.map_or(IpAddr::from([0, 0, 0, 0]), |ConnectInfo(address)| address.ip());
    behind(peer.to_canonical(), request.headers(), proxies)
}

/// The address behind `peer`. An entry that is no address ends the list: the proxy before it is then the client.
fn behind(peer: IpAddr, headers: &HeaderMap, proxies: &[IpNet]) -> IpAddr {
    let mut client = peer;
    let lines: Vec<&[u8]> = headers.get_all("x-forwarded-for").iter().map(HeaderValue::as_bytes).collect();
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

    #[test]
    fn only_trusted_proxies_are_believed() {
        let proxies = ["10.0.0.0/8", "127.0.0.1/32"].map(|network| network.parse().expect("a network"));
        for (peer, lines, expected) in [
            // a client says what it likes
            ("203.0.113.7", &["1.2.3.4"][..], "203.0.113.7"),
            ("127.0.0.1", &[], "127.0.0.1"),
            ("127.0.0.1", &["1.2.3.4"], "1.2.3.4"),
            ("127.0.0.1", &["9.9.9.9, 1.2.3.4, 10.1.1.1"], "1.2.3.4"),
            ("127.0.0.1", &["9.9.9.9", "1.2.3.4", "10.1.1.1"], "1.2.3.4"),
            ("10.0.0.2", &["[2001:db8::1]:443"], "2001:db8::1"),
            ("10.0.0.2", &["1.2.3.4:5678"], "1.2.3.4"),
            ("10.0.0.2", &["1.2.3.4, unknown"], "10.0.0.2"),
            ("10.0.0.2", &["6.6.6.6", "\u{ff}, 1.2.3.4"], "1.2.3.4"),
            // an unreadable entry ends the list
            ("10.0.0.2", &["6.6.6.6", "1.2.3.4, \u{ff}"], "10.0.0.2"),
            // a proxy may be a client itself
            ("10.0.0.2", &["10.0.0.3"], "10.0.0.3"),
        ] {
            let mut headers = HeaderMap::new();
            for line in lines {
                headers.append("x-forwarded-for", HeaderValue::from_bytes(line.as_bytes()).expect("a value"));
            }
            let client = behind(peer.parse().expect("an address"), &headers, &proxies);
            assert_eq!(client.to_string(), expected, "{peer} {lines:?}");
        }
    }
}
