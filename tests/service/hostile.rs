//! Clients that send too much, too little, something else, or hang up.

use std::time::Duration;

use futures_util::{StreamExt as _, stream};
use reqwest::Body;
use reqwest::multipart::{Form, Part};
use tesserae_mesh::device::cpu::CpuDevice;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::support::*;

/// A service that takes at most 100 kB.
async fn small() -> Service {
    Service::with(|settings| settings.max_upload_bytes = 100_000, Box::new(CpuDevice::new())).await
}

/// A body without a declared length.
fn chunked(pieces: usize) -> Body {
    let pieces = (0..pieces).map(|_| Ok::<_, std::io::Error>(b"# a line of a comment\n".repeat(500)));
    Body::wrap_stream(stream::iter(pieces))
}

/// Sends bytes as they are and gives what comes back until the connection closes.
async fn raw(service: &Service, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(service.address).await.expect("connected");
    stream.write_all(request).await.expect("sent");
    let mut answer = Vec::new();
    let read = stream.read_to_end(&mut answer);
    let _ = tokio::time::timeout(Duration::from_secs(120), read).await;
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test]
async fn too_large_a_body_is_refused_from_its_declared_length_and_as_it_comes() {
    let service = small().await;
    let post = || service.post("/v1/jobs?clusters=2").header("content-type", "model/obj");
    let detail = refused(post().body(b"# x\n".repeat(100_000)), 413, "too-large").await;
    assert!(detail.ends_with("400000"), "{detail}");
    refused(post().body(chunked(100)), 413, "too-large").await;
    let form = Form::new().part("mesh", Part::stream(chunked(100)).file_name("a.obj"));
    refused(service.post("/v1/jobs?clusters=2").multipart(form), 413, "too-large").await;
    // several parts that are small enough each
    let mut form = Form::new();
    for name in ["a", "b", "c", "d"] {
        form = form.part("buffer", Part::bytes(vec![b'x'; 30_000]).file_name(name));
    }
    refused(service.post("/v1/jobs?clusters=2").multipart(form), 413, "too-large").await;
    service.keeps_no("").await;
    assert_eq!(json(service.get("/v1/jobs")).await["jobs"], serde_json::json!([]));
}

#[tokio::test]
async fn a_client_that_waits_for_leave_is_refused_before_it_sends() {
    let service = small().await;
    let request = "POST /v1/jobs?clusters=2 HTTP/1.1\r\nHost: localhost\r\nContent-Type: model/obj\r\n\
                   Content-Length: 5000000000\r\nExpect: 100-continue\r\n\r\n";
    let answer = raw(&service, request.as_bytes()).await;
    // of the limit, not of the disk
    assert!(answer.starts_with("HTTP/1.1 413 ") && answer.contains("--max-upload-bytes"), "{answer}");
    assert!(!answer.contains("100 Continue"), "{answer}");
}

/// A client that sends its next request on a connection that ends finds no answer, and does not know whether to send
/// it again.
#[tokio::test]
async fn the_answer_to_a_refused_request_with_a_body_says_that_its_connection_ends() {
    let service = small().await;
    let closes = async |request: reqwest::RequestBuilder| {
        let response = request.send().await.expect("answered");
        (response.status().as_u16(), response.headers().get("connection").is_some_and(|value| value == "close"))
    };
    let post = |query: &str| service.post(&format!("/v1/jobs?{query}")).header("content-type", "model/obj");
    assert_eq!(closes(post("clusters=1").body(b"# x\n".repeat(100_000))).await, (413, true));
    assert!(!closes(post("clusters=1")).await.1);
    assert!(!closes(service.get("/v1/jobs/none")).await.1);
    assert_eq!(closes(post("clusters=1").body("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")).await, (202, false));
}

