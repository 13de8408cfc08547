//! Clients that ask for too much, too fast, or too slowly.

use std::io::Write as _;
use std::time::{Duration, Instant};

use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::TrafficSettings;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::support::*;

async fn with(change: impl FnOnce(&mut TrafficSettings)) -> Service {
    Service::with(|settings| change(&mut settings.traffic), Box::new(CpuDevice::new())).await
}

pub fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).expect("written");
    encoder.finish().expect("ended")
}

pub fn zstandard(bytes: &[u8]) -> Vec<u8> {
    zstd::encode_all(bytes, 19).expect("compressed")
}

#[tokio::test]
async fn compressed_uploads_are_the_same_uploads() {
    let service = Service::start().await;
    let plain = service.submit("clusters=5", sphere(300)).await;
    let labels = |job: serde_json::Value| {
        let service = &service;
        async move {
            assert_eq!(service.ended(&job).await["state"], "succeeded", "{job}");
            service.get(&format!("{}/labels", path(&job))).send().await.expect("answered").text().await.expect("text")
        }
    };
    let expected = labels(plain).await;
    for (encoding, body) in [
        ("gzip", gzipped(&sphere(300))),
        ("GZIP", gzipped(&sphere(300))),
        ("zstd", zstandard(&sphere(300))),
        ("identity", sphere(300)),
    ] {
        let job = json(service.obj("clusters=5", body).header("content-encoding", encoding)).await;
        assert_eq!(job["mesh"]["bytes"], sphere(300).len(), "the mesh as it was meant: {job}");
        assert_eq!(labels(job).await, expected, "{encoding}");
    }
    let form = "--b\r\nContent-Disposition: form-data; name=\"mesh\"; filename=\"a.obj\"\r\n\r\n";
    let form = [form.as_bytes(), &sphere(300), b"\r\n--b--\r\n"].concat();
    let request = service.post("/v1/jobs?clusters=5").header("content-type", "multipart/form-data; boundary=b");
    let job = json(request.header("content-encoding", "gzip").body(gzipped(&form))).await;
    assert_eq!(labels(job).await, expected);
}

#[tokio::test]
async fn what_inflates_out_of_proportion_dies_early() {
    let service = Service::start().await;
    let zeros = vec![b'\n'; 64 << 20];
    for (encoding, body) in [("gzip", gzipped(&zeros)), ("zstd", zstandard(&zeros))] {
        assert!(body.len() < 100_000, "{}", body.len());
        for content_type in ["model/obj", "multipart/form-data; boundary=b"] {
            let request = service.post("/v1/jobs?clusters=5").header("content-type", content_type);
            let response =
                request.header("content-encoding", encoding).body(body.clone()).send().await.expect("answered");
            let status = response.status();
            let text = response.text().await.expect("text");
            assert!(status == 413 || (status == 400 && content_type.starts_with("multi")), "{text}");
        }
    }
    // within the proportion, but more than an upload may have
    let small = Service::with(|settings| settings.max_upload_bytes = 100_000, Box::new(CpuDevice::new())).await;
    let noise: Vec<u8> =
        (0..20_000u32).flat_map(|n| format!("# {}\n", n.wrapping_mul(2_654_435_761)).into_bytes()).collect();
    let detail =
        refused(small.obj("clusters=5", zstandard(&noise)).header("content-encoding", "zstd"), 413, "too-large").await;
    assert!(detail.contains("100000"), "{detail}");
    service.keeps_no("").await;
    small.keeps_no("").await;
}

#[tokio::test]
async fn what_is_not_as_it_says_to_be_compressed_is_refused() {
    let service = Service::start().await;
    let whole = gzipped(&sphere(300));
    let mut changed = whole.clone();
    let last = changed.len() - 6;
    changed[last] ^= 1;
    let wide = {
        // a window that no decoder needs to have
        let mut encoder = zstd::Encoder::new(Vec::new(), 3).expect("an encoder");
        encoder.window_log(27).expect("a window");
        encoder.write_all(&sphere(30_000)).expect("written");
        encoder.finish().expect("ended")
    };
    for (encoding, body) in [
        ("gzip", sphere(300)),
        ("zstd", sphere(300)),
        ("gzip", whole[..whole.len() / 2].to_vec()),
        ("gzip", changed),
        ("zstd", zstandard(&sphere(300))[..200].to_vec()),
        ("zstd", wide),
    ] {
        let detail =
            refused(service.obj("clusters=5", body).header("content-encoding", encoding), 400, "bad-request").await;
        assert!(detail.contains("Content-Encoding"), "{detail}");
    }
    for encoding in ["br", "gzip, gzip", "deflate", "magic"] {
        let response =
            service.obj("clusters=5", sphere(300)).header("content-encoding", encoding).send().await.expect("answered");
        assert_eq!(response.headers()["accept-encoding"], "gzip, zstd, identity");
        problem(response, 415, "unsupported-media-type").await;
    }
    service.keeps_no("").await;
}

