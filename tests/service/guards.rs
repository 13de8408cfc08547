//! Guards: requests of web pages of other sites are refused, and probes for liveness are answered whatever happens.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use reqwest::RequestBuilder;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Extras, FaultPoint, Faults, Settings, TokenFile};

use crate::support::*;

async fn with(change: impl FnOnce(&mut Settings)) -> Service {
    Service::with(change, Box::new(CpuDevice::new())).await
}

/// A request for a job with these headers.
fn submitting(service: &Service, headers: &[(&str, &str)]) -> RequestBuilder {
    let request = service.obj("clusters=5", sphere(300));
    headers.iter().fold(request, |request, (name, value)| request.header(*name, *value))
}

async fn status(request: RequestBuilder) -> u16 {
    request.send().await.expect("answered").status().as_u16()
}

#[tokio::test]
async fn without_tokens_no_name_reaches_the_service() {
    let service = Service::start().await;
    let port = service.address.port();
    for path in ["/", "/healthz", "/readyz", "/v1/jobs", "/metrics"] {
        let detail = refused(service.get(path).header("host", "evil.example"), 421, "misdirected").await;
        assert!(detail.contains("--tokens") && detail.contains("--insecure-no-auth"), "{detail}");
        assert!(detail.ends_with("\"evil.example\""), "{detail}");
    }
    refused(submitting(&service, &[("host", "evil.example")]), 421, "misdirected").await;
    for host in [format!("localhost:{port}"), format!("127.0.0.1:{port}"), format!("[::1]:{port}"), "10.1.2.3".into()] {
        assert_eq!(status(service.get("/v1/jobs").header("host", host)).await, 200);
    }
    // a target that is a whole URI stands in place of Host
    for (target, expected) in [("http://evil.example", "421 "), ("http://127.0.0.1", "200 ")] {
        let head = format!("GET {target}/healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n");
        let answer =
            tokio::task::spawn_blocking(move || whole(ask(service.address, &[&head]))).await.expect("no panic");
        assert!(answer.starts_with(&format!("HTTP/1.1 {expected}")), "{answer}");
    }

    let named = with(|settings| settings.access.insecure_no_auth = true).await;
    assert_eq!(status(named.get("/v1/jobs").header("host", "mesh.example")).await, 200);
    let (file, token) = token();
    let path = file.path().to_owned();
    let guarded = with(|settings| settings.access.tokens = Some(path)).await;
    assert_eq!(status(guarded.get("/v1/jobs").bearer_auth(&token).header("host", "mesh.example")).await, 200);
}

#[tokio::test]
async fn without_tokens_pages_of_other_origins_change_nothing() {
    for is_insecure in [false, true] {
        let service = with(|settings| settings.access.insecure_no_auth = is_insecure).await;
        let own = format!("http://{}", service.address);
        let job = service.submit("clusters=5", sphere(300)).await;
        service.ended(&job).await;
        for headers in [
            &[("origin", "https://evil.example")][..],
            &[("origin", "null")],
            &[("origin", "http://127.0.0.1:1")],
            &[("sec-fetch-site", "cross-site")],
            &[("origin", "https://evil.example"), ("sec-fetch-site", "cross-site")],
            &[("origin", "http://127.0.0.1:1"), ("sec-fetch-site", "same-site")],
        ] {
            let detail = refused(submitting(&service, headers), 403, "foreign-origin").await;
            assert!(detail.contains("--tokens"), "{detail}");
            let delete = service.delete(path(&job));
            let delete = headers.iter().fold(delete, |request, (name, value)| request.header(*name, *value));
            refused(delete, 403, "foreign-origin").await;
            // they cannot read what they get
            assert_eq!(status(service.get(path(&job)).header("origin", "https://evil.example")).await, 200);
        }
        let jobs = json(service.get("/v1/jobs")).await;
        assert_eq!(jobs["jobs"].as_array().map(Vec::len), Some(1), "{jobs}");
        for headers in [
            &[][..],
            &[("origin", own.as_str())],
            &[("origin", own.as_str()), ("sec-fetch-site", "same-origin")],
            // through a proxy that changes Host
            &[("origin", "https://mesh.example"), ("sec-fetch-site", "same-origin")],
        ] {
            assert_eq!(status(submitting(&service, headers)).await, 202, "{headers:?}");
        }
        assert_eq!(status(service.delete(path(&job)).header("origin", own.as_str())).await, 204);
    }
    let (file, token) = token();
    let path = file.path().to_owned();
    let guarded = with(|settings| settings.access.tokens = Some(path)).await;
    let foreign = [("origin", "https://evil.example"), ("sec-fetch-site", "cross-site")];
    assert_eq!(status(submitting(&guarded, &foreign).bearer_auth(&token)).await, 202);
}