#[tokio::test]
async fn a_client_that_hangs_up_leaves_nothing() {
    let service = Service::start().await;
    for content_type in ["model/obj", "multipart/form-data; boundary=b"] {
        let mut stream = TcpStream::connect(service.address).await.expect("connected");
        let head = format!(
            "POST /v1/jobs?clusters=2 HTTP/1.1\r\nHost: localhost\r\nContent-Type: {content_type}\r\n\
             Content-Length: 10000000\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).await.expect("sent");
        let part = "--b\r\nContent-Disposition: form-data; name=\"mesh\"; filename=\"a.obj\"\r\n\r\n";
        if content_type.starts_with("multipart") {
            stream.write_all(part.as_bytes()).await.expect("sent");
        }
        // more than is held before it is written
        stream.write_all(&b"v 0 0 0\n".repeat(250_000)).await.expect("sent");
        while service.files().is_empty() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        drop(stream);
        service.keeps_no("").await;
    }
    assert_eq!(json(service.get("/v1/jobs")).await["jobs"], serde_json::json!([]));
}

#[tokio::test]
async fn contradictory_lengths_make_no_job() {
    let service = Service::start().await;
    let head =
        "POST /v1/jobs?clusters=2 HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: model/obj\r\n";
    for (lengths, body) in [
        ("Content-Length: 10\r\nContent-Length: 20\r\n", "v 0 0 0\nv 1 0 0\nv 0 1\n"),
        ("Content-Length: ten\r\n", "v 0 0 0\n"),
        ("Content-Length: -1\r\n", "v 0 0 0\n"),
        ("Transfer-Encoding: chunked\r\n", "zz\r\nv 0 0 0\n\r\n0\r\n\r\n"),
        ("Transfer-Encoding: chunked\r\n", "5\r\nv 0 0 0\n"),
    ] {
        let answer = raw(&service, format!("{head}{lengths}\r\n{body}").as_bytes()).await;
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{lengths}: {answer}");
    }
    // a GLB that says to be longer, and shorter, than it is
    for change in [1i64, -4] {
        let mut glb = sphere_glb(300);
        let length = (glb.len() as i64 + change) as u32;
        glb[8..12].copy_from_slice(&length.to_le_bytes());
        let request = service.post("/v1/jobs?clusters=2").header("content-type", "model/gltf-binary").body(glb);
        refused(request, 422, "invalid-mesh").await;
    }
    assert_eq!(json(service.get("/v1/jobs")).await["jobs"], serde_json::json!([]));
    service.keeps_no("").await;
}

#[tokio::test]
async fn malformed_forms_are_bad_requests() {
    let service = Service::start().await;
    let post = |content_type: &str, body: &str| {
        let request = service.post("/v1/jobs?clusters=2").header("content-type", content_type);
        request.body(body.to_owned())
    };
    refused(post("multipart/form-data", "x"), 400, "bad-request").await;
    let form = "multipart/form-data; boundary=b";
    for body in [
        "",
        "no boundary at all",
        "--b\r\n\r\nno headers\r\n--b--\r\n",
        "--b\r\nContent-Disposition: form-data\r\n\r\nno name\r\n--b--\r\n",
        "--b\r\nContent-Disposition: form-data; name=\"mesh\"\r\n\r\nv 0 0 0\n and no end",
    ] {
        refused(post(form, body), 400, "bad-request").await;
    }
    service.keeps_no("").await;
}

#[tokio::test]
async fn endless_part_headers_are_cut_off() {
    let service = Service::start().await;
    let endless = (0..2000).map(|piece| {
        let line = if piece == 0 { "--b\r\nX: ".to_owned() } else { "x".repeat(10_000) };
        Ok::<_, std::io::Error>(line)
    });
    let request = service.post("/v1/jobs?clusters=2").header("content-type", "multipart/form-data; boundary=b");
    let body = Body::wrap_stream(stream::iter(endless));
    let detail = refused(request.body(body), 400, "bad-request").await;
    assert!(detail.contains("headers of a part"), "{detail}");
}

#[tokio::test]
async fn names_of_files_are_for_people_only() {
    let service = Service::start().await;
    let name = "../../../etc/\u{fc}\"passwd\\..\\x.obj";
    let form = Form::new().part("mesh", Part::bytes(sphere(300)).file_name(name));
    let request = service.post("/v1/jobs?clusters=2").header("prefer", "wait=50").multipart(form);
    let job = json(request).await;
    assert_eq!(job["state"], "succeeded");
    let labels = service.get(text(&job["urls"]["labels"])).send().await.expect("answered");
    let disposition = labels.headers()["content-disposition"].to_str().expect("ASCII");
    assert!(disposition.ends_with("filename=\"x-labels.json\""), "{disposition}");
    for file in service.files() {
        let file = file.to_string_lossy().into_owned();
        assert!(!file.contains("passwd") && !file.ends_with(".obj"), "{file}");
    }
}

#[tokio::test]
async fn odd_paths_and_methods_get_problem_documents() {
    let service = Service::start().await;
    for path in ["/no", "/v1", "/v1/jobs/", "/v2/jobs", "/v1/jobs/a/b/c", "/v1/jobs/..%2f..%2fetc%2fpasswd", "/%00"] {
        refused(service.get(path), 404, "not-found").await;
    }
    for id in ["x", "00000000-0000-0000-0000-000000000000", "../x", "%F0%28", "0".repeat(5000).as_str()] {
        for rest in ["", "/events", "/labels", "/report", "/hierarchy"] {
            let response = service.get(&format!("/v1/jobs/{id}{rest}")).send().await.expect("answered");
            assert!(response.status().is_client_error(), "{id}{rest}: {}", response.status());
            assert_eq!(response.headers()["content-type"], "application/problem+json", "{id}{rest}");
        }
    }
    for id in ["%ff", "%F0%28"] {
        for rest in ["", "/events", "/labels", "/report", "/hierarchy"] {
            let detail = refused(service.get(&format!("/v1/jobs/{id}{rest}")), 404, "not-found").await;
            assert!(detail.contains("not UTF-8") && detail.contains(id), "{detail}");
        }
    }
    for (method, path) in [("PUT", "/v1/jobs"), ("POST", "/v1/device"), ("PATCH", "/v1/jobs/x"), ("DELETE", "/healthz")]
    {
        let method = method.parse().expect("a method");
        let response = service.client.request(method, service.url(path)).send().await.expect("answered");
        let allow = response.headers().get("allow").cloned().expect("Allow");
        let detail = problem(response, 405, "method-not-allowed").await;
        assert!(detail.contains(allow.to_str().expect("text")), "{detail}");
    }
}

/// Spoils bytes in some places: they end early, bits turn, a piece comes again, a number becomes large.
fn spoiled(sound: &[u8], seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut below = |bound: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % bound.max(1) as u64) as usize
    };
    let mut bytes = sound.to_vec();
    for _ in 0..=below(3) {
        let at = below(bytes.len());
        match below(5) {
            0 => bytes.truncate(at),
            1 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << below(8)),
            2 => {
                let piece = bytes[at..bytes.len().min(at + below(200))].to_vec();
                let to = below(bytes.len());
                bytes.splice(to..to, piece);
            }
            3 => bytes.iter_mut().skip(at / 4 * 4).take(4).for_each(|byte| *byte = 0xff),
            _ => {
                let to = bytes.len().min(at + below(50));
                bytes.splice(at..to, *b"99999999999");
            }
        }
    }
    bytes
}

