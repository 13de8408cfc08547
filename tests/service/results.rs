//! Labels and reports.

use serde_json::Value;

use crate::support::*;

/// A service and a job that succeeded there.
async fn done() -> (Service, Value) {
    let service = Service::start().await;
    let job = service.submit("clusters=9", sphere(1000)).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    (service, job)
}

fn numbers(bytes: &[u8]) -> Vec<u64> {
    bytes.chunks_exact(4).map(|four| u64::from(u32::from_le_bytes(four.try_into().expect("four bytes")))).collect()
}

#[tokio::test]
async fn labels_are_the_same_in_every_format() {
    let (service, job) = done().await;
    let url = text(&job["urls"]["labels"]);
    let faces = job["result"]["faces"].as_u64().expect("a number") as usize;
    let labels = json(service.get(url)).await;
    assert_eq!(labels["clusters"], 9);
    let expected: Vec<u64> = serde_json::from_value(labels["labels"].clone()).expect("numbers");
    assert_eq!(expected.len(), faces);
    assert!((0..9).all(|cluster| expected.contains(&cluster)) && expected.iter().all(|label| *label < 9));

    for (accept, media_type, extension) in [
        ("application/x-npy", "application/x-npy", "npy"),
        ("application/octet-stream", "application/octet-stream", "bin"),
        ("text/html, application/octet-stream;q=0.9, */*;q=0.1", "application/octet-stream", "bin"),
    ] {
        let response = service.get(url).header("accept", accept).send().await.expect("answered");
        assert_eq!(response.status(), 200);
        assert_eq!(response.headers()["content-type"], media_type);
        assert_eq!(response.headers()["vary"], "accept");
        let disposition = response.headers()["content-disposition"].to_str().expect("text").to_owned();
        assert!(disposition.starts_with("attachment; filename=\"") && disposition.contains(extension), "{disposition}");
        let length: usize = response.headers()["content-length"].to_str().expect("text").parse().expect("a number");
        let body = response.bytes().await.expect("bytes");
        assert_eq!(body.len(), length);
        assert_eq!(numbers(&body[body.len() - 4 * faces..]), expected, "{accept}");
        if extension == "bin" {
            assert_eq!(body.len(), 4 * faces);
        } else {
            assert_eq!(&body[..6], b"\x93NUMPY");
        }
        let head = service.client.head(service.url(url)).header("accept", accept).send().await.expect("answered");
        assert_eq!(head.headers()["content-length"], length.to_string());
        assert!(head.bytes().await.expect("bytes").is_empty());
    }
    let detail = refused(service.get(url).header("accept", "image/gif"), 406, "not-acceptable").await;
    assert!(detail.contains("application/x-npy"), "{detail}");
}

#[tokio::test]
async fn shapes_are_in_the_report() {
    let service = Service::start().await;
    let job = service.submit("clusters=9&energy=shapes&shapes=sphere&resolution=0.1u", sphere(1000)).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    let report = json(service.get(&format!("{}/report", path(&job)))).await;
    assert_eq!(report["shapes"].as_array().map(Vec::len), Some(9));
    assert_eq!(
        (&report["parameters"]["shapes"], &report["parameters"]["resolution"]),
        (&"plane,sphere".into(), &"0.1u".into())
    );
    let refused = |query: &str| refused(service.obj(query, sphere(1000)), 422, "invalid-parameter");
    assert!(refused("clusters=9&energy=planes&algorithm=vc").await.contains("bb, pml, ml and hr"));
    assert!(refused("clusters=9&shapes=sphere").await.contains("energy=shapes"));
    assert!(refused("clusters=9&energy=shapes&resolution=2").await.contains("resolution and tolerance must be"));
    assert!(refused("clusters=9&energy=shapes&tolerance=0.1").await.contains("clusters does not go with tolerance"));
    let job = service.ended(&service.submit("energy=planes&tolerance=0.05u", sphere(1000)).await).await;
    let report = json(service.get(&format!("{}/report", path(&job)))).await;
    let tolerance = &report["tolerance"];
    assert_eq!(tolerance["asked"], "0.05u");
    assert!(tolerance["largest"].as_f64() <= tolerance["length"].as_f64(), "{tolerance}");
    assert_eq!(report["shapes"].as_array().map(|rows| rows.len() as u64), report["clusters"].as_u64());
    let job = service.ended(&service.submit("energy=planes&algorithm=hr", sphere(1000)).await).await;
    assert_eq!(json(service.get(&format!("{}/hierarchy", path(&job)))).await["nodes"][0]["type"], "plane");
}

#[tokio::test]
async fn the_report_agrees_with_the_labels() {
    use sha2::Digest as _;
    let (service, job) = done().await;
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    let raw = service.get(text(&job["urls"]["labels"])).header("accept", "application/octet-stream");
    let bytes = raw.send().await.expect("answered").bytes().await.expect("bytes");
    let digest: String = sha2::Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(report["labels_sha256"], digest);
    assert_eq!(report["clusters"], 9);
    assert_eq!(report["input"]["format"], "obj");
    assert_eq!(report["device"]["kind"], "cpu");
    assert!(report["timings_ms"]["total"].as_f64() >= report["timings_ms"]["write"].as_f64());
    assert!(report["timings_ms"]["write"].as_f64() > Some(0.0));
    let last = report["iterations"].as_array().and_then(|rows| rows.last()).expect("a row");
    assert_eq!(last["energy"], job["progress"]["energy"]);
    assert_eq!(last["iteration"], job["progress"]["iterations"]);
}

