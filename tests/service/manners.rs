//! What HTTP has for clients that ask again, ask for a part, or ask for less.

use std::io::Read as _;

use reqwest::Method;
use serde_json::Value;
use tesserae_mesh::artifacts::{self, Artifact, LABELS_PNG, Need};

use crate::support::*;

/// A service and a job that succeeded.
async fn with_job(query: &str, faces: u64) -> (Service, Value) {
    let service = Service::start().await;
    let job = service.submit(query, sphere(faces)).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    (service, job)
}

#[tokio::test]
async fn a_result_that_the_client_has_is_not_sent_again() {
    let (service, job) = with_job("algorithm=pml", 600).await;
    let path = path(&job);
    let mut tags = std::collections::BTreeSet::new();
    for (rest, accept) in [
        ("/labels?clusters=9", "application/json"),
        ("/labels?clusters=8", "application/json"),
        ("/labels?clusters=9", "application/x-npy"),
        ("/hierarchy", "application/json"),
        ("/hierarchy?min_clusters=5", "application/json"),
        ("/hierarchy", "application/octet-stream"),
        ("/report", "application/json"),
    ] {
        let get = || service.get(&format!("{path}{rest}")).header("accept", accept);
        let whole = get().send().await.expect("answered");
        assert_eq!(
            (whole.status().as_u16(), &whole.headers()["cache-control"]),
            (200, &"private, no-cache".parse().expect("a header"))
        );
        let tag = whole.headers()["etag"].to_str().expect("text").to_owned();
        assert!(tags.insert(tag.clone()), "{rest} {accept}: other bytes have other tags");
        for known in [tag.clone(), format!("\"x\", W/{tag}"), "*".to_owned()] {
            let answer = get().header("if-none-match", known).send().await.expect("answered");
            assert_eq!(answer.status(), 304, "{rest}");
            assert!(answer.headers().contains_key("etag") && answer.headers().contains_key("cache-control"));
            assert!(answer.bytes().await.expect("bytes").is_empty());
        }
        assert_eq!(get().header("if-none-match", "\"x\"").send().await.expect("answered").status(), 200);
    }
    service.delete(path).send().await.expect("answered");
    refused(service.get(&format!("{path}/report")).header("if-none-match", "*"), 404, "not-found").await;
}

#[tokio::test]
async fn every_output_in_every_form_has_a_tag_and_parts() {
    // one whose result is kept in the store, and one in files
    for faces in [600, 12_000] {
        let (service, job) = with_job("algorithm=hr&clusters=1&keep_mesh=true", faces).await;
        let is_of_mesh = |artifact: &&Artifact| artifact.is_served && !artifact.needs(Need::Image);
        for artifact in artifacts::ALL.into_iter().filter(is_of_mesh) {
            for form in artifact.forms.iter().filter(|form| form.file != LABELS_PNG.file) {
                let query = match (artifact.forms.len(), form.extension()) {
                    (1, _) if artifact.needs(Need::Report) => String::new(),
                    (_, extension) if artifact.needs(Need::Hierarchy) => format!("?format={extension}"),
                    (_, extension) => format!("?clusters=9&format={extension}"),
                };
                let url = format!("{}/{}{query}", path(&job), artifact.name);
                let whole = service.get(&url).send().await.expect("answered");
                assert_eq!(whole.status(), 200, "{url}: {:?}", whole.text().await);
                assert_eq!(whole.headers()["content-type"], form.media_type, "{url}");
                has_tag_and_parts(&service, &url, whole).await;
            }
        }
    }
}

#[tokio::test]
async fn an_upload_is_there_until_its_job_ends() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    // small ones are kept in the store, others in files
    let meshes = [sphere(300), sphere(20_000)];
    let mut jobs = Vec::new();
    for mesh in &meshes {
        let job = service.submit("clusters=5", mesh.clone()).await;
        let url = text(&job["urls"]["upload"]).to_owned();
        assert_eq!(url, format!("{}/upload", path(&job)));
        let whole = service.get(&url).send().await.expect("answered");
        assert_eq!((whole.status().as_u16(), whole.content_length()), (200, Some(mesh.len() as u64)));
        let disposition = whole.headers()["content-disposition"].to_str().expect("text");
        assert!(disposition.starts_with("attachment; ") && disposition.ends_with("-upload.obj\""), "{disposition}");
        assert_eq!(whole.headers()["content-type"], "application/octet-stream");
        assert_eq!(&has_tag_and_parts(&service, &url, whole).await, mesh);
        let detail = refused(service.get(&format!("{url}?buffer=a.bin")), 422, "invalid-parameter").await;
        assert!(detail.contains("a.bin"), "{detail}");
        jobs.push((job, url));
    }
    gate.open();
    for (job, url) in jobs {
        assert_eq!(service.ended(&job).await["urls"]["upload"], Value::Null);
        let detail = refused(service.get(&url), 404, "not-found").await;
        assert!(detail.contains("keep_mesh=true") && detail.ends_with("succeeded"), "{detail}");
    }
}

