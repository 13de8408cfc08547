//! What HTTP asks of a service: heads that are not valid, headers of answers, and what is logged about requests.

use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;

use serde_json::Value;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Extras, Server, Settings, TokenFile};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

use crate::support::*;

/// Sends a head and gives the answer until the connection closes.
async fn raw(service: &Service, head: &str) -> String {
    let mut stream = tokio::net::TcpStream::connect(service.address).await.expect("connected");
    stream.write_all(head.as_bytes()).await.expect("sent");
    let mut answer = Vec::new();
    let _ = tokio::time::timeout(PATIENCE, stream.read_to_end(&mut answer)).await.expect("it closes");
    String::from_utf8(answer).expect("text")
}

#[tokio::test]
async fn heads_that_are_not_valid_or_not_supported_are_refused() {
    let service = Service::start().await;
    let long = "x".repeat(70_000);
    let many = (0..200).map(|number| format!("x-{number}: y\r\n")).collect::<String>();
    // with a problem document where hyper reads the head, which refuses others by itself
    for (head, status, has_problem) in [
        ("GET /healthz HTTP/1.1\r\n\r\n", "400 ", true),
        ("GET /healthz HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", "400 ", true),
        ("GET /healthz HTTP/1.1\r\nHost: a b\r\n\r\n", "400 ", true),
        ("GET /healthz HTTP/1.1\r\nHost: u@a\r\n\r\n", "400 ", true),
        ("GET /healthz HTTP/1.1\r\nHost: u:p@a:80\r\n\r\n", "400 ", true),
        ("POST /v1/jobs HTTP/1.1\r\nHost: [::1]\r\nTransfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n", "501 ", true),
        // without chunked at the end, nothing says where the body ends
        ("POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: gzip\r\n\r\n", "400 ", false),
        ("GET / nonsense\r\n\r\n", "400 ", false),
        (&format!("GET /{long} HTTP/1.1\r\nHost: localhost\r\n\r\n"), "414 ", false),
        (&format!("GET / HTTP/1.1\r\nHost: localhost\r\n{many}\r\n"), "431 ", false),
    ] {
        let answer = raw(&service, head).await;
        let start = &head[..head.len().min(60)];
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{start}: {answer}");
        let (headers, body) = answer.split_once("\r\n\r\n").expect("a body");
        if !has_problem {
            assert!(headers.contains("content-length: 0") && body.is_empty(), "{start}: {answer}");
            continue;
        }
        assert!(headers.contains("content-type: application/problem+json"), "{start}: {answer}");
        let problem: Value = serde_json::from_str(body).expect("JSON");
        assert_eq!(format!("{} ", problem["status"]), status, "{start}: {body}");
    }
    for head in
        ["GET /healthz HTTP/1.0\r\n\r\n", "GET /healthz HTTP/1.1\r\nHost: localhost:80\r\nConnection: close\r\n\r\n"]
    {
        let answer = raw(&service, head).await;
        assert!(answer.contains(" 200 OK"), "{answer}");
    }
}

#[tokio::test]
async fn long_queries_are_refused_at_every_path_and_short_ones_are_read() {
    let service = Service::start().await;
    let query = |parameters: usize| (0..parameters).map(|at| format!("a{at}=1")).collect::<Vec<_>>().join("&");
    for path in ["/v1/jobs", "/v1/formats", "/healthz", "/no"] {
        let many = service.get(&format!("{path}?{}", query(65)));
        let detail = refused(many, 422, "invalid-parameter").await;
        assert!(detail.contains("limit of 64") && detail.ends_with(": 65"), "{detail}");
        let long = service.post(&format!("{path}?a={}", "x".repeat(8191))).body(sphere(300));
        let detail = refused(long, 414, "uri-too-long").await;
        assert!(detail.contains("limit of 8192") && detail.contains("form") && detail.ends_with(": 8193"), "{detail}");
    }
    let read = |query: String| service.get(&format!("/v1/jobs?{query}"));
    let detail = refused(read(query(64)), 422, "invalid-parameter").await;
    assert!(detail.contains("unknown field") && detail.contains("a0"), "{detail}");
    let detail = refused(read(format!("cursor={}", "x".repeat(8185))), 422, "invalid-parameter").await;
    assert!(detail.contains("cursor"), "{detail}");
    assert_eq!(read("&".repeat(8192)).send().await.expect("answered").status(), 200);
}