/// A file of tokens, and a token in it.
fn token() -> (tempfile::NamedTempFile, String) {
    let mut file = TokenFile::default();
    let token = file.add("acme").expect("a token").reveal();
    let on_disk = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(on_disk.path(), serde_json::to_vec(&file).expect("JSON")).expect("written");
    (on_disk, token)
}

/// A connection on which a head was sent in pieces.
fn ask(address: SocketAddr, pieces: &[&str]) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("connected");
    stream.set_nodelay(true).expect("set");
    stream.set_read_timeout(Some(PATIENCE)).expect("set");
    for piece in pieces {
        stream.write_all(piece.as_bytes()).expect("sent");
    }
    stream
}

fn whole(mut stream: TcpStream) -> String {
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("answered in time");
    answer
}

/// Ends the wait when the test fails: the runtime ends with its threads only.
struct Disarm(Faults);

impl Drop for Disarm {
    fn drop(&mut self) {
        self.0.disarm();
    }
}

#[test]
fn liveness_is_answered_while_all_threads_that_answer_requests_are_blocked() {
    const THREADS: usize = 2;
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(THREADS).enable_all().build();
    let runtime = runtime.expect("a runtime");
    let faults = Faults::default();
    let service = runtime.block_on(async {
        let extras = Extras { faults: faults.clone(), ..Extras::default() };
        let data = Arc::new(tempfile::tempdir().expect("a folder"));
        Service::on(data, |_| {}, Box::new(CpuDevice::new()), None, extras).await
    });
    let held = || faults.waiting(FaultPoint::Request);
    let _disarmed = Disarm(faults.clone());
    faults.hold(FaultPoint::Request);
    let started = Instant::now();
    let mut blocked = Vec::new();
    while held() < THREADS {
        assert!(started.elapsed() < PATIENCE, "{} threads wait", held());
        blocked.push(ask(service.address, &["GET /v1/version HTTP/1.0\r\n\r\n"]));
        std::thread::sleep(Duration::from_millis(20));
    }
    let all_blocked = Instant::now();
    let twice = "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\nGET /v1/version HTTP/1.1\r\nHost: localhost\r\n\r\n";
    assert_eq!(
        whole(ask(service.address, &[twice])).matches("HTTP/1.1 ").count(),
        1,
        "no other request is served there"
    );
    let liveness = ["GET /healthz HTTP/1.1\r\n", "Host: 127.0.0.1\r\n\r\n"];
    let mut answers = 0;
    // long enough to be seen in the metric
    while all_blocked.elapsed() < Duration::from_secs(1) || answers < 2 {
        let answer = whole(ask(service.address, &liveness));
        assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.ends_with("{\"status\":\"ok\"}"), "{answer}");
        answers += 1;
    }
    let lag = all_blocked.elapsed();
    assert_eq!(held(), THREADS, "they waited all the time");
    faults.disarm();
    for stream in blocked {
        assert!(whole(stream).contains(" 200 OK"));
    }
    runtime.block_on(async {
        let late = async || metric(&service, "tesserae_request_thread_lag_seconds_sum").await;
        until(async || late().await > (lag - Duration::from_millis(250)).as_secs_f64()).await;
    });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn liveness_is_answered_while_there_is_no_place_for_another_connection() {
    let service = with(|settings| settings.traffic.constants.connections = 2).await;
    let address = service.address;
    let answered = |request: &str| {
        let mut answer = Vec::new();
        // a connection without a place is closed or reset
        let _ = ask(address, &[request]).read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    };
    let of_others = "GET /readyz HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let kept = [(); 2].map(|()| {
        let mut stream = ask(address, &[of_others]);
        stream.read_exact(&mut [0; 12]).expect("answered, and kept open");
        stream
    });
    assert_eq!(answered(of_others), "", "there is no place");
    for (request, status) in [
        ("GET /healthz HTTP/1.1\r\nHost: [::1]\r\n\r\n", "200"),
        ("HEAD /healthz HTTP/1.1\r\nHost: [::1]\r\n\r\n", "200"),
        ("GET /healthz HTTP/1.1\r\nHost: a\r\n\r\n", "421"),
    ] {
        let answer = answered(request);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{request}: {answer}");
    }
    drop(kept);
}
