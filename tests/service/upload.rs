//! Bodies, parts and parameters: what is taken, and what is refused before a job exists.

use reqwest::multipart::{Form, Part};
use serde_json::{Value, json};

use crate::support::*;

/// A tetrahedron as glTF with its buffer outside, and that buffer.
fn gltf(uri: &str) -> (String, Vec<u8>) {
    let mut buffer = Vec::new();
    for number in [0f32, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.] {
        buffer.extend(number.to_le_bytes());
    }
    for index in [0u16, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2] {
        buffer.extend(index.to_le_bytes());
    }
    let document = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": uri, "byteLength": 72}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
    });
    (document.to_string(), buffer)
}

/// A tetrahedron as PLY, binary.
fn ply() -> Vec<u8> {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 4\nproperty char x\nproperty char y\n\
                      property char z\nelement face 4\nproperty list uchar uchar vertex_indices\nend_header\n"
        .to_vec();
    bytes.extend([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 3, 0, 2, 1, 3, 0, 1, 3, 3, 1, 2, 3, 3, 0, 3, 2]);
    bytes
}

/// Two triangles as STL, binary, with a header that begins like a text.
fn stl() -> Vec<u8> {
    let mut bytes = b"solid of a CAD program".to_vec();
    bytes.resize(80, 0);
    bytes.extend(2u32.to_le_bytes());
    for corners in [[0f32, 0., 0., 1., 0., 0., 0., 1., 0.], [0., 1., 0., 1., 0., 0., 1., 1., 0.]] {
        bytes.extend([0f32, 0., 1.].iter().chain(&corners).flat_map(|number| number.to_le_bytes()));
        bytes.extend([0, 0]);
    }
    bytes
}

/// Two triangles as OFF.
const OFF: &[u8] = b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";

fn file(bytes: impl Into<Vec<u8>>, name: &str) -> Part {
    Part::bytes(bytes.into()).file_name(name.to_owned())
}

#[tokio::test]
async fn a_raw_body_of_every_type_becomes_a_job() {
    let service = Service::start().await;
    for (content_type, query, body, format) in [
        (Some("model/obj"), "", sphere(300), "obj"),
        (Some("model/gltf-binary"), "", sphere_glb(300), "glb"),
        (Some("application/octet-stream"), "&format=obj", sphere(300), "obj"),
        (Some("application/octet-stream"), "&format=glb", sphere_glb(300), "glb"),
        (Some("application/octet-stream"), "", sphere_glb(300), "glb"),
        (Some("application/octet-stream"), "", sphere(300), "obj"),
        (None, "", sphere(300), "obj"),
        (Some("model/ply"), "", ply(), "ply"),
        (Some("application/x-ply"), "", ply(), "ply"),
        (Some("application/octet-stream"), "&format=ply", ply(), "ply"),
        (None, "", ply(), "ply"),
        (Some("model/stl"), "", stl(), "stl"),
        (Some("application/sla"), "", stl(), "stl"),
        (Some("application/octet-stream"), "&format=stl", stl(), "stl"),
        (None, "", stl(), "stl"),
        (Some("model/off"), "", OFF.to_vec(), "off"),
        (None, "", OFF.to_vec(), "off"),
    ] {
        let mut request = service.post(&format!("/v1/jobs?clusters=2{query}")).header("prefer", "wait=50").body(body);
        if let Some(content_type) = content_type {
            request = request.header("content-type", content_type);
        }
        let job = json(request).await;
        assert_eq!(job["state"], "succeeded", "{content_type:?} {query}: {job}");
        assert_eq!(job["mesh"]["format"], format);
        assert_eq!(job["result"]["clusters"], 2);
    }
}