#[tokio::test]
async fn readiness_tells_paths_to_the_operator_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tokens.json");
    let [tenant, operator] = ["tenant", "operator"].map(|name| {
        let made = TokenFile::change(&path, |file| {
            let token = file.add(name)?;
            file.tenants.get_mut(name).expect("just made").metrics = name == "operator";
            Ok(token.reveal())
        });
        made.expect("made")
    });
    let tokens = path.clone();
    let service = Service::with(|settings| settings.access.tokens = Some(tokens), Box::new(CpuDevice::new())).await;
    std::fs::remove_file(&path).expect("removed");
    let ready = async |token: &str| service.get("/readyz").bearer_auth(token).send().await.expect("answered");
    until(async || ready("").await.text().await.expect("text").contains("degraded")).await;
    let detail = async |token: &str| {
        let body: Value = ready(token).await.json().await.expect("JSON");
        assert_eq!(body["conditions"][0]["part"], "tokens");
        text(&body["conditions"][0]["detail"]).to_owned()
    };
    for anybody in ["", "x", tenant.as_str()] {
        assert!(!detail(anybody).await.contains('/'), "{anybody}");
    }
    assert!(detail(&operator).await.contains("tokens.json"));
}

#[tokio::test]
async fn jobs_are_taken_while_the_service_drains() {
    let mut service = Service::with(|settings| settings.drain_delay = 3600, Box::new(CpuDevice::new())).await;
    service.ask_to_stop();
    until(async || service.get("/readyz").send().await.expect("answered").status() == 503).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
}

#[tokio::test]
async fn the_system_keeps_many_connections_until_they_are_accepted() {
    let settings = Settings { listen: ([127, 0, 0, 1], 0).into(), ..Settings::default() };
    // it accepts none before it runs
    let server =
        Server::bind(settings, Box::new(CpuDevice::new()), description(), Extras::default()).await.expect("bound");
    let address = server.address();
    let connected = tokio::task::spawn_blocking(move || {
        let connect = |_| TcpStream::connect_timeout(&address, Duration::from_secs(60));
        (0..300).map(connect).collect::<Result<Vec<_>, _>>().map(|streams| streams.len())
    });
    assert_eq!(connected.await.expect("no panic").expect("connected"), 300);
}

#[tokio::test]
async fn requests_are_logged_with_the_address_behind_trusted_proxies() {
    // the service runs on this thread, as the test does
    let log = Log::default();
    let lines = tracing_subscriber::fmt().json().with_current_span(false).with_writer(log.clone());
    let _logging = tracing::subscriber::set_default(lines.with_max_level(tracing::Level::INFO).finish());
    let proxies = vec!["127.0.0.0/8".parse().expect("a network")];
    let service =
        Service::with(|settings| settings.traffic.trusted_proxies = proxies, Box::new(CpuDevice::new())).await;
    let request = service.obj("clusters=5", sphere(300));
    let trace = |digit: &str| format!("00-{}-b7ad6b7169203331-01", digit.repeat(32));
    let request = request.header("x-forwarded-for", "203.0.113.9, 198.51.100.7").header("traceparent", trace("1"));
    let job = json(request).await;
    service.ended(&job).await;
    let large = service.submit("clusters=5&quality=fast", sphere(70_000)).await;
    service.ended(&large).await;
    let streamed = service.get(text(&large["urls"]["labels"])).header("traceparent", trace("2"));
    let streamed = streamed.header("accept", "application/x-npy").send().await.expect("answered");
    let length = streamed.headers()["content-length"].to_str().expect("text").to_owned();
    streamed.bytes().await.expect("bytes");
    service.get("/healthz").send().await.expect("answered");
    assert_eq!(service.delete(path(&job)).send().await.expect("answered").status(), 204);
    until(async || log.lines("tesserae::access").iter().any(|line| line["fields"]["status"] == 204)).await;

    let lines = log.lines("tesserae::access");
    // what is known of the answer, and the span of its request
    let parts = |line: &Value| (line["fields"].clone(), line["spans"][0].clone());
    let of = |id: &str| {
        let found = lines.iter().find(|line| line["spans"][0]["trace"] == *id.repeat(32));
        parts(found.unwrap_or_else(|| panic!("no {id}: {lines:#?}")))
    };
    let (created, request) = of("1");
    assert_eq!((&request["client"], &created["status"]), (&"198.51.100.7".into(), &202.into()), "{created} {request}");
    assert_eq!(
        (&created["location"], &request["tenant"]),
        (&path(&job).into(), &"local".into()),
        "{created} {request}"
    );
    assert!(created["latency_ms"].as_f64().expect("a number") > 0.0, "{created}");
    assert_eq!(of("2").0["bytes"].to_string(), length, "of the answer");
    let (_, request) = parts(lines.iter().find(|line| line["fields"]["status"] == 204).expect("a line"));
    assert_eq!((&request["method"], &request["path"]), (&"DELETE".into(), &path(&job).into()));
    assert_eq!(request["client"], "127.0.0.1");
    assert!(lines.iter().all(|line| line["spans"][0]["path"] != "/healthz"), "probes have no line");
    assert!(lines.iter().all(|line| line.get("span").is_none()), "a span is written once: {lines:#?}");
}

