//! Tokens and tenants: requests without a valid token are refused, and a tenant sees its own jobs only.

use std::path::Path;

use reqwest::{Method, RequestBuilder};
use serde_json::Value;
use tempfile::TempDir;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::TokenFile;

use crate::support::*;

/// A file of tokens for two tenants and one that may read metrics; and their tokens.
fn tokens() -> (TempDir, [String; 3]) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tokens.json");
    let tokens = ["mine", "theirs", "monitoring"].map(|tenant| {
        TokenFile::change(&path, |file| {
            let token = file.add(tenant)?;
            let entry = file.tenants.get_mut(tenant).expect("just made");
            entry.metrics = tenant == "monitoring";
            Ok(token.reveal())
        })
        .expect("made")
    });
    (folder, tokens)
}

async fn with_tokens(folder: &Path) -> Service {
    let path = folder.join("tokens.json");
    Service::with(|settings| settings.access.tokens = Some(path), Box::new(CpuDevice::new())).await
}

fn submit(service: &Service, query: &str) -> RequestBuilder {
    service.obj(query, sphere(300))
}

#[tokio::test]
async fn nothing_about_jobs_is_told_without_a_token() {
    let (folder, [mine, ..]) = tokens();
    let service = with_tokens(folder.path()).await;
    let id = "/v1/jobs/6ed6e4e2-8a9c-44bf-a77e-f6c240b63f15";
    let paths = ["/v1/jobs", id, &format!("{id}/labels"), "/v1/device", "/v1/formats", "/metrics", "/nothing"];
    for path in paths {
        let response = service.get(path).send().await.expect("answered");
        assert_eq!(response.headers()["www-authenticate"], "Bearer realm=\"tesserae\"", "{path}");
        problem(response, 401, "unauthorized").await;
    }
    for wrong in [
        "",
        "x",
        "Bearer",
        "Bearer ",
        "Basic eDp5",
        "Bearer tess_0123456789abcdef_x",
        &mine,
        &format!("Bearer {mine}x"),
    ] {
        let detail = refused(service.get("/v1/jobs").header("authorization", wrong), 401, "unauthorized").await;
        assert!(!detail.contains(&mine), "{detail}");
    }
    let twice = service.get("/v1/jobs").bearer_auth(&mine).bearer_auth(&mine);
    refused(twice, 401, "unauthorized").await;
    refused(submit(&service, "clusters=3"), 401, "unauthorized").await;
    // the answer reaches who is still sending
    let large = service.obj("clusters=3", vec![b'#'; 50_000_000]);
    refused(large, 401, "unauthorized").await;
    service.keeps_no("").await;
    for open in ["/healthz", "/readyz", "/v1/version", "/openapi.yaml"] {
        assert_eq!(service.get(open).send().await.expect("answered").status(), 200, "{open}");
    }
    let lower = service.get("/v1/jobs").header("authorization", format!("bearer {mine}"));
    assert_eq!(json(lower).await["jobs"], serde_json::json!([]));
}

#[tokio::test]
async fn two_tenants_prying_at_each_other_find_nothing() {
    let (folder, [mine, theirs, _]) = tokens();
    let service = with_tokens(folder.path()).await;
    let flat: Value = json(submit(&service, "clusters=3").header("prefer", "wait=60").bearer_auth(&mine)).await;
    let tree: Value = json(submit(&service, "algorithm=pml").header("prefer", "wait=60").bearer_auth(&mine)).await;
    let own: Value = json(submit(&service, "clusters=4").header("prefer", "wait=60").bearer_auth(&theirs)).await;
    let unknown = "/v1/jobs/6ed6e4e2-8a9c-44bf-a77e-f6c240b63f15";
    for job in [&flat, &tree] {
        let path = path(job);
        for rest in ["", "/events", "/upload", "/labels", "/labels?clusters=3", "/hierarchy", "/report"] {
            for method in [Method::GET, Method::HEAD] {
                let ask = |path: &str| {
                    service
                        .client
                        .request(method.clone(), service.url(&format!("{path}{rest}")))
                        .bearer_auth(&theirs)
                        .send()
                };
                let (another, none) = (ask(path).await.expect("answered"), ask(unknown).await.expect("answered"));
                assert_eq!(another.status(), 404, "{method} {rest}");
                assert_eq!(another.status(), none.status());
                // not by a header either
                let names = |response: &reqwest::Response| {
                    let mut names: Vec<String> = response.headers().keys().map(ToString::to_string).collect();
                    names.sort();
                    names
                };
                assert_eq!(names(&another), names(&none), "{method} {rest}");
                let same = |text: String, path: &str| {
                    text.replace(path, "?").replace(path.trim_start_matches("/v1/jobs/"), "?")
                };
                let (another, none) = (another.text().await.expect("text"), none.text().await.expect("text"));
                assert_eq!(same(another, path), same(none, unknown), "{method} {rest}");
            }
        }
        refused(service.delete(path).bearer_auth(&theirs), 404, "not-found").await;
    }
    let list = json(service.get("/v1/jobs?limit=1").bearer_auth(&theirs)).await;
    assert_eq!((list["jobs"][0]["id"].clone(), list["next"].clone()), (own["id"].clone(), Value::Null));
    // the other's cursor opens nothing
    let first = json(service.get("/v1/jobs?limit=1").bearer_auth(&mine)).await;
    let cursor = text(&first["next"]);
    let list = json(service.get(&format!("/v1/jobs?cursor={cursor}")).bearer_auth(&theirs)).await;
    assert!(list["jobs"].as_array().expect("a list").iter().all(|job| job["id"] == own["id"]), "{list}");
    // and the owner still has everything
    assert_eq!(json(service.get("/v1/jobs").bearer_auth(&mine)).await["jobs"].as_array().map(Vec::len), Some(2));
    assert_eq!(service.delete(path(&flat)).bearer_auth(&mine).send().await.expect("answered").status(), 204);
}

