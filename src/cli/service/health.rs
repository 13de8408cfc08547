//! `tesserae health`: whether a service answers, for health checks where there is no curl.

use std::io::{Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream};
use std::time::Duration;

use tesserae_mesh::error::Error;

use crate::Failure;

/// Time to connect, and to answer.
const PATIENCE: Duration = Duration::from_secs(4);

/// Arguments of `tesserae health`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Address and port that the service listens on; of one that listens everywhere, this machine is asked
    #[arg(long, env = "TESSERAE_LISTEN", value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,

    /// Ask whether jobs are taken rather than whether the process answers
    #[arg(long)]
    ready: bool,
}

/// Asks; exit status 0 when all is well.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = if arguments.ready { "/readyz" } else { "/healthz" };
    let mut address = arguments.listen;
    match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => address.set_ip(Ipv4Addr::LOCALHOST.into()),
        IpAddr::V6(ip) if ip.is_unspecified() => address.set_ip(Ipv6Addr::LOCALHOST.into()),
        IpAddr::V4(_) | IpAddr::V6(_) => {}
    }
    let answer = ask(address, path).map_err(|error| Error::io(format_args!("{address} does not answer"), error))?;
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    match head.split(' ').nth(1) {
        Some("200") => Ok(()),
        _ => Err(Error::unavailable(format_args!("{path} says: {}", body.trim())).into()),
    }
}

/// The whole answer to a request.
fn ask(address: SocketAddr, path: &str) -> std::io::Result<String> {
    let mut stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    let mut answer = Vec::new();
    stream.take(1 << 16).read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}
