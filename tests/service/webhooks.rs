//! Ends of jobs that are told, to whom they may be told.

use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;
use tempfile::TempDir;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::Settings;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::sync::mpsc;

use crate::support::*;

const SECRET: &str = "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

/// Takes deliveries and answers them with these statuses, the last one again and again.
async fn receiver(statuses: &'static [u16]) -> (SocketAddr, mpsc::UnboundedReceiver<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("bound");
    let address = listener.local_addr().expect("an address");
    let (told, deliveries) = mpsc::unbounded_channel();
    tokio::spawn(async move {
        for turn in 0.. {
            let (mut stream, _) = listener.accept().await.expect("accepted");
            let mut request = Vec::new();
            let mut chunk = [0; 4096];
            loop {
                let text = String::from_utf8_lossy(&request).into_owned();
                if let Some((head, body)) = text.split_once("\r\n\r\n") {
                    let length = head.lines().find_map(|line| {
                        line.to_ascii_lowercase().strip_prefix("content-length: ")?.parse::<usize>().ok()
                    });
                    if body.len() >= length.unwrap_or(0) {
                        break;
                    }
                }
                let read = stream.read(&mut chunk).await.expect("read");
                assert!(read > 0, "a whole request");
                request.extend_from_slice(&chunk[..read]);
            }
            let status = statuses[turn.min(statuses.len() - 1)];
            let answer = format!(
                "HTTP/1.1 {status} x\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
            );
            stream.write_all(answer.as_bytes()).await.expect("answered");
            told.send(String::from_utf8(request).expect("text")).expect("somebody reads");
        }
    });
    (address, deliveries)
}

async fn service(hosts: Vec<String>) -> (Service, TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("secret");
    std::fs::write(&path, format!("whsec_{SECRET}\n")).expect("written");
    (Service::with(allowing(hosts, &path), Box::new(CpuDevice::new())).await, folder)
}

/// Settings that allow webhooks to these hosts.
fn allowing(hosts: Vec<String>, secret: &Path) -> impl FnOnce(&mut Settings) {
    move |settings| {
        settings.webhooks.webhook_hosts = hosts.iter().map(|host| host.parse().expect("a host")).collect();
        settings.webhooks.webhook_secret = Some(secret.to_owned());
    }
}

fn header<'a>(request: &'a str, name: &str) -> &'a str {
    let line = request.lines().find(|line| line.to_ascii_lowercase().starts_with(&format!("{name}: ")));
    line.and_then(|line| line.split_once(": ")).unwrap_or_else(|| panic!("no {name}: {request}")).1
}