#[tokio::test]
async fn there_are_no_results_before_success_and_none_after_failure() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let job = service.submit("clusters=9", sphere(1000)).await;
    for name in ["labels", "report"] {
        refused(service.get(text(&job["urls"][name])), 409, "conflict").await;
    }
    gate.open();
    service.ended(&job).await;
    let failed = service.submit("clusters=9", b"f 1 2 3\n".to_vec()).await;
    assert_eq!(service.ended(&failed).await["state"], "failed");
    for name in ["labels", "report"] {
        let detail = refused(service.get(text(&failed["urls"][name])), 409, "conflict").await;
        assert!(detail.contains("failed"), "{detail}");
    }
}

#[tokio::test]
async fn a_flat_clustering_is_not_cut_and_has_no_hierarchy() {
    let (service, job) = done().await;
    let labels = text(&job["urls"]["labels"]);
    let detail = refused(service.get(&format!("{labels}?clusters=4")), 409, "conflict").await;
    assert!(detail.contains("flat") && detail.ends_with('4'), "{detail}");
    for query in ["clusters=x", "clusters=-1", "cluster=4", "clusters=4&clusters=4"] {
        refused(service.get(&format!("{labels}?{query}")), 422, "invalid-parameter").await;
    }
    let detail = refused(service.get(&format!("{}/hierarchy", path(&job))), 404, "not-found").await;
    assert!(detail.contains("bb"), "{detail}");
}

#[tokio::test]
async fn deletion_removes_the_results() {
    let (service, small) = done().await;
    assert!(service.files().is_empty(), "what is small is kept with its job: {:?}", service.files());
    let large = service.submit("clusters=5", sphere(80_000)).await;
    service.ended(&large).await;
    assert!(service.files().iter().any(|file| file.ends_with("labels.npy")));
    for job in [&small, &large] {
        assert_eq!(service.delete(path(job)).send().await.expect("answered").status(), 204);
        for name in ["self", "events", "labels", "report"] {
            refused(service.get(text(&job["urls"][name])), 404, "not-found").await;
        }
    }
    service.keeps_no("").await;
}

#[tokio::test]
async fn labels_of_iterations_are_there_where_they_were_asked_for() {
    let service = Service::start().await;
    let job = service.submit("clusters=20&snapshots=0,3", sphere(2000)).await;
    let job = service.ended(&job).await;
    let url = text(&job["urls"]["labels"]);
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    assert_eq!(report["snapshots"], serde_json::json!([0, 3]));
    let labels = async |query: &str| -> Vec<u64> {
        let labels = json(service.get(&format!("{url}{query}"))).await;
        serde_json::from_value(labels["labels"].clone()).expect("numbers")
    };
    let (first, third, last) = (labels("?iteration=0").await, labels("?iteration=3").await, labels("").await);
    assert!(first != third && third != last);
    assert_eq!((first.len(), third.len()), (last.len(), last.len()));
    for (accept, extension) in [("application/x-npy", "npy"), ("application/octet-stream", "bin")] {
        let request = service.get(&format!("{url}?iteration=3")).header("accept", accept);
        let response = request.send().await.expect("answered");
        let disposition = response.headers()["content-disposition"].to_str().expect("text").to_owned();
        assert!(disposition.contains(&format!("labels.iteration-3.{extension}")), "{disposition}");
        let body = response.bytes().await.expect("bytes");
        assert_eq!(numbers(&body[body.len() - 4 * third.len()..]), third);
    }
    let detail = refused(service.get(&format!("{url}?iteration=4")), 404, "not-found").await;
    assert!(detail.contains("0, 3") && detail.ends_with('4'), "{detail}");
    refused(service.get(&format!("{url}?iteration=-1")), 422, "invalid-parameter").await;
    refused(service.get(&format!("{url}?iteration=3&clusters=5")), 409, "conflict").await;

    let (service, job) = done().await;
    let detail = refused(service.get(&format!("{}?iteration=0", text(&job["urls"]["labels"]))), 404, "not-found").await;
    assert!(detail.contains("snapshots"), "{detail}");
    let job = service.submit("clusters=9&algorithm=pml", sphere(1000)).await;
    let job = service.ended(&job).await;
    refused(service.get(&format!("{}?iteration=0", text(&job["urls"]["labels"]))), 409, "conflict").await;
    for query in ["clusters=9&snapshots=", "clusters=9&snapshots=1,x", "algorithm=pml&snapshots=3"] {
        let detail = refused(service.obj(query, sphere(300)), 422, "invalid-parameter").await;
        assert!(detail.contains("snapshots"), "{detail}");
    }
}
