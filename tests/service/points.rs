//! Jobs on points with neighbours: arrays, edges in a part, images.

use reqwest::RequestBuilder;
use reqwest::multipart::{Form, Part};
use serde_json::Value;
use tesserae_mesh::artifacts::{Content, LABELS_PNG, Labels, npy_header};
use tesserae_mesh::device::cpu::CpuDevice;

use crate::support::*;

/// An array of 240 items in three columns.
fn array(shape: &str) -> Vec<u8> {
    let mut bytes = npy_header("<f4", shape);
    let value = |at: usize| [(at / 20) as f32, (at % 20) as f32 / 4.0, if at % 7 > 2 { 5.0 } else { 0.0 }];
    bytes.extend((0..240).flat_map(value).flat_map(f32::to_le_bytes));
    bytes
}

/// A grey image of 12 rows and 20 columns.
fn image() -> Vec<u8> {
    let grey: Vec<u32> = (0..240).map(|at| if at / 20 + at % 20 > 15 { 60_000 } else { 9_000 }).collect();
    let content = Content { labels: Some(Labels::new(60_001, &grey)), shape: Some(&[12, 20]), ..Content::default() };
    let mut png = Vec::new();
    (LABELS_PNG.encode)(&content).expect("an image")(&mut png).expect("a vector takes everything");
    png
}