/// Checks that a resource is not sent again to a client that has it, and in parts on request; gives its bytes.
async fn has_tag_and_parts(service: &Service, url: &str, whole: reqwest::Response) -> Vec<u8> {
    let tag = whole.headers()["etag"].clone();
    assert_eq!(whole.headers()["accept-ranges"], "bytes");
    let whole = whole.bytes().await.expect("bytes");
    assert!(whole.len() > 20, "{url}");
    let known = service.get(url).header("if-none-match", &tag).send().await.expect("answered");
    assert_eq!((known.status().as_u16(), &known.headers()["etag"]), (304, &tag), "{url}");
    for (tag, status, bytes) in [(tag.to_str().expect("text"), 206, &whole[10..20]), ("\"x\"", 200, &whole[..])] {
        let part = service.get(url).header("range", "bytes=10-19").header("if-range", tag);
        let part = part.send().await.expect("answered");
        assert_eq!(part.status(), status, "{url}");
        assert_eq!(part.bytes().await.expect("bytes"), bytes, "{url}");
    }
    let end = format!("bytes={}-", whole.len());
    refused(service.get(url).header("range", end), 416, "range-not-satisfiable").await;
    let head = service.client.head(service.url(url)).send().await.expect("answered");
    assert_eq!(head.headers()["content-length"].to_str().expect("text"), whole.len().to_string(), "{url}");
    whole.to_vec()
}

#[tokio::test]
async fn the_same_labels_have_the_same_tag_whoever_made_them() {
    let tag = async |service: &Service, job: &Value, accept: &str| {
        let request = service.get(text(&job["urls"]["labels"])).header("accept", accept);
        request.send().await.expect("answered").headers()["etag"].to_str().expect("text").to_owned()
    };
    let (one, first) = with_job("clusters=9", 600).await;
    let (other, again) = with_job("clusters=9", 600).await;
    let different = other.submit("clusters=8", sphere(600)).await;
    other.ended(&different).await;
    let mut tags = std::collections::BTreeSet::new();
    for accept in ["application/json", "application/x-npy", "application/octet-stream"] {
        assert_eq!(tag(&one, &first, accept).await, tag(&other, &again, accept).await, "{accept}");
        assert!(tags.insert(tag(&one, &first, accept).await));
        assert!(tags.insert(tag(&other, &different, accept).await));
    }
}

#[tokio::test]
async fn parts_of_a_result_make_the_whole() {
    let (service, job) = with_job("clusters=9", 80_000).await;
    let get = || service.get(&format!("{}/labels", path(&job))).header("accept", "application/octet-stream");
    let whole = get().send().await.expect("answered");
    assert_eq!(whole.headers()["accept-ranges"], "bytes");
    let tag = whole.headers()["etag"].clone();
    let whole = whole.bytes().await.expect("bytes");
    let mut parts = Vec::new();
    while parts.len() < whole.len() {
        let range = format!("bytes={}-{}", parts.len(), parts.len() + 70_000);
        let answer = get().header("range", range).header("if-range", &tag).send().await.expect("answered");
        assert_eq!(answer.status(), 206);
        let told = answer.headers()["content-range"].to_str().expect("text").to_owned();
        let part = answer.bytes().await.expect("bytes");
        assert_eq!(told, format!("bytes {}-{}/{}", parts.len(), parts.len() + part.len() - 1, whole.len()));
        parts.extend_from_slice(&part);
    }
    assert_eq!(parts, whole);
    let last = get().header("range", "bytes=-4").send().await.expect("answered").bytes().await.expect("bytes");
    assert_eq!(last, whole[whole.len() - 4..]);
    for ignored in ["bytes=0-1,5-6", "lines=1-2", "bytes=x-", "bytes=9-2"] {
        assert_eq!(get().header("range", ignored).send().await.expect("answered").status(), 200, "{ignored}");
    }
    let other = get().header("range", "bytes=0-1").header("if-range", "\"x\"").send().await.expect("answered");
    assert_eq!(other.status(), 200, "a part of other bytes is of no use");
    let answer = get().header("range", format!("bytes={}-", whole.len())).send().await.expect("answered");
    assert_eq!(answer.headers()["content-range"], format!("bytes */{}", whole.len()));
    problem(answer, 416, "range-not-satisfiable").await;
}