#[tokio::test]
async fn a_client_has_so_many_requests_and_streams_at_a_time() {
    let (device, gate) = Held::behind_gate();
    let change = |traffic: &mut TrafficSettings| {
        traffic.constants.requests_at_once = 2;
        traffic.constants.streams_per_client = 3;
        traffic.constants.streams = 2;
    };
    let service = Service::with(|settings| change(&mut settings.traffic), device).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    let events = format!("{}/events", path(&job));
    let mut streams = Vec::new();
    for _ in 0..2 {
        let response = service.get(&events).send().await.expect("answered");
        assert_eq!(response.status(), 200);
        streams.push(response);
    }
    let response = service.get(&events).send().await.expect("answered");
    assert!(response.headers().contains_key("retry-after"));
    problem(response, 503, "overloaded").await;
    // two that wait for the end of their jobs are all that may go on at a time
    let waiting = |service: &Service| {
        let request = service.obj("clusters=5", sphere(300)).header("prefer", "wait=60");
        // while somebody looks below, there may be no room for the second
        tokio::spawn(async move {
            loop {
                let again = request.try_clone().expect("its body is in memory");
                let response = again.send().await.expect("answered");
                if response.status() != 429 {
                    return response;
                }
            }
        })
    };
    let waiting = [waiting(&service), waiting(&service)];
    until(async || service.get("/v1/jobs").send().await.expect("answered").status() == 429).await;
    refused(service.get("/v1/jobs"), 429, "rate-limited").await;
    gate.open();
    for answer in waiting {
        assert_eq!(answer.await.expect("no panic").status(), 200);
    }
    for stream in streams {
        assert!(stream.text().await.expect("text").contains("event: end"));
    }
    until(async || service.get(&events).send().await.expect("answered").status() == 200).await;
}

#[tokio::test]
async fn heads_that_do_not_come_close_the_connection() {
    let service = with(|traffic| traffic.constants.header_timeout = Duration::from_secs(1)).await;
    for begun in
        ["", "GET /healthz HTTP/1.1\r\nHost: localhost\r\nX-Slow: ", "GET /readyz HTTP/1.1\r\nHost: localhost\r\n\r\n"]
    {
        let mut stream = TcpStream::connect(service.address).await.expect("connected");
        stream.write_all(begun.as_bytes()).await.expect("sent");
        let started = Instant::now();
        let mut answer = Vec::new();
        let closed = tokio::time::timeout(Duration::from_secs(60), stream.read_to_end(&mut answer)).await;
        closed.expect("the connection is closed").expect("read");
        assert!(started.elapsed() >= Duration::from_millis(900), "{begun:?}");
    }
}