#[tokio::test]
async fn a_form_brings_mesh_parameters_and_seeds_in_any_order() {
    let service = Service::start().await;
    let form = Form::new()
        .part("seeds", file("[3, 1, 2]", "seeds.json"))
        .text("parameters", r#"{"max_iterations": 5}"#)
        .part("mesh", file(sphere(300), "my sphere.obj"));
    let request = service.post("/v1/jobs?seed=4").header("prefer", "wait=50").multipart(form);
    let job = json(request).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    assert_eq!(job["mesh"]["file_name"], "my sphere.obj");
    assert_eq!(job["parameters"]["seeds"], "listed");
    assert_eq!(job["parameters"]["max_iterations"], 5);
    assert_eq!(job["parameters"]["seed"], 4);
    assert_eq!(job["result"]["clusters"], 3);
}

#[tokio::test]
async fn a_quotation_mark_in_a_file_name_stays_one() {
    let service = Service::start().await;
    // as browsers write it, and as RFC 2183 does
    for written in ["a%22b 100%.obj", "a\\\"b 100%.obj"] {
        let part = format!("--b\r\nContent-Disposition: form-data; name=\"mesh\"; filename=\"{written}\"\r\n\r\n");
        let body = [part.into_bytes(), sphere(300), b"\r\n--b--\r\n".to_vec()].concat();
        let request = service.post("/v1/jobs?clusters=2").header("content-type", "multipart/form-data; boundary=b");
        assert_eq!(json(request.body(body)).await["mesh"]["file_name"], "a\"b 100%.obj", "{written}");
    }
}

#[tokio::test]
async fn a_part_without_a_mesh_type_is_recognised_by_name_then_content() {
    let service = Service::start().await;
    for (part, format) in [
        (file(sphere(300), "a.OBJ"), "obj"),
        (file(sphere_glb(300), "a.glb"), "glb"),
        (file(sphere_glb(300), "a"), "glb"),
        (file(ply(), "a.ply"), "ply"),
        (file(ply(), "a"), "ply"),
        (file(stl(), "a.STL"), "stl"),
        (file(stl(), "a"), "stl"),
        (file(OFF, "a.off"), "off"),
        (file(sphere(300), "a.txt").mime_str("text/plain").expect("a type"), "obj"),
        (file(sphere(300), "a.glb").mime_str("model/obj").expect("a type"), "obj"),
    ] {
        let form = Form::new().part("mesh", part);
        let job = json(service.post("/v1/jobs?clusters=2").multipart(form)).await;
        assert_eq!(job["mesh"]["format"], format);
    }
    let form = Form::new().part("mesh", file("Kaydara FBX Binary", "a.fbx"));
    refused(service.post("/v1/jobs?clusters=2").multipart(form), 415, "unsupported-media-type").await;
    let form = Form::new().part("mesh", file(sphere(300), "a.glb"));
    let detail = refused(service.post("/v1/jobs?clusters=2").multipart(form), 422, "invalid-mesh").await;
    assert!(detail.contains("glTF") || detail.contains("GLB"), "{detail}");
}

#[tokio::test]
async fn buffers_come_as_parts_and_from_nowhere_else() {
    let service = Service::start().await;
    let submit = async |uri: &str, parts: &[&str]| {
        let (document, buffer) = gltf(uri);
        let mut form = Form::new().part("mesh", file(document, "t.gltf"));
        for name in parts {
            form = form.part("buffer", file(buffer.clone(), name));
        }
        let request = service.post("/v1/jobs?clusters=2").header("prefer", "wait=50").multipart(form);
        request.send().await.expect("answered")
    };
    for (uri, part) in [("t.bin", "t.bin"), ("my%20buffer.bin", "my buffer.bin"), ("sub/t.bin", "sub/t.bin")] {
        let response = submit(uri, &["other.bin", part]).await;
        assert_eq!(response.status(), 200, "{uri}: {}", response.text().await.unwrap_or_default());
    }
    for uri in ["t.bin", "../../x", "/etc/passwd", "file:///etc/passwd", "mesh", "buffer-0", "http://127.0.0.1/x"] {
        let detail = problem(submit(uri, &["other.bin"]).await, 422, "invalid-mesh").await;
        assert!(!detail.contains("root:"), "{detail}");
    }
}

#[tokio::test]
async fn a_buffer_of_a_waiting_job_is_read_by_its_name() {
    let (device, _gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let (document, buffer) = gltf("my%20buffer.bin");
    let form = Form::new().part("mesh", file(document.clone(), "t.gltf"));
    let form = form.part("buffer", file(buffer.clone(), "my buffer.bin"));
    let job = json(service.post("/v1/jobs?clusters=2").multipart(form)).await;
    let url = text(&job["urls"]["upload"]);
    for (query, expected) in [("", document.into_bytes()), ("?buffer=my%20buffer.bin", buffer)] {
        let response = service.get(&format!("{url}{query}")).send().await.expect("answered");
        assert_eq!(response.bytes().await.expect("bytes"), expected, "{query}");
    }
    let detail = refused(service.get(&format!("{url}?buffer=buffer-0")), 422, "invalid-parameter").await;
    assert!(detail.contains("my buffer.bin"), "{detail}");
}

#[tokio::test]
async fn what_curl_sends_by_default_is_explained() {
    let service = Service::start().await;
    let request = service.post("/v1/jobs?clusters=2").header("content-type", "application/x-www-form-urlencoded");
    let response = request.body(sphere(300)).send().await.expect("answered");
    let accepted = response.headers().get("accept-post").cloned().expect("Accept-Post");
    assert!(accepted.to_str().expect("text").contains("model/gltf-binary"));
    let detail = problem(response, 415, "unsupported-media-type").await;
    assert!(detail.contains("-H 'Content-Type: model/obj'"), "{detail}");
    let brotli = service.post("/v1/jobs?clusters=2").header("content-encoding", "br").body("x");
    refused(brotli, 415, "unsupported-media-type").await;
}

#[tokio::test]
async fn parameters_are_refused_by_name() {
    let service = Service::start().await;
    for (query, name) in [
        ("", "clusters"),
        ("clusters=0", "clusters"),
        ("clusters=5&seeds=listed", "listed"),
        ("clusters=5&format=glb", "format"),
    ] {
        let detail = refused(service.obj(query, sphere(300)), 422, "invalid-parameter").await;
        assert!(detail.contains(name), "{query}: {detail}");
    }
    service.keeps_no("").await;
}

#[tokio::test]
async fn forms_are_refused_by_part() {
    let service = Service::start().await;
    let mesh = || Form::new().part("mesh", file(sphere(300), "a.obj"));
    for (form, status, kind, name) in [
        (Form::new().text("parameters", "{}"), 422, "invalid-parameter", "mesh"),
        (mesh().text("parameters", "{"), 400, "bad-request", "parameters"),
        (mesh().text("parameters", r#"{"k": 1}"#), 422, "invalid-parameter", "member \"k\""),
        (mesh().text("parameters", r#"{"clusters": 6}"#), 422, "invalid-parameter", "out of one: clusters"),
        (mesh().text("parameters", r#"{"seeds": "file:/etc/passwd"}"#), 422, "invalid-parameter", "/etc/passwd"),
        (mesh().text("parameters", "{}").text("parameters", "{}"), 422, "invalid-parameter", "parameters"),
        (mesh().part("mesh", file(sphere(300), "b.obj")), 422, "invalid-parameter", "mesh"),
        (mesh().text("parameters", " ".repeat(1 << 17)), 413, "too-large", "parameters"),
        (mesh().part("weights", file("1", "w.npy")), 422, "invalid-parameter", "weights"),
        (
            mesh().part("weights", weights(&[1.0])).part("weights", weights(&[1.0])),
            422,
            "invalid-parameter",
            "more than one part",
        ),
        (
            mesh().part("weights", weights(&[1.0])).text("parameters", r#"{"weight_attribute": "_W"}"#),
            422,
            "invalid-parameter",
            "weight_attribute",
        ),
        (mesh().part("colour", file("1", "c")), 422, "invalid-parameter", "colour"),
        (mesh().part("buffer", Part::text("1")), 422, "invalid-parameter", "file name"),
        (mesh().part("buffer", file("1", "b.bin")), 422, "invalid-parameter", "b.bin"),
        (mesh().text("seeds", "1").text("parameters", r#"{"seeds": "random"}"#), 422, "invalid-parameter", "random"),
        (Form::new().part("mesh", file("", "a.obj")), 422, "invalid-mesh", "empty"),
    ] {
        let detail = refused(service.post("/v1/jobs?clusters=5").multipart(form), status, kind).await;
        assert!(detail.contains(name), "{name}: {detail}");
    }
    service.keeps_no("").await;
}

/// A part with weights.
fn weights(weights: &[f64]) -> Part {
    let mut bytes = tesserae_mesh::artifacts::npy_header("<f8", &format!("({},)", weights.len()));
    weights.iter().for_each(|weight| bytes.extend(weight.to_le_bytes()));
    file(bytes, "w.npy")
}

#[tokio::test]
async fn weights_come_as_a_part_and_what_is_wrong_with_them_is_said() {
    let service = Service::start().await;
    let ended = async |query: &str, part: Part| {
        let form = Form::new().part("mesh", file(sphere(300), "a.obj")).part("weights", part);
        let request = service.post(&format!("/v1/jobs?{query}")).header("prefer", "wait=50").multipart(form);
        request.send().await.expect("answered")
    };
    let heavy: Vec<f64> = (0..300).map(|face| if face < 150 { 9.0 } else { 1.0 }).collect();
    let response = ended("clusters=20", weights(&heavy)).await;
    assert_eq!(response.status(), 200);
    let job: Value = response.json().await.expect("JSON");
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    assert_eq!(report["energy"]["weighted_by"], json!(["weights"]));
    assert_eq!(report["energy"]["hexagon_ratio"], Value::Null);
    let labels = json(service.get(text(&job["urls"]["labels"]))).await;
    let clusters = |faces: std::ops::Range<usize>| {
        let labels = &labels["labels"].as_array().expect("labels")[faces];
        labels.iter().map(Value::to_string).collect::<std::collections::BTreeSet<_>>().len()
    };
    assert!(clusters(0..150) > clusters(150..300));
    for (part, words) in [
        (weights(&heavy[..9]), ["300", "152", "9"]),
        (weights(&[&heavy[..7], &[0.0], &heavy[8..]].concat()), ["number 7", "is 0", "above 0"]),
    ] {
        let detail = problem(ended("clusters=20", part).await, 422, "invalid-parameter").await;
        assert!(words.iter().all(|word| detail.contains(word)), "{detail}");
    }
    let response = ended("clusters=20&algorithm=acvd&curvature_exponent=1", weights(&heavy)).await;
    let job: Value = response.json().await.expect("JSON");
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    assert_eq!(report["energy"]["weighted_by"], json!(["weights", "curvature"]));
    assert_eq!(report["algorithm"], "acvd");
}

#[tokio::test]
async fn a_mesh_of_another_type_than_it_says_is_refused_before_a_job_exists() {
    let service = Service::start().await;
    for (content_type, body) in [
        ("model/obj", sphere_glb(300)),
        ("model/gltf-binary", sphere(300)),
        ("model/gltf+json", sphere(300)),
        ("model/obj", Vec::new()),
        ("model/gltf-binary", sphere_glb(300)[..400].to_vec()),
    ] {
        let request = service.post("/v1/jobs?clusters=2").header("content-type", content_type).body(body);
        refused(request, 422, "invalid-mesh").await;
    }
    let list = json(service.get("/v1/jobs")).await;
    assert_eq!(list["jobs"], json!([]));
    service.keeps_no("").await;
}

#[tokio::test]
async fn what_only_reading_finds_makes_a_failed_job_with_a_problem() {
    let service = Service::start().await;
    let body = b"v 0 0 0\nv 1 0 0\nf 1 2 9\n".to_vec();
    let job = service.submit("clusters=1", body.clone()).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "failed");
    assert_eq!(job["problem"]["status"], 422);
    assert_eq!(job["problem"]["instance"], path(&job));
    let response = service.obj("clusters=1", body).header("prefer", "wait=50").send().await.expect("answered");
    assert!(response.headers().contains_key("location"));
    assert_eq!(response.headers()["preference-applied"], "wait");
    let detail = problem(response, 422, "invalid-mesh").await;
    assert!(detail.contains('3') && detail.contains('9'), "line and index: {detail}");
    // more clusters than faces
    let response =
        service.obj("clusters=10000", sphere(300)).header("prefer", "wait=50").send().await.expect("answered");
    assert_eq!(response.status(), 422);
}
