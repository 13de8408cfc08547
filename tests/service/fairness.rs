//! Tenants beside each other: no tenant's jobs hold another tenant's up.

use serde_json::Value;
use tempfile::TempDir;
use tesserae_mesh::device::Device;
use tesserae_mesh::surface::DualGraph;
use tesserae_service::{Settings, TokenFile};

use crate::support::*;

/// A service for the tenants `many` and `few`, and their tokens.
async fn with_tenants(change: impl FnOnce(&mut Settings), device: Box<dyn Device>) -> (Service, TempDir, [String; 2]) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tokens.json");
    let tokens = ["many", "few"].map(|tenant| {
        TokenFile::change(&path, |file| {
            let token = file.add(tenant)?.reveal();
            let quotas = &mut file.tenants.get_mut(tenant).expect("just made").quotas;
            quotas.max_queued_jobs = Some(1000);
            Ok(token)
        })
        .expect("made")
    });
    let with_tokens = |settings: &mut Settings| {
        settings.access.tokens = Some(path);
        change(settings);
    };
    (Service::with(with_tokens, device).await, folder, tokens)
}

async fn submit(service: &Service, token: &str, query: &str, obj: &[u8]) -> Value {
    json(service.obj(query, obj.to_vec()).bearer_auth(token)).await
}

async fn job(service: &Service, token: &str, job: &Value) -> Value {
    json(service.get(path(job)).bearer_auth(token)).await
}

async fn reaches(service: &Service, token: &str, job: &Value, state: &str) -> Value {
    until(async || self::job(service, token, job).await["state"] == state).await;
    self::job(service, token, job).await
}

#[tokio::test]
async fn a_job_starts_beside_256_queued_ones_of_another_tenant() {
    let (device, gate) = Held::behind_gate();
    let (service, _folder, [many, few]) = with_tenants(|settings| settings.meshes_in_memory = 1, device).await;
    let mesh = sphere(60);
    let mut others = Vec::new();
    for _ in 0..257 {
        others.push(submit(&service, &many, "clusters=5", &mesh).await);
    }
    reaches(&service, &many, &others[0], "running").await;
    let small = submit(&service, &few, "clusters=5", &mesh).await;
    // nothing has ended yet: what is claimed needs no other job's end
    reaches(&service, &few, &small, "running").await;
    gate.open();
    let small = reaches(&service, &few, &small, "succeeded").await;
    let page = json(service.get("/v1/jobs?limit=1000").bearer_auth(&many)).await;
    let others = page["jobs"].as_array().expect("jobs");
    assert_eq!(others.len(), 257);
    let ended = others.iter().filter_map(|other| other["ended_at"].as_str());
    let before = ended.filter(|ended| *ended < text(&small["ended_at"])).count();
    assert!(before <= 3, "{before} jobs of the other tenant ended before");
}

/// A cpu that holds meshes of more than 30,000 faces behind a gate, and takes several meshes at a time.
fn long(gate: &Gate) -> Box<dyn Device> {
    let (held, again) = (gate.clone(), gate.clone());
    let before = move |graph: &DualGraph, _| {
        if graph.faces() > 30_000 {
            held.pass();
        }
        Ok(())
    };
    let mut device = Around::new(before);
    device.another = Some(Box::new(move || long(&again)));
    Box::new(device)
}

#[tokio::test]
async fn a_short_job_waits_for_no_long_one_of_another_tenant() {
    let gate = Gate::default();
    let (service, _folder, [many, few]) = with_tenants(|settings| settings.meshes_in_memory = 2, long(&gate)).await;
    let long = sphere(40_000);
    let mut others = Vec::new();
    for _ in 0..3 {
        others.push(submit(&service, &many, "clusters=5&quality=fast", &long).await);
    }
    for other in &others[..2] {
        reaches(&service, &many, other, "running").await;
    }
    // more than a small mesh has, which go another way
    let mesh = sphere(9_000);
    let short = submit(&service, &few, "clusters=20", &mesh).await;
    let short = reaches(&service, &few, &short, "succeeded").await;
    assert_eq!(job(&service, &many, &others[0]).await["state"], "running");
    gate.open();
    let again = submit(&service, &few, "clusters=20", &mesh).await;
    let again = reaches(&service, &few, &again, "succeeded").await;
    let mut digests = Vec::new();
    for ended in [&short, &again] {
        digests
            .push(json(service.get(text(&ended["urls"]["report"])).bearer_auth(&few)).await["labels_sha256"].clone());
    }
    assert_eq!(digests[0], digests[1]);
    for other in &others {
        reaches(&service, &many, other, "succeeded").await;
    }
}

#[tokio::test]
async fn lists_tell_nothing_about_the_jobs_of_other_tenants() {
    let (device, gate) = Held::behind_gate();
    let (service, _folder, [many, few]) = with_tenants(|settings| settings.meshes_in_memory = 1, device).await;
    let mesh = sphere(300);
    for _ in 0..20 {
        submit(&service, &many, "clusters=5", &mesh).await;
    }
    let mut own = Vec::new();
    for _ in 0..3 {
        own.push(submit(&service, &few, "clusters=5", &mesh).await);
    }
    reaches(&service, &few, &own[0], "running").await;
    let last = job(&service, &few, &own[2]).await;
    assert_eq!(last["queue_position"], 2, "its own jobs count only");
    let page = json(service.get("/v1/jobs?limit=1").bearer_auth(&few)).await;
    let cursor = text(&page["next"]);
    let (time, id) = cursor.split_once('-').expect("time and id of the last job, which it knows");
    assert_eq!((time.parse::<u64>().is_ok(), id), (true, text(&own[2]["id"])));
    let next = json(service.get(&format!("/v1/jobs?limit=9&cursor={cursor}")).bearer_auth(&few)).await;
    let ids: Vec<&Value> = next["jobs"].as_array().expect("jobs").iter().map(|job| &job["id"]).collect();
    assert_eq!(ids, [&own[1]["id"], &own[0]["id"]]);
    gate.open();
}