#[tokio::test]
async fn answers_are_compressed_for_who_can_read_that_and_streams_are_not() {
    let (service, job) = with_job("clusters=9", 6_000).await;
    let labels = format!("{}/labels", path(&job));
    let plain = service.get(&labels).send().await.expect("answered");
    let plain_tag = plain.headers()["etag"].clone();
    let plain = plain.bytes().await.expect("bytes");
    for coding in ["gzip", "zstd"] {
        let answer = service.get(&labels).header("accept-encoding", coding).send().await.expect("answered");
        assert_eq!(answer.headers()["content-encoding"], coding);
        assert!(answer.headers()["vary"].to_str().expect("text").contains("accept"));
        let tag = answer.headers()["etag"].clone();
        assert_eq!(tag, format!("W/{}", plain_tag.to_str().expect("text")), "other bytes of the same meaning");
        let bytes = answer.bytes().await.expect("bytes");
        assert!(bytes.len() < plain.len() / 2, "{} of {}", bytes.len(), plain.len());
        let mut read = Vec::new();
        match coding {
            "gzip" => flate2::read::GzDecoder::new(&bytes[..]).read_to_end(&mut read).expect("gzip"),
            _ => zstd::Decoder::new(&bytes[..]).expect("zstd").read_to_end(&mut read).expect("zstd"),
        };
        assert_eq!(read, plain);
        let again = service.get(&labels).header("accept-encoding", coding).header("if-none-match", tag);
        assert_eq!(again.send().await.expect("answered").status(), 304);
        let part = service.get(&labels).header("accept-encoding", coding).header("range", "bytes=0-2000");
        let part = part.send().await.expect("answered");
        assert_eq!((part.status().as_u16(), part.headers().contains_key("content-encoding")), (206, false));
        assert_eq!(part.bytes().await.expect("bytes"), plain[..2001]);
        let events = service.get(&format!("{}/events", path(&job))).header("accept-encoding", coding);
        assert!(!events.send().await.expect("answered").headers().contains_key("content-encoding"));
    }
    let small = service.get("/healthz").header("accept-encoding", "gzip").send().await.expect("answered");
    assert!(!small.headers().contains_key("content-encoding"));
}

#[tokio::test]
async fn everything_that_can_be_got_has_a_head() {
    let (service, job) = with_job("algorithm=pml", 600).await;
    let path = path(&job);
    let own = ["", "/labels?clusters=9", "/hierarchy", "/report", "/events"].map(|rest| format!("{path}{rest}"));
    let others = [
        "/v1/jobs",
        "/v1/device",
        "/v1/formats",
        "/v1/limits",
        "/v1/version",
        "/healthz",
        "/readyz",
        "/metrics",
        "/openapi.yaml",
        "/nothing",
    ];
    for path in own.iter().map(String::as_str).chain(others) {
        let get = service.get(path).send().await.expect("answered");
        let head = service.client.request(Method::HEAD, service.url(path)).send().await.expect("answered");
        assert_eq!(head.status(), get.status(), "{path}");
        for name in ["content-type", "etag", "cache-control"] {
            assert_eq!(head.headers().get(name), get.headers().get(name), "{path}");
        }
        assert!(head.bytes().await.expect("bytes").is_empty());
    }
}

#[tokio::test]
async fn a_client_that_refuses_answers_without_a_coding_gets_them_all_the_same() {
    let service = Service::start().await;
    for refused in ["identity;q=0", "br;q=1, *; q=0.000", "IDENTITY;Q=0, gzip;q=0"] {
        let request = service.post("/v1/jobs?clusters=5").header("accept-encoding", refused);
        let answer = request.header("content-type", "model/obj").body(sphere(300)).send().await.expect("answered");
        assert_eq!(answer.status(), 202, "{refused}");
        assert!(!answer.headers().contains_key("content-encoding"), "{refused}");
        let job: Value = answer.json().await.expect("JSON");
        assert_eq!(service.ended(&job).await["state"], "succeeded");
    }
    let zipped = service.get("/openapi.yaml").header("accept-encoding", "gzip, identity;q=0").send().await;
    assert_eq!(zipped.expect("answered").headers()["content-encoding"], "gzip", "what it accepts is taken");
}