#[tokio::test]
async fn metrics_and_workers_are_for_who_may_read_them() {
    let (folder, [mine, _, monitoring]) = tokens();
    let service = with_tokens(folder.path()).await;
    for path in ["/metrics", "/v1/workers"] {
        let detail = refused(service.get(path).bearer_auth(&mine), 403, "forbidden").await;
        assert!(detail.starts_with(path) && detail.contains("--metrics"), "{detail}");
        assert_eq!(service.get(path).bearer_auth(&monitoring).send().await.expect("answered").status(), 200);
    }
    // announced while the service starts
    until(async || {
        json(service.get("/v1/workers").bearer_auth(&monitoring)).await["workers"][0]["version"]
            == env!("CARGO_PKG_VERSION")
    })
    .await;
}

#[tokio::test]
async fn the_file_is_read_again_and_a_broken_one_changes_nothing() {
    let (folder, [mine, theirs, _]) = tokens();
    let service = with_tokens(folder.path()).await;
    let path = folder.path().join("tokens.json");
    let status =
        async |token: &str| service.get("/v1/jobs").bearer_auth(token).send().await.expect("answered").status();
    assert_eq!(status(&mine).await, 200);
    let id = mine.split('_').nth(1).expect("an id").to_owned();
    TokenFile::change(&path, |file| Ok(file.revoke(&id).map(ToOwned::to_owned))).expect("changed");
    until(async || status(&mine).await == 401).await;
    assert_eq!(status(&theirs).await, 200);
    std::fs::write(&path, "{").expect("written");
    let ready = async || json(service.get("/readyz")).await;
    until(async || ready().await["status"] == "degraded").await;
    assert_eq!(ready().await["conditions"][0]["part"], "tokens");
    assert_eq!(status(&theirs).await, 200);
    std::fs::remove_file(&path).expect("removed");
    let new = TokenFile::change(&path, |file| file.add("new")).expect("made").reveal();
    until(async || status(&new).await == 200).await;
    assert_eq!(status(&theirs).await, 401);
    until(async || ready().await["status"] == "ok").await;
}

/// Kubernetes mounts a secret as links to a folder, which is another one after a change.
#[cfg(unix)]
#[tokio::test]
async fn a_mounted_secret_is_read_again_when_it_changes_and_once_it_can_be_read() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let permit = |version: &str, mode| {
        let permissions = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(at(version).join("tokens.json"), permissions).expect("changed");
    };
    let mount = |version: &str, mode| {
        std::fs::create_dir(at(version)).expect("made");
        let token = TokenFile::change(&at(version).join("tokens.json"), |file| Ok(file.add("acme")?.reveal()));
        permit(version, mode);
        symlink(version, at("new")).expect("linked");
        std::fs::rename(at("new"), at("..data")).expect("swapped");
        token.expect("made")
    };
    let first = mount("1", 0o440);
    symlink("..data/tokens.json", at("tokens.json")).expect("linked");
    let service = with_tokens(folder.path()).await;
    let status =
        async |token: &str| service.get("/v1/jobs").bearer_auth(token).send().await.expect("answered").status();
    assert_eq!(status(&first).await, 200);
    let second = mount("2", 0o440);
    until(async || status(&second).await == 200).await;
    assert_eq!(status(&first).await, 401);
    let third = mount("3", 0o666);
    until(async || json(service.get("/readyz")).await["status"] == "degraded").await;
    assert_eq!(status(&second).await, 200, "the tokens are as they were before");
    assert_eq!(status(&third).await, 401);
    // neither time nor length of the file changes
    permit("3", 0o440);
    until(async || status(&third).await == 200).await;
}