#[tokio::test]
async fn a_change_is_made_and_logged_to_its_end_when_its_client_hangs_up() {
    let log = Log::default();
    let lines = tracing_subscriber::fmt().json().with_current_span(false).with_writer(log.clone());
    let _logging = tracing::subscriber::set_default(lines.with_max_level(tracing::Level::INFO).finish());
    let service = Service::start().await;
    let send = async |head: String, body: &[u8], milliseconds: u64| {
        let mut stream = tokio::net::TcpStream::connect(service.address).await.expect("connected");
        stream.write_all(head.as_bytes()).await.expect("sent");
        // the service may refuse the rest
        let _ = stream.write_all(body).await;
        tokio::time::sleep(Duration::from_millis(milliseconds)).await;
    };
    let answered = |method: &str, status: u64| {
        let mut lines = log.lines("tesserae::access");
        lines.retain(|line| line["spans"][0]["method"] == method && line["fields"]["status"] == status);
        lines
    };
    // larger than what the store keeps
    let mesh = sphere(20_000);
    for _ in 0..30 {
        let head = format!(
            "POST /v1/jobs?clusters=2&quality=fast HTTP/1.1\r\nHost: localhost\r\nContent-Type: model/obj\r\n\
             Content-Length: {}\r\n\r\n",
            mesh.len()
        );
        send(head, &mesh, 0).await;
    }
    until(async || answered("POST", 202).len() + answered("POST", 400).len() == 30).await;
    let paths: Vec<Value> = answered("POST", 202).into_iter().map(|line| line["fields"]["location"].clone()).collect();
    for path in &paths {
        service.ended(&serde_json::json!({ "urls": { "self": path } })).await;
    }
    service.keeps_no("uploads").await;
    let jobs = async || json(service.get("/v1/jobs")).await["jobs"].as_array().map_or(0, Vec::len);
    assert_eq!(jobs().await, paths.len());
    // the first may not begin before their connections end
    for (milliseconds, path) in (0..).zip(&paths) {
        send(format!("DELETE {} HTTP/1.1\r\nHost: localhost\r\n\r\n", text(path)), b"", milliseconds).await;
    }
    until(async || jobs().await + answered("DELETE", 204).len() == paths.len()).await;
    assert!(!answered("DELETE", 204).is_empty());
}

/// A client chooses how long its upload says it is.
#[tokio::test]
async fn an_upload_that_says_it_is_too_long_logs_no_error() {
    let log = Log::default();
    let lines = tracing_subscriber::fmt().json().with_current_span(false).with_writer(log.clone());
    let _logging = tracing::subscriber::set_default(lines.with_max_level(tracing::Level::INFO).finish());
    let (device, _gate) = Held::behind_gate();
    let data = Arc::new(tempfile::tempdir().expect("a folder"));
    let disk = rustix::fs::statvfs(data.path()).expect("known");
    // less than what is on the disk
    let limit = |settings: &mut Settings| settings.storage.min_free_bytes = disk.f_blocks * disk.f_frsize - (50 << 20);
    let service = Service::on(data, limit, device, None, Extras::default()).await;
    assert_eq!(service.get("/readyz").send().await.expect("answered").status(), 503, "from the first answer on");
    let post = |bytes: usize| service.obj("clusters=5", vec![b' '; bytes]);
    // with their results, five times as many bytes
    let detail = refused(post(11 << 20), 413, "too-large").await;
    assert!(detail.contains("57671680"), "{detail}");
    refused(post(9 << 20), 507, "insufficient-storage").await;
    until(async || log.lines("tesserae::access").len() == 2).await;
    let errors: Vec<Value> = log.lines("tesserae_service::guard::problem");
    assert!(errors.is_empty(), "{errors:#?}");
}

#[tokio::test]
async fn a_long_path_is_not_sent_back_whole() {
    let service = Service::start().await;
    let long = "x".repeat(6000);
    for path in [format!("/{long}"), format!("/v1/jobs/{long}"), format!("/v1/jobs/%ff{long}")] {
        let answer = service.get(&path).send().await.expect("answered");
        assert_eq!(answer.status(), 404);
        let body = answer.text().await.expect("text");
        assert!(body.len() < 2000, "{body}");
        let problem: Value = serde_json::from_str(&body).expect("JSON");
        assert_eq!(text(&problem["instance"]), &path[..256]);
    }
}
