//! Outputs that are made of the mesh: named by the request for the job, or made of a mesh that was kept.

use serde_json::Value;
use tesserae_mesh::artifacts::{self, Artifact, Need};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::TokenFile;

use crate::support::*;

fn made_of_mesh() -> impl Iterator<Item = &'static Artifact> {
    artifacts::ALL.into_iter().filter(|artifact| artifact.needs.contains(&Need::Mesh))
}

/// A job that succeeded.
async fn done(service: &Service, query: &str, faces: u64) -> Value {
    let job = service.submit(query, sphere(faces)).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    job
}

async fn bytes(service: &Service, url: &str) -> Vec<u8> {
    let response = service.get(url).send().await.expect("answered");
    assert_eq!(response.status(), 200, "{url}: {:?}", response.text().await);
    response.bytes().await.expect("bytes").to_vec()
}

#[tokio::test]
async fn named_outputs_are_those_that_a_kept_mesh_gives() {
    let service = Service::start().await;
    let kept = done(&service, "clusters=9&keep_mesh=true", 3000).await;
    let names: Vec<&str> = made_of_mesh().flat_map(|artifact| artifact.forms).map(|form| form.file).collect();
    let named = done(&service, &format!("clusters=9&outputs={}", names.join(",")), 3000).await;
    assert_eq!(named["outputs"].as_array().expect("a list").len(), names.len());
    for artifact in made_of_mesh() {
        for form in artifact.forms {
            let query = format!("?format={}", form.extension());
            let [one, other] = [&kept, &named].map(|job| format!("{}{query}", text(&job["urls"][artifact.name])));
            assert_eq!(bytes(&service, &one).await, bytes(&service, &other).await, "{}", form.file);
        }
    }
    let report = json(service.get(text(&named["urls"]["report"]))).await;
    assert_eq!(report["warnings"], Value::Array(Vec::new()));
}

#[tokio::test]
async fn what_was_not_asked_for_in_time_says_how_to_ask() {
    let service = Service::start().await;
    let job = done(&service, "clusters=9", 500).await;
    for artifact in made_of_mesh() {
        assert!(job["urls"].get(artifact.name).is_none(), "{}", artifact.name);
        let url = format!("{}/{}", path(&job), artifact.name);
        let detail = refused(service.get(&url), 404, "mesh-not-kept").await;
        assert!(detail.contains("keep_mesh=true") && detail.contains(artifact.forms[0].file), "{detail}");
    }
    let job = done(&service, "clusters=9&outputs=mesh.ply", 500).await;
    let url = text(&job["urls"]["mesh"]);
    assert!(bytes(&service, &format!("{url}?format=ply")).await.starts_with(b"ply\n"));
    refused(service.get(&format!("{url}?format=glb")), 404, "mesh-not-kept").await;
    refused(service.get(&format!("{}/submeshes", path(&job))), 404, "mesh-not-kept").await;
}

#[tokio::test]
async fn what_was_made_is_given_to_clients_that_take_any_format() {
    let service = Service::start().await;
    for kept in ["", "&keep_mesh=true"] {
        let job = done(&service, &format!("clusters=9&outputs=submeshes.zip,mesh.ply{kept}"), 500).await;
        for (name, media_type) in [("submeshes", "application/zip"), ("mesh", "model/ply")] {
            let url = text(&job["urls"][name]);
            let any = [None, Some("*/*"), Some("text/html, */*;q=0.1"), Some("application/*, model/*")];
            for accept in any {
                let request = accept.iter().fold(service.get(url), |request, accept| request.header("accept", *accept));
                let response = request.send().await.expect("answered");
                assert_eq!(
                    (response.status().as_u16(), &response.headers()["content-type"]),
                    (200, &media_type.parse().expect("a value")),
                    "{accept:?}"
                );
            }
            let wanted =
                service.get(url).header("accept", "model/gltf-binary, */*;q=0.1").send().await.expect("answered");
            let expected = if kept.is_empty() { media_type } else { "model/gltf-binary" };
            assert_eq!(wanted.headers()["content-type"], expected);
            let only = service.get(url).header("accept", "model/gltf-binary").send().await.expect("answered");
            assert_eq!(only.status(), if kept.is_empty() { 404 } else { 200 });
        }
    }
}