#[tokio::test]
async fn spoiled_uploads_by_the_thousand_are_answered_each_and_leave_nothing() {
    const EACH: u64 = 750;
    let service = Service::start().await;
    let before = service.submit("clusters=5", sphere(300)).await;
    let labels = async |job: &serde_json::Value| {
        service.ended(job).await;
        json(service.get(text(&job["urls"]["report"]))).await["labels_sha256"].clone()
    };
    let expected = labels(&before).await;
    let mut form = b"--b\r\nContent-Disposition: form-data; name=\"parameters\"\r\n\r\n{\"clusters\": 3}\r\n--b\r\n\
        Content-Disposition: form-data; name=\"mesh\"; filename=\"a.glb\"\r\n\r\n"
        .to_vec();
    form.extend(sphere_glb(60));
    form.extend(b"\r\n--b--\r\n");
    let compressed = zstd::encode_all(&sphere(60)[..], 3).expect("compressed");
    let kinds = [
        ("model/obj", "identity", "?clusters=3", sphere(60)),
        ("model/gltf-binary", "identity", "?clusters=3", sphere_glb(60)),
        ("multipart/form-data; boundary=b", "identity", "", form),
        ("model/obj", "zstd", "?clusters=3", compressed),
    ];
    for (content_type, encoding, query, sound) in kinds {
        let send = async |body: Vec<u8>| {
            let request = service.post(&format!("/v1/jobs{query}")).header("content-type", content_type);
            let request = request.header("content-encoding", encoding).header("prefer", "wait=60");
            request.body(body).send().await.expect("answered")
        };
        assert_eq!(send(sound.clone()).await.status(), 200, "{content_type} {encoding}");
        let answers = stream::iter(0..EACH).map(async |seed| {
            let answer = send(spoiled(&sound, seed)).await;
            let status = answer.status().as_u16();
            let media_type = answer.headers()["content-type"].clone();
            assert!(status == 200 || (400..500).contains(&status), "seed {seed}: {:?}", answer.text().await);
            assert_eq!(media_type == "application/problem+json", status != 200, "seed {seed}");
            u64::from(status != 200)
        });
        let refused: u64 = answers.buffer_unordered(16).collect::<Vec<_>>().await.into_iter().sum();
        assert!((EACH / 4..=EACH).contains(&refused), "{refused} of {EACH} were refused: {content_type} {encoding}");
    }
    assert_eq!(labels(&service.submit("clusters=5", sphere(300)).await).await, expected);
    assert_eq!(json(service.get("/readyz")).await["status"], "ok");
    service.keeps_no("uploads").await;
    service.keeps_no("scratch").await;
}

#[tokio::test]
async fn a_slow_upload_holds_nobody_up() {
    let service = Service::start().await;
    let mut slow = TcpStream::connect(service.address).await.expect("connected");
    let head = "POST /v1/jobs?clusters=2 HTTP/1.1\r\nHost: [::1]\r\nContent-Type: model/obj\r\n\
         Content-Length: 9000\r\n\r\nv 0";
    slow.write_all(head.as_bytes()).await.expect("sent");
    let job = service.submit("clusters=2", sphere(300)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
    assert_eq!(json(service.get("/v1/jobs")).await["jobs"].as_array().map(Vec::len), Some(1));
}
