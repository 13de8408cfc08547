//! Requests are answered in time in proportion to their bytes, at every route.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::Duration;

use tempfile::TempDir;
use tesserae_mesh::dev::sample::Sample;
use tesserae_mesh::device::Device;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::mesh::Format;
use tesserae_service::{DeviceDescription, Extras, Server, Settings, openapi_yaml};
use tokio::runtime::Runtime;
use tokio::sync::oneshot;

use crate::inputs::{BODIES, HEADERS, Head, TARGETS};
use crate::make::sample;
use crate::measure::{BOUND, Cost, SIZES, alone, check, of_process};

/// Longer than any answer takes on a slow machine.
const PATIENCE: Duration = Duration::from_secs(180);

/// Bytes of targets: hyper reads up to 65,534.
const TARGET_BYTES: [usize; 2] = [4000, 64_000];

/// Bytes of headers: hyper reads up to some 400 KiB.
const HEADER_BYTES: [usize; 2] = [24_000, 384_000];

/// A service, and a job that succeeded.
struct Service {
    address: SocketAddr,
    job: String,
    /// Stops the service when it is dropped, before the runtime.
    _stop: oneshot::Sender<()>,
    _runtime: Runtime,
    _data: TempDir,
}

impl Service {
    fn start() -> Self {
        let data = tempfile::tempdir().expect("a folder");
        let mut settings = Settings {
            listen: SocketAddr::from(([127, 0, 0, 1], 0)),
            data_dir: Some(data.path().to_owned()),
            ..Settings::default()
        };
        settings.traffic.trusted_proxies = vec!["127.0.0.0/8".parse().expect("a network")];
        let device: Box<dyn Device> = Box::new(CpuDevice::new());
        let description = DeviceDescription {
            info: device.info().clone(),
            chosen: "by the test".to_owned(),
            cpu_below_faces: None,
            adapters: Vec::new(),
        };
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.expect("a runtime");
        let server = runtime.block_on(Server::bind(settings, device, description, Extras::default()));
        let server = server.expect("bound");
        let (address, (stop, stopped)) = (server.address(), oneshot::channel());
        runtime.spawn(server.run(async {
            let _ = stopped.await;
        }));
        let mut service = Self { address, job: String::new(), _stop: stop, _runtime: runtime, _data: data };
        let mesh = sample(Sample::Sphere, Format::Obj, 20_000);
        let head = "Content-Type: model/obj\r\nPrefer: wait=60\r\n";
        let answer = service.exchange("POST", "/v1/jobs?algorithm=hr&clusters=4&keep_mesh=true", head, &mesh);
        assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
        let job = answer.split_once("location: /v1/jobs/").and_then(|(_, rest)| rest.split_once("\r\n"));
        service.job = job.expect("a location").0.to_owned();
        service
    }

    /// Sends a request and gives the answer. A service that refuses may close before it has read all.
    fn exchange(&self, method: &str, target: &str, headers: &str, body: &[u8]) -> String {
        let mut stream = TcpStream::connect(self.address).expect("connected");
        stream.set_read_timeout(Some(PATIENCE)).expect("set");
        let length = match headers.contains("chunked") {
            true => String::new(),
            false => format!("Content-Length: {}\r\n", body.len()),
        };
        let head =
            format!("{method} {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{length}{headers}\r\n");
        let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body));
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let _ = stream.shutdown(Shutdown::Both);
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// Processor time of a request.
    fn cost(&self, method: &str, target: &str, headers: &str, body: &[u8]) -> Duration {
        of_process(|| {
            let answer = self.exchange(method, target, headers, body);
            // a connection that was reset has lost it
            assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 "), "{method} {target:.99}: {answer}");
            assert!(!answer.starts_with("HTTP/1.1 5") || answer.starts_with("HTTP/1.1 501"), "{target:.99}: {answer}");
        })
    }

    /// Methods and paths of all routes; those that change something are about a job that is not there.
    fn routes(&self) -> Vec<(String, String)> {
        let document = openapi_yaml().expect("a document");
        let mut routes = Vec::new();
        let mut path = "";
        for line in document.lines() {
            let name = line.trim().trim_end_matches(':');
            if line.starts_with("  /") {
                path = name;
            } else if line.starts_with("    ")
                && ["get", "post", "delete"].contains(&name)
                && !line.starts_with("     ")
            {
                let id = if name == "get" { &self.job } else { "00000000-0000-4000-8000-000000000000" };
                routes.push((name.to_uppercase(), path.replace("{id}", id)));
            }
        }
        assert!(routes.len() > 25, "{routes:?}");
        routes.push(("GET".to_owned(), "/".to_owned()));
        routes.push(("OPTIONS".to_owned(), "/v1/jobs".to_owned()));
        routes
    }
}

/// Costs of requests with such heads at every route.
fn costs(service: &Service, heads: &[(&str, Head)], sizes: [usize; 2]) -> Vec<(String, Cost)> {
    let mut costs = Vec::new();
    for (method, path) in service.routes() {
        for (name, head) in heads {
            let whole = |bytes: usize| head(bytes).join("\0").into_bytes();
            let cost = Cost::of(sizes, BOUND, whole, |head| {
                let head = std::str::from_utf8(head).expect("text");
                let (target, headers) = head.split_once('\0').expect("two parts");
                service.cost(&method, &format!("{path}{target}"), headers, b"")
            });
            costs.push((format!("{method} {path}: {name}"), cost));
        }
    }
    costs
}

#[test]
fn targets_of_requests_cost_in_proportion_to_their_bytes() {
    let (_alone, service) = (alone(), Service::start());
    check(costs(&service, TARGETS, TARGET_BYTES), BOUND);
    check(costs(&service, TARGETS, SIZES), BOUND);
}

#[test]
fn headers_of_requests_cost_in_proportion_to_their_bytes() {
    let (_alone, service) = (alone(), Service::start());
    check(costs(&service, HEADERS, HEADER_BYTES), BOUND);
    check(costs(&service, HEADERS, SIZES), BOUND);
}

#[test]
fn bodies_of_requests_cost_in_proportion_to_their_bytes() {
    let (_alone, service) = (alone(), Service::start());
    let costs = BODIES.iter().map(|&(name, headers, make)| {
        let cost = Cost::of(SIZES, BOUND, make, |body| service.cost("POST", "/v1/jobs?clusters=1", headers, body));
        (name.to_owned(), cost)
    });
    check(costs, BOUND);
}