#[tokio::test]
async fn wrong_requests_for_outputs_are_refused() {
    let service = Service::start().await;
    let job = done(&service, "clusters=9&keep_mesh=true", 500).await;
    let url = text(&job["urls"]["mesh"]);
    let detail = refused(service.get(url).header("accept", "image/gif"), 406, "not-acceptable").await;
    assert!(detail.contains("model/ply"), "{detail}");
    for (query, status, kind, word) in [
        ("clusters=8", 409, "conflict", "flat clustering"),
        ("format=stl", 422, "invalid-parameter", "glb, ply, vtp, obj"),
        ("clusters=x", 422, "invalid-parameter", "clusters"),
        ("colour=red", 422, "invalid-parameter", "colour"),
        ("force=true", 422, "invalid-parameter", "force"),
        ("placement=fit", 422, "invalid-parameter", "placement"),
        ("format=ply&format=obj", 422, "invalid-parameter", "format"),
    ] {
        let detail = refused(service.get(&format!("{url}?{query}")), status, kind).await;
        assert!(detail.contains(word), "{detail}");
    }
    for (query, word) in [
        ("clusters=9&outputs=labels.npy", "mesh.glb"),
        ("clusters=9&keep_mesh=perhaps", "perhaps"),
        ("algorithm=hr&outputs=mesh", "keep_mesh"),
    ] {
        let request = service.obj(query, sphere(300));
        let detail = refused(request, 422, "invalid-parameter").await;
        assert!(detail.contains(word), "{detail}");
    }
    let many = done(&service, "clusters=2100&keep_mesh=true", 5000).await;
    let url = text(&many["urls"]["submeshes"]);
    assert!(refused(service.get(url), 409, "conflict").await.contains("2100"));
    assert!(bytes(&service, &format!("{url}?force=true")).await.starts_with(b"glTF"));
}

#[tokio::test]
async fn a_remesh_is_placed_as_the_query_says() {
    let service = Service::start().await;
    let job = done(&service, "clusters=40&keep_mesh=true&outputs=remesh.ply", 2000).await;
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    assert_eq!((&report["remesh"]["vertices"]["clusters"], &report["remesh"]["checked"]), (&40.into(), &true.into()));
    let url = text(&job["urls"]["remesh"]);
    let placed = async |query: &str| bytes(&service, &format!("{url}?{query}")).await;
    let fit = placed("format=ply").await;
    assert!(fit == placed("format=ply&placement=fit").await);
    let (surface, centroid) = (placed("placement=surface").await, placed("placement=centroid").await);
    assert!(fit != surface && fit != centroid && surface != centroid);
    refused(service.get(&format!("{url}?placement=middle")), 422, "invalid-parameter").await;
}

#[tokio::test]
async fn a_mesh_is_divided_for_its_remesh_and_then_has_no_labels() {
    let service = Service::start().await;
    let job = done(&service, "clusters=60&subdivide=auto&outputs=remesh.ply,remesh-source.npz", 500).await;
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    assert_eq!((&report["parameters"]["subdivide"], &report["remesh"]["checked"]), (&1.into(), &true.into()));
    assert!(bytes(&service, text(&job["urls"]["remesh"])).await.starts_with(b"ply\n"));
    assert!(bytes(&service, text(&job["urls"]["remesh-source"])).await.starts_with(b"PK"));
    let detail = refused(service.get(text(&job["urls"]["labels"])), 409, "conflict").await;
    assert!(detail.contains("subdivide"), "{detail}");
    for (query, word) in [
        ("clusters=9&subdivide=1&keep_mesh=true", "keep_mesh"),
        ("clusters=9&subdivide=often", "auto"),
        ("clusters=9&subdivide=1&snapshots=3", "snapshots"),
        ("algorithm=hr&subdivide=1", "hr"),
    ] {
        let request = service.obj(query, sphere(300));
        let detail = refused(request, 422, "invalid-parameter").await;
        assert!(detail.contains(word), "{detail}");
    }
}

#[tokio::test]
async fn an_output_that_cannot_be_written_is_a_warning_of_a_job_that_succeeds() {
    let service = Service::start().await;
    let job = done(&service, "clusters=2100&outputs=submeshes.glb,mesh.ply", 5000).await;
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    assert!(report["warnings"][0].as_str().expect("a warning").starts_with("submeshes.glb was not written"));
    let detail = refused(service.get(text(&job["urls"]["submeshes"])), 404, "not-found").await;
    assert!(detail.contains("warnings"), "{detail}");
    bytes(&service, &format!("{}?format=ply", text(&job["urls"]["mesh"]))).await;
}