fn form(parts: &[(&'static str, &[u8])]) -> Form {
    parts.iter().fold(Form::new(), |form, (name, bytes)| form.part(*name, Part::bytes(bytes.to_vec()).file_name("x")))
}

/// The job of a request, ended.
async fn ended(request: RequestBuilder) -> Value {
    let response = request.header("prefer", "wait=50").send().await.expect("answered");
    let job: Value = response.json().await.expect("JSON");
    assert_eq!(job["state"], "succeeded", "{job}");
    job
}

async fn bytes(service: &Service, url: &str) -> Vec<u8> {
    let response = service.get(url).send().await.expect("answered");
    assert_eq!(response.status(), 200, "{url}");
    response.bytes().await.expect("bytes").to_vec()
}

#[tokio::test]
async fn images_and_arrays_are_clustered_by_media_type_by_content_and_as_parts() {
    let service = Service::start().await;
    let raw = |query: &str, media_type: &'static str, body: Vec<u8>| {
        service.post(&format!("/v1/jobs?{query}")).header("content-type", media_type).body(body)
    };
    for (query, media_type) in [("clusters=6", "image/png"), ("clusters=6", "application/octet-stream")] {
        let job = ended(raw(query, media_type, image())).await;
        assert_eq!((&job["mesh"]["format"], &job["result"]["faces"]), (&"png".into(), &240.into()));
        let labels = bytes(&service, &format!("{}/labels?format=npy", path(&job))).await;
        assert!(String::from_utf8_lossy(&labels[..128]).contains("(12, 20)"));
        let png = bytes(&service, &format!("{}/labels?format=png", path(&job))).await;
        assert!(png.starts_with(b"\x89PNG"));
        let report = json(service.get(&format!("{}/report", path(&job)))).await;
        assert_eq!((&report["input"]["graph"], &report["input"]["edges"]), (&"grid".into(), &448.into()));
    }
    let job = ended(raw("clusters=6&outputs=means", "image/png", image())).await;
    assert!(bytes(&service, text(&job["urls"]["means"])).await.starts_with(b"\x89PNG"));
    let job = ended(raw("clusters=6&graph=grid&algorithm=pml", "application/x-npy", array("(12, 20, 3)"))).await;
    let cut = bytes(&service, &format!("{}/labels?format=npy&clusters=9", path(&job))).await;
    assert!(String::from_utf8_lossy(&cut[..128]).contains("(12, 20)"));

    // the graph of clusters, one an item, is that of the items
    let flat = array("(240, 3)");
    let near = service.post("/v1/jobs?clusters=240&graph=knn:6&outputs=graph.npz,clusters.csv");
    let all = ended(near.multipart(form(&[("points", &flat)]))).await;
    let graph = bytes(&service, &format!("{}/graph?format=npz", path(&all))).await;
    let table = String::from_utf8(bytes(&service, &format!("{}/clusters", path(&all))).await).expect("text");
    assert!(table.starts_with("cluster,items,weight,energy") && table.lines().count() == 241, "{table}");
    let labels = async |request: RequestBuilder| {
        let job = ended(request).await;
        bytes(&service, &format!("{}/labels?format=bin", path(&job))).await
    };
    let near = labels(service.post("/v1/jobs?clusters=8&graph=knn:6").multipart(form(&[("points", &flat)]))).await;
    let parts = [("points", &flat[..]), ("graph", &graph[..])];
    assert_eq!(labels(service.post("/v1/jobs?clusters=8").multipart(form(&parts))).await, near);
    let mut ones = npy_header("<f4", "(240,)");
    ones.extend([1f32; 240].into_iter().flat_map(f32::to_le_bytes));
    let parts = [parts[0], parts[1], ("weights", &ones[..])];
    assert_eq!(labels(service.post("/v1/jobs?clusters=8").multipart(form(&parts))).await, near);
}

#[tokio::test]
async fn a_kept_image_gives_at_every_number_of_superpixels_what_a_run_makes_at_its_own() {
    let service = Service::start().await;
    let post =
        |query: &str| service.post(&format!("/v1/jobs?{query}")).header("content-type", "image/png").body(image());
    // one merge a round, so that both runs have the same state at 9, with the same weights
    let whole = ended(post("algorithm=hr&levels=9&keep_mesh=true")).await;
    let nine = ended(post("algorithm=hr&clusters=9&outputs=means,clusters.csv,clusters.json,graph.npz")).await;
    for output in
        ["labels?format=npy", "means?format=png", "clusters?format=csv", "clusters?format=json", "graph?format=npz"]
    {
        let cut = bytes(&service, &format!("{}/{output}&clusters=9", path(&whole))).await;
        assert_eq!(cut, bytes(&service, &format!("{}/{output}", path(&nine))).await, "{output}");
        let other = bytes(&service, &format!("{}/{output}&clusters=1", path(&whole))).await;
        assert_ne!(cut, other, "{output}");
    }
    assert_eq!(bytes(&service, text(&whole["urls"]["upload"])).await, image());
    assert_eq!(nine["urls"]["upload"], Value::Null);
    let detail = refused(service.get(&format!("{}/means", path(&whole))), 409, "conflict").await;
    assert!(detail.contains("give clusters"), "{detail}");
    let flat = ended(post("clusters=9&keep_mesh=true")).await;
    assert!(bytes(&service, text(&flat["urls"]["means"])).await.starts_with(b"\x89PNG"));
}

#[tokio::test]
async fn what_points_or_meshes_do_not_have_is_refused_before_there_is_a_job() {
    let service = Service::start().await;
    let (flat, image, mesh) = (array("(240, 3)"), image(), sphere(50));
    for (query, parts, word) in [
        ("clusters=4&curvature_exponent=2", &[("points", &flat)][..], "goes with meshes, not with points"),
        ("clusters=4&keep_mesh=true", &[("points", &flat)], "keep_mesh goes with meshes"),
        ("clusters=4&outputs=mesh.glb", &[("points", &flat)], "mesh.glb is made of a mesh"),
        ("clusters=4&compactness=3", &[("points", &flat)], "goes with images"),
        ("clusters=4&graph=knn:6", &[("points", &flat), ("graph", &flat)], "scipy.sparse.save_npz"),
        ("clusters=4&graph=g.npz", &[("points", &flat)], "with a part named graph"),
        ("clusters=4&graph=knn:6", &[("points", &image)], "goes with arrays, not with images"),
        ("clusters=4&compactness=nan", &[("points", &image)], "compactness must be from 0.001 to 1000000"),
        ("clusters=4", &[("points", &image), ("weights", &flat)], "goes with arrays, not with images"),
        ("algorithm=pml", &[("points", &image)], "clusters is missing"),
        ("clusters=4&outputs=means.png", &[("points", &flat)], "means.png is made of an image"),
        ("clusters=4&outputs=means", &[("mesh", &mesh)], "means.png is made of an image"),
        ("clusters=4", &[("mesh", &flat)], "send it as a part named points"),
        ("clusters=4", &[("points", &mesh)], "send it as a part named mesh"),
        ("clusters=4", &[("points", &flat), ("mesh", &mesh)], "more than one part named mesh or points"),
        ("clusters=4&graph=knn", &[("mesh", &mesh)], "goes with points, not with a mesh"),
        ("clusters=4", &[("parameters", &[][..].to_vec())], "not valid"),
    ] {
        let parts: Vec<(&'static str, &[u8])> = parts.iter().map(|(name, bytes)| (*name, &bytes[..])).collect();
        let request = service.post(&format!("/v1/jobs?{query}")).multipart(form(&parts));
        let response = request.send().await.expect("answered");
        let status = response.status().as_u16();
        let text = response.text().await.expect("text");
        assert!((400..=422).contains(&status) && text.contains(word), "{query}: {status} {text}");
    }
    let job = ended(service.post("/v1/jobs?clusters=4").multipart(form(&[("points", &flat)]))).await;
    let detail = refused(service.get(&format!("{}/mesh", path(&job))), 409, "conflict").await;
    assert!(detail.contains("these are points"), "{detail}");
    let detail = refused(service.get(&format!("{}/clusters", path(&job))), 404, "mesh-not-kept").await;
    assert!(detail.contains("outputs=clusters"), "{detail}");
    let detail = refused(service.get(&format!("{}/means", path(&job))), 409, "conflict").await;
    assert!(detail.contains("an image, and this is none"), "{detail}");
    let detail = refused(service.get(&format!("{}/labels?format=png", path(&job))), 409, "conflict").await;
    assert!(detail.contains("rows and columns"), "{detail}");
}

#[tokio::test]
async fn an_error_names_the_part_beside_the_points_that_it_is_about() {
    let service = Service::start().await;
    let (flat, two) = (array("(240, 3)"), [npy_header("<f4", "(2,)"), vec![0; 8]].concat());
    let damaged = b"PK\x03\x04and nothing".to_vec();
    for (name, part, words) in [
        ("weights", &two, "the part weights: the weights must have"),
        ("seeds", &two, "the part seeds: "),
        ("graph", &damaged, "the part graph: "),
    ] {
        let form = form(&[("points", &flat), (name, part)]);
        let request = service.post("/v1/jobs?clusters=4").multipart(form).header("prefer", "wait=50");
        let text = request.send().await.expect("answered").text().await.expect("text");
        assert!(text.contains(words), "{text}");
    }
}

#[tokio::test]
async fn points_that_never_fit_in_memory_are_refused_by_their_head() {
    let service =
        Service::with(|settings| settings.work.memory_budget = Some(64 << 20), Box::new(CpuDevice::new())).await;
    let mut bytes = npy_header("<f4", "(300000, 64)");
    bytes.extend([0; 4 * 64]);
    let request = service.post("/v1/jobs?clusters=4&graph=knn:64").header("content-type", "application/x-npy");
    let response = request.header("prefer", "wait=50").body(bytes).send().await.expect("answered");
    let text = response.text().await.expect("text");
    assert!(text.contains("300000 items"), "{text}");
}