#[tokio::test]
async fn uploads_that_stall_or_drip_are_given_up() {
    let service = with(|traffic| traffic.constants.body_timeout = Duration::from_secs(1)).await;
    let head = "POST /v1/jobs?clusters=2 HTTP/1.1\r\nHost: localhost\r\nContent-Type: model/obj\r\n\
         Content-Length: 100000\r\n\r\n";
    for drips in [false, true] {
        let stream = TcpStream::connect(service.address).await.expect("connected");
        let (mut reader, mut writer) = stream.into_split();
        writer.write_all(head.as_bytes()).await.expect("sent");
        writer.write_all(b"v 0 0 0\n").await.expect("sent");
        let dripping = tokio::spawn(async move {
            while drips && writer.write_all(b"#").await.is_ok() {
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
            writer
        });
        let mut answer = String::new();
        let read = tokio::time::timeout(Duration::from_secs(60), reader.read_to_string(&mut answer)).await;
        let _ = read.expect("the connection is closed");
        assert!(answer.starts_with("HTTP/1.1 408 "), "{answer}");
        assert!(answer.contains(if drips { "bytes a second" } else { "nothing of the upload came" }), "{answer}");
        let _writer = dripping.await.expect("no panic");
        service.keeps_no("").await;
    }
}

#[tokio::test]
async fn answers_that_nobody_takes_are_given_up() {
    let service = with(|traffic| traffic.constants.write_timeout = Duration::from_secs(1)).await;
    let job = service.submit("clusters=5&algorithm=bb", sphere(300_000)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
    let mut stream = TcpStream::connect(service.address).await.expect("connected");
    // much more than the system buffers
    let request = format!("GET {}/labels HTTP/1.1\r\nHost: localhost\r\n\r\n", path(&job)).repeat(20);
    stream.write_all(request.as_bytes()).await.expect("sent");
    let connections = async || metric(&service, "tesserae_connections").await;
    let mut some = [0; 12];
    stream.read_exact(&mut some).await.expect("answered");
    assert_eq!(&some, b"HTTP/1.1 200", "it is open");
    until(async || connections().await < 2.0).await;
    drop(stream);
}

#[tokio::test]
async fn an_address_has_so_many_connections_and_others_are_served() {
    let service = with(|traffic| traffic.constants.connections_per_address = 3).await;
    let mut open = Vec::new();
    for _ in 0..3 {
        let mut stream = TcpStream::connect(service.address).await.expect("connected");
        stream.write_all(b"GET /readyz HTTP/1.1\r\nHost: localhost\r\n\r\n").await.expect("sent");
        let mut some = [0; 12];
        stream.read_exact(&mut some).await.expect("answered");
        assert_eq!(&some, b"HTTP/1.1 200");
        open.push(stream);
    }
    let mut fourth = TcpStream::connect(service.address).await.expect("connected");
    let _ = fourth.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await;
    let mut answer = Vec::new();
    let _ = fourth.read_to_end(&mut answer).await;
    assert!(answer.is_empty(), "{}", String::from_utf8_lossy(&answer));
    open.pop();
    until(async || service.get("/healthz").send().await.is_ok()).await;
}

#[tokio::test]
async fn a_thousand_streams_at_once_cost_little_and_hold_nobody_up() {
    const STREAMS: usize = 1000;
    let files = rlimit::increase_nofile_limit(4096).expect("a limit");
    assert!(files >= 2 * STREAMS as u64 + 100, "both ends of the streams are files of this process: {files}");
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let job = service.submit("clusters=50", sphere(3000)).await;
    service.reaches(&job, "running").await;
    let before = metric(&service, "process_resident_memory_bytes").await;
    let opened = Instant::now();
    let request = format!("GET {}/events HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", path(&job));
    let readers: Vec<_> = (0..STREAMS)
        .map(|_| {
            let (request, address) = (request.clone(), service.address);
            tokio::spawn(async move {
                let mut stream = TcpStream::connect(address).await.expect("connected");
                stream.write_all(request.as_bytes()).await.expect("sent");
                let mut answer = Vec::new();
                stream.read_to_end(&mut answer).await.expect("read");
                String::from_utf8(answer).expect("text")
            })
        })
        .collect();
    until(async || metric(&service, "tesserae_event_streams").await == STREAMS as f64).await;
    let opened = opened.elapsed();
    let asked = Instant::now();
    assert_eq!(service.get(path(&job)).send().await.expect("answered").status(), 200);
    let asked = asked.elapsed();
    let memory = metric(&service, "process_resident_memory_bytes").await - before;
    gate.open();
    let ended = Instant::now();
    let whole =
        service.get(&format!("{}/events", path(&job))).send().await.expect("answered").text().await.expect("text");
    let events = whole.matches("event: ").count();
    for reader in readers {
        let answer = reader.await.expect("no panic");
        assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
        assert_eq!(answer.matches("event: ").count(), events, "every stream has every event");
    }
    println!(
        "{STREAMS} streams: opened in {opened:?}, {:.0} KiB each with both ends, another request took {asked:?}, \
         {events} events to each within {:?} of the start of the job",
        memory / 1024.0 / STREAMS as f64,
        ended.elapsed()
    );
    // buffers of both ends, in this one process
    assert!(memory < 100e6, "{memory}");
    until(async || metric(&service, "tesserae_event_streams").await == 0.0).await;
}