#[tokio::test]
async fn a_hierarchy_gives_outputs_at_every_number_of_clusters() {
    let service = Service::start().await;
    let job = done(&service, "algorithm=pml&keep_mesh=true", 2000).await;
    let url = text(&job["urls"]["mesh"]);
    refused(service.get(url), 409, "conflict").await;
    refused(service.get(&format!("{url}?clusters=1000000")), 409, "conflict").await;
    for clusters in [3, 40] {
        let obj = bytes(&service, &format!("{url}?format=obj&clusters={clusters}")).await;
        let text = String::from_utf8(obj).expect("text");
        assert_eq!(text.lines().filter(|line| line.starts_with("g cluster-")).count(), clusters);
    }
}

#[tokio::test]
async fn a_kept_mesh_is_its_tenants_only_and_goes_with_its_job() {
    let folder = tempfile::tempdir().expect("a folder");
    let tokens = folder.path().join("tokens.json");
    let [mine, theirs] = ["mine", "theirs"]
        .map(|tenant| TokenFile::change(&tokens, |file| Ok(file.add(tenant)?.reveal())).expect("made"));
    let service = Service::with(|settings| settings.access.tokens = Some(tokens), Box::new(CpuDevice::new())).await;
    let request =
        service.obj("clusters=9&keep_mesh=true", sphere(60_000)).header("prefer", "wait=100").bearer_auth(&mine);
    let job: Value = json(request).await;
    let url = text(&job["urls"]["mesh"]);
    refused(service.get(url).bearer_auth(&theirs), 404, "not-found").await;
    refused(service.get(url), 401, "unauthorized").await;
    assert_eq!(service.get(url).bearer_auth(&mine).send().await.expect("answered").status(), 200);

    let data = service.folder();
    let kept = || {
        let list = walk(data.path());
        list.into_iter().filter(|name| name.ends_with("mesh.kept")).count()
    };
    assert_eq!(kept(), 1);
    let removed = service.delete(path(&job)).bearer_auth(&mine).send().await.expect("answered");
    assert_eq!(removed.status(), 204);
    refused(service.get(url).bearer_auth(&mine), 404, "not-found").await;
    assert_eq!(kept(), 0);
}

/// Every file below a folder.
fn walk(folder: &std::path::Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        match path.is_dir() {
            true => found.extend(walk(&path)),
            false => found.push(path.to_string_lossy().into_owned()),
        }
    }
    found
}

#[tokio::test]
async fn a_glb_without_colours_has_the_triangles_of_the_upload_and_their_faces() {
    let service = Service::start().await;
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nf 1 2 3 4\nf 2 5 3\n";
    let job = service.submit("clusters=2&keep_mesh=true", obj.into()).await;
    let job = service.ended(&job).await;
    let url = text(&job["urls"]["mesh"]);
    let glb = bytes(&service, &format!("{url}?format=glb&colours=none")).await;
    let json_length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let document: Value = serde_json::from_slice(&glb[20..20 + json_length]).expect("JSON");
    let primitive = &document["meshes"][0]["primitives"][0];
    assert_eq!(primitive["attributes"].as_object().expect("an object").keys().collect::<Vec<_>>(), ["POSITION"]);
    let view = document["meshes"][0]["extras"]["faces"].as_u64().expect("a view") as usize;
    let numbers = |view: &Value| -> Vec<u32> {
        let at = |name: &str| view[name].as_u64().unwrap_or_default() as usize;
        let bytes = &glb[28 + json_length..][at("byteOffset")..][..at("byteLength")];
        bytes.as_chunks().0.iter().copied().map(u32::from_le_bytes).collect()
    };
    assert_eq!(numbers(&document["bufferViews"][view]), [0, 0, 1]);
    let indices = &document["accessors"][primitive["indices"].as_u64().expect("an accessor") as usize];
    let indices = &document["bufferViews"][indices["bufferView"].as_u64().expect("a view") as usize];
    assert_eq!(numbers(indices), [0, 1, 2, 0, 2, 3, 1, 4, 2]);

    for wrong in ["mesh?format=ply&colours=none", "remesh?colours=none", "mesh?colours=red"] {
        refused(service.get(&format!("{}/{wrong}", path(&job))), 422, "invalid-parameter").await;
    }
}