#[tokio::test]
async fn a_token_that_is_taken_back_or_replaced_ends_its_streams_and_no_others() {
    let (folder, [mine, ..]) = tokens();
    let path = folder.path().join("tokens.json");
    let another = || TokenFile::change(&path, |file| Ok(file.add("mine")?.reveal())).expect("made");
    let (leaked, other) = (another(), another());
    let id = |token: &str| token.split('_').nth(1).expect("an id").to_owned();
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|settings| settings.access.tokens = Some(path.clone()), device).await;
    let job = json(submit(&service, "clusters=5").bearer_auth(&mine)).await;
    let stream = async |token: &str| {
        let request = service.get(text(&job["urls"]["events"])).bearer_auth(token);
        request.send().await.expect("answered")
    };
    let (mut taken_back, mut replaced, mut stays) = (stream(&mine).await, stream(&leaked).await, stream(&other).await);
    for stream in [&mut taken_back, &mut replaced, &mut stays] {
        assert!(stream.chunk().await.expect("an event").is_some());
    }
    // the job does not go on, so nothing else ends a stream
    let ends = async |stream: reqwest::Response| {
        let rest = tokio::time::timeout(PATIENCE, stream.text()).await.expect("it ends").expect("in order");
        assert!(!rest.contains("event: end"), "{rest}");
    };
    TokenFile::change(&path, |file| Ok(file.revoke(&id(&mine)).map(ToOwned::to_owned))).expect("changed");
    ends(taken_back).await;
    // the same id and tenant, with the secret of a token of another file
    let elsewhere = folder.path().join("elsewhere.json");
    let new = TokenFile::change(&elsewhere, |file| Ok(file.add("mine")?.reveal())).expect("made");
    let read = |path: &Path| -> Value { serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON") };
    let (mut file, from) = (read(&path), read(&elsewhere)["tenants"]["mine"]["tokens"][0].clone());
    let entries = file["tenants"]["mine"]["tokens"].as_array_mut().expect("a list");
    let entry = entries.iter_mut().find(|entry| entry["id"] == id(&leaked)).expect("an entry");
    entry["sha256"] = from["sha256"].clone();
    std::fs::write(&path, file.to_string()).expect("written");
    ends(replaced).await;
    let new = new.replace(&id(&new), &id(&leaked));
    assert_eq!(service.get("/v1/jobs").bearer_auth(new).send().await.expect("answered").status(), 200);
    refused(service.get("/v1/jobs").bearer_auth(leaked), 401, "unauthorized").await;
    gate.open();
    let rest = stays.text().await.expect("in order");
    assert!(rest.contains("event: end"), "{rest}");
}

#[tokio::test]
async fn quotas_of_the_file_hold_for_their_tenant_only() {
    let (folder, [mine, theirs, _]) = tokens();
    TokenFile::change(&folder.path().join("tokens.json"), |file| {
        file.tenants.get_mut("mine").expect("a tenant").quotas.max_queued_jobs = Some(1);
        Ok(())
    })
    .expect("changed");
    let (device, gate) = Held::behind_gate();
    let path = folder.path().join("tokens.json");
    let service = Service::with(
        |settings| {
            settings.access.tokens = Some(path);
            settings.meshes_in_memory = 1;
        },
        device,
    )
    .await;
    // each tenant has a running job: the only place, and the one beside it for a tenant without any
    for token in [&theirs, &mine] {
        let job: Value = json(submit(&service, "clusters=3").bearer_auth(token)).await;
        until(async || json(service.get(crate::support::path(&job)).bearer_auth(token)).await["state"] == "running")
            .await;
    }
    // many at once: never more than the quota
    let sent = (0..8).map(|_| submit(&service, "clusters=3").bearer_auth(&mine).send());
    let mut accepted = 0;
    for response in futures_util::future::join_all(sent).await {
        let response = response.expect("answered");
        if response.status() == 202 {
            accepted += 1;
        } else {
            assert!(response.headers().contains_key("retry-after"));
            assert_eq!(response.status(), 429);
        }
    }
    assert!(accepted <= 1, "{accepted}");
    let response = submit(&service, "clusters=3").bearer_auth(&mine).send().await.expect("answered");
    if accepted == 0 {
        assert_eq!(response.status(), 202);
    }
    let response = submit(&service, "clusters=3").bearer_auth(&mine).send().await.expect("answered");
    problem(response, 429, "queue-full").await;
    assert_eq!(submit(&service, "clusters=3").bearer_auth(&theirs).send().await.expect("answered").status(), 202);
    gate.open();
}

#[tokio::test]
async fn browsers_are_told_to_guess_show_and_keep_nothing() {
    let service = Service::start().await;
    for path in ["/v1/jobs", "/nothing", "/healthz", "/openapi.yaml"] {
        let answer = service.get(path).send().await.expect("answered");
        let header = |name: &str| answer.headers()[name].to_str().expect("text").to_owned();
        assert_eq!(header("x-content-type-options"), "nosniff");
        assert_eq!(header("x-frame-options"), "DENY");
        assert!(header("content-security-policy").contains("default-src 'none'"));
        assert_eq!(header("referrer-policy"), "no-referrer");
        assert_eq!(header("cache-control"), "no-store");
    }
}