#[tokio::test]
async fn an_end_is_told_once_and_signed() {
    let (address, mut deliveries) = receiver(&[200]).await;
    let (service, _folder) = service(vec![format!("http://{address}")]).await;
    let hook = format!("http://{address}/done?secret=1");
    let parent = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
    let post = service.post(&format!("/v1/jobs?clusters=5&webhook={hook}")).header("content-type", "model/obj");
    let job = json(post.header("traceparent", parent).body(sphere(300))).await;
    let request = deliveries.recv().await.expect("told");
    assert!(request.starts_with("POST /done?secret=1 HTTP/1.1\r\n"), "{request}");
    assert_eq!(header(&request, "traceparent"), parent);
    let (_, body) = request.split_once("\r\n\r\n").expect("a body");
    let message: serde_json::Value = serde_json::from_str(body).expect("JSON");
    assert_eq!(
        (&message["type"], &message["data"]["id"], &message["data"]["state"]),
        (&"job.ended".into(), &job["id"], &"succeeded".into())
    );
    assert_eq!(header(&request, "webhook-id"), text(&job["id"]));
    let mut mac = Hmac::<Sha256>::new_from_slice(&STANDARD.decode(SECRET).expect("base64")).expect("a key");
    mac.update(format!("{}.{}.{body}", text(&job["id"]), header(&request, "webhook-timestamp")).as_bytes());
    let expected = format!("v1,{}", STANDARD.encode(mac.finalize().into_bytes()));
    assert_eq!(header(&request, "webhook-signature"), expected);
    until(async || metric(&service, "tesserae_webhooks_pending").await == 0.0).await;
    assert_eq!(metric(&service, "tesserae_webhooks_total{outcome=\"delivered\"}").await, 1.0);

    // a failed job, by the JSON part
    let form = reqwest::multipart::Form::new()
        .part("mesh", reqwest::multipart::Part::bytes(b"v 0 0 0\nf 1 2 3\n".to_vec()).file_name("a.obj"))
        .text("parameters", format!(r#"{{"clusters": 1, "webhook": "{hook}"}}"#));
    json(service.post("/v1/jobs").multipart(form)).await;
    let request = deliveries.recv().await.expect("told");
    assert!(request.contains("\"failed\"") && request.contains("/problems/invalid-mesh"), "{request}");
}

/// Takes connections and never answers.
async fn silent_receiver() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("bound");
    let address = listener.local_addr().expect("an address");
    tokio::spawn(async move {
        let mut open = Vec::new();
        while let Ok((stream, _)) = listener.accept().await {
            open.push(stream);
        }
    });
    address
}

#[tokio::test]
async fn a_receiver_that_never_answers_delays_no_other_one() {
    let silent = silent_receiver().await;
    let (address, mut deliveries) = receiver(&[200]).await;
    let (service, _folder) = service(vec![format!("http://{silent}"), format!("http://{address}")]).await;
    for _ in 0..32 {
        let job = service.submit(&format!("clusters=5&webhook=http://{silent}/"), sphere(300)).await;
        service.ended(&job).await;
    }
    let job = service.submit(&format!("clusters=5&webhook=http://{address}/"), sphere(300)).await;
    service.ended(&job).await;
    let ended = Instant::now();
    let request = deliveries.recv().await.expect("told");
    assert_eq!(header(&request, "webhook-id"), text(&job["id"]));
    // a delivery to the silent receiver is given up after 15 s
    assert!(ended.elapsed() < Duration::from_secs(10), "it waited for the silent receiver");
    assert!(metric(&service, "tesserae_webhooks_pending").await >= 32.0);
}

#[tokio::test]
async fn a_receiver_that_fails_is_asked_again_and_one_that_is_gone_is_not() {
    // redirects are not followed: they are failures too
    let (address, mut deliveries) = receiver(&[302, 410]).await;
    let (service, _folder) = service(vec![format!("http://{address}")]).await;
    service.submit(&format!("clusters=5&webhook=http://{address}/"), sphere(300)).await;
    let first = deliveries.recv().await.expect("told");
    assert_eq!(metric(&service, "tesserae_webhooks_pending").await, 1.0);
    let second = deliveries.recv().await.expect("told again");
    assert_eq!(header(&first, "webhook-id"), header(&second, "webhook-id"));
    until(async || metric(&service, "tesserae_webhooks_pending").await == 0.0).await;
    for (outcome, count) in [("failed", 1.0), ("given_up", 1.0), ("delivered", 0.0)] {
        assert_eq!(metric(&service, &format!("tesserae_webhooks_total{{outcome=\"{outcome}\"}}")).await, count);
    }
}

#[tokio::test]
async fn an_end_is_told_also_when_the_job_is_deleted_before_the_receiver_takes_it() {
    let (address, mut deliveries) = receiver(&[503, 503, 200]).await;
    let hosts = vec![format!("http://{address}")];
    let (service, folder) = service(hosts.clone()).await;
    let job = service.submit(&format!("clusters=5&webhook=http://{address}/"), sphere(300)).await;
    let refused = deliveries.recv().await.expect("told");
    assert_eq!(service.delete(path(&job)).send().await.expect("answered").status(), 204);
    assert_eq!(service.get(path(&job)).send().await.expect("answered").status(), 404);
    assert_eq!(metric(&service, "tesserae_webhooks_pending").await, 1.0);
    // after a restart, too, and where the host was not allowed for a while
    let service = service.again(|_| {}).await;
    until(async || metric(&service, "tesserae_webhooks_total{outcome=\"failed\"}").await == 1.0).await;
    let service = service.again(allowing(hosts, &folder.path().join("secret"))).await;
    for _ in 0..2 {
        let again = deliveries.recv().await.expect("told again");
        assert_eq!(header(&again, "webhook-id"), text(&job["id"]));
        let body = |request: &str| request.split_once("\r\n\r\n").expect("a body").1.to_owned();
        assert_eq!(body(&again), body(&refused), "nothing of it is lost with the job");
    }
    until(async || metric(&service, "tesserae_webhooks_pending").await == 0.0).await;
    assert_eq!(metric(&service, "tesserae_webhooks_total{outcome=\"delivered\"}").await, 1.0);
}

#[tokio::test]
async fn webhooks_go_nowhere_by_default_and_never_to_hosts_that_are_not_listed() {
    let nobody = Service::start().await;
    let (listed, _folder) = service(vec!["hooks.example".to_owned()]).await;
    for (service, hook) in [
        (&nobody, "https://hooks.example/"),
        (&listed, "https://other.example/"),
        (&listed, "http://hooks.example/"),
        (&listed, "http://127.0.0.1:80/"),
        (&listed, "http://169.254.169.254/latest/meta-data"),
        (&listed, "/etc/passwd"),
        (&listed, "file:///etc/passwd"),
    ] {
        let request = service.post(&format!("/v1/jobs?clusters=2&webhook={hook}")).header("content-type", "model/obj");
        let detail = refused(request.body(sphere(100)), 422, "invalid-parameter").await;
        assert!(detail.contains("webhook"), "{detail}");
    }
    assert_eq!(json(nobody.get("/v1/jobs")).await["jobs"], serde_json::json!([]));
    let twice = listed.post("/v1/jobs").multipart(
        reqwest::multipart::Form::new()
            .part("mesh", reqwest::multipart::Part::bytes(sphere(100)).file_name("a.obj"))
            .text("parameters", r#"{"clusters": 1, "webhook": 7}"#),
    );
    refused(twice, 422, "invalid-parameter").await;
}

#[tokio::test]
async fn a_name_that_leads_into_the_private_network_is_not_followed() {
    let (address, mut deliveries) = receiver(&[200]).await;
    let (service, _folder) = service(vec![format!("http://localhost:{}", address.port())]).await;
    service.submit(&format!("clusters=5&webhook=http://localhost:{}/", address.port()), sphere(300)).await;
    until(async || metric(&service, "tesserae_webhooks_total{outcome=\"failed\"}").await == 1.0).await;
    assert!(deliveries.try_recv().is_err());
    let (service, _folder) =
        self::service(vec![format!("http://localhost:{}", address.port()), "127.0.0.1".to_owned()]).await;
    service.submit(&format!("clusters=5&webhook=http://localhost:{}/", address.port()), sphere(300)).await;
    deliveries.recv().await.expect("told, because the address is listed too");
}
