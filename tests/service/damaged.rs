//! Stored results that are not what was stored: an error, a metric, and never an answer.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::Value;

use crate::support::*;

/// What a client got: all bytes, or a problem of that kind.
#[derive(Debug, PartialEq)]
enum Got {
    Whole(Vec<u8>),
    Problem(String),
}

async fn get(service: &Service, url: &str) -> Got {
    let response = service.get(url).send().await.expect("answered");
    if response.status() == 200 {
        return Got::Whole(response.bytes().await.expect("whole").to_vec());
    }
    assert_eq!(response.status(), 500, "{url}");
    let problem: Value = response.json().await.expect("JSON");
    assert!(text(&problem["detail"]).contains("submit the mesh again"), "{problem}");
    Got::Problem(text(&problem["type"]).to_owned())
}

/// The files of the result of the only job.
fn files(service: &Service) -> Vec<PathBuf> {
    service.files().into_iter().filter(|file| file.to_string_lossy().contains("results")).collect()
}

/// A job that succeeded, and its urls with these ends.
async fn done(service: &Service, query: &str, faces: u64, ends: &[&str]) -> Vec<String> {
    let job = service.submit(query, sphere(faces)).await;
    let job = service.ended(&job).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    ends.iter().map(|end| format!("{}/{end}", path(&job))).collect()
}

/// Damages each file in turn, and checks that no answer has other bytes than before. Gives the urls that failed, by the
/// file.
async fn damaging(service: &Service, urls: &[String]) -> BTreeMap<String, Vec<String>> {
    let mut before = Vec::new();
    for url in urls {
        before.push(get(service, url).await);
    }
    assert!(before.iter().all(|got| matches!(got, Got::Whole(_))), "{before:?}");
    let mut failed: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in files(service) {
        let sound = std::fs::read(&file).expect("readable");
        let name = file.file_name().expect("a name").to_string_lossy().into_owned();
        let mut flipped = sound.clone();
        let last = flipped.len().saturating_sub(4);
        flipped[last..].iter_mut().for_each(|byte| *byte ^= 0xff);
        let damages = [("flipped", &flipped[..]), ("cut", &sound[..sound.len() / 2]), ("empty", b"")];
        for (how, damaged) in damages {
            std::fs::write(&file, damaged).expect("written");
            for (url, before) in urls.iter().zip(&before) {
                match get(service, url).await {
                    Got::Problem(kind) => assert_eq!(kind, "/problems/damaged", "{name} {how} {url}"),
                    whole => {
                        assert!(whole == *before, "{name} {how}: {url} gives other bytes");
                        continue;
                    }
                }
                let end = url.rsplit('/').next().expect("an end").to_owned();
                let of_file = failed.entry(format!("{name} {how}")).or_default();
                of_file.push(end);
            }
        }
        std::fs::write(&file, &sound).expect("written");
    }
    for (url, before) in urls.iter().zip(&before) {
        assert!(get(service, url).await == *before, "{url}: sound again");
    }
    failed
}

#[tokio::test]
async fn damaged_files_of_a_flat_clustering_are_never_served() {
    let service = Service::start().await;
    let urls = done(
        &service,
        "clusters=9&keep_mesh=true&outputs=submeshes.zip&snapshots=0",
        // more than is checked in memory
        80_000,
        &[
            "labels",
            "labels?format=npy",
            "labels?format=bin",
            "labels?iteration=0",
            "report",
            "submeshes?format=zip",
            "mesh?format=ply",
        ],
    )
    .await;
    assert_eq!(metric(&service, "tesserae_results_damaged_total").await, 0.0);
    let failed = damaging(&service, &urls).await;
    let labels = ["labels", "labels?format=npy", "labels?format=bin", "mesh?format=ply"];
    for (file, expected) in [
        ("labels.npy", &labels[..]),
        ("report.json", &["report"]),
        ("mesh.kept", &["mesh?format=ply"]),
        ("submeshes.zip", &["submeshes?format=zip"]),
        ("snapshots.npy", &["labels?iteration=0"]),
        ("snapshots.json", &["labels?iteration=0"]),
    ] {
        for how in ["flipped", "cut", "empty"] {
            assert_eq!(failed[&format!("{file} {how}")], expected, "{file} {how}");
        }
    }
    assert!(metric(&service, "tesserae_results_damaged_total").await >= 27.0);

    // of a range, the length of the file is checked; of one that has all bytes, everything
    let labels = files(&service).into_iter().find(|file| file.ends_with("labels.npy")).expect("a file");
    let sound = std::fs::read(&labels).expect("readable");
    let range = || service.get(&urls[1]).header("range", "bytes=1000-1999");
    assert_eq!(range().send().await.expect("answered").status(), 206);
    let mut other_labels = sound.clone();
    let count = other_labels.len();
    other_labels[count - 4] = (other_labels[count - 4] + 1) % 9;
    std::fs::write(&labels, &other_labels).expect("written");
    refused(service.get(&urls[1]).header("range", "bytes=0-"), 500, "damaged").await;
    std::fs::remove_file(&labels).expect("removed");
    refused(service.get(&urls[1]), 500, "damaged").await;
    refused(range(), 500, "damaged").await;
    std::fs::write(&labels, &sound[..sound.len() - 1]).expect("written");
    let detail = refused(range(), 500, "damaged").await;
    assert!(detail.contains(&sound.len().to_string()), "{detail}");
}

#[tokio::test]
async fn damaged_hierarchies_are_never_served() {
    let service = Service::start().await;
    let urls = done(
        &service,
        "algorithm=pml&keep_mesh=true",
        12_000,
        &[
            "hierarchy?format=tsr",
            "hierarchy?format=json",
            "labels?clusters=1",
            "labels?clusters=50",
            "mesh?clusters=50&format=ply",
        ],
    )
    .await;
    let failed = damaging(&service, &urls).await;
    for how in ["cut", "empty"] {
        assert_eq!(failed[&format!("hierarchy.tsr {how}")].len(), urls.len(), "{how}");
        assert_eq!(failed[&format!("mesh.kept {how}")], ["mesh?clusters=50&format=ply"], "{how}");
    }
    // a cut reads what it needs, and that has checksums of its own
    let flipped = &failed["hierarchy.tsr flipped"];
    assert!(
        flipped.starts_with(&["hierarchy?format=tsr".to_owned(), "hierarchy?format=json".to_owned()]),
        "{flipped:?}"
    );
}

#[tokio::test]
async fn damaged_results_in_the_store_of_jobs_are_never_served() {
    let mut service = Service::start().await;
    let ends = ["labels", "labels?format=npy", "report"];
    let urls = done(&service, "clusters=9", 500, &ends).await;
    assert!(files(&service).is_empty(), "it is small");
    let data = service.folder();
    for (sql, failing) in [
        (
            "UPDATE blobs SET bytes = CAST(substr(bytes, 1, length(bytes) - 1) || x'7f' AS BLOB) \
             WHERE name = 'labels.npy'",
            &ends[..2],
        ),
        ("UPDATE blobs SET bytes = substr(bytes, 1, 200) WHERE name = 'labels.npy'", &ends[..2]),
        ("UPDATE blobs SET bytes = CAST(bytes || x'20' AS BLOB) WHERE name = 'report.json'", &ends[..]),
    ] {
        service.stopped().await;
        let database = rusqlite::Connection::open(data.path().join("jobs.sqlite3")).expect("it opens");
        assert_eq!(database.execute(sql, []), Ok(1));
        database.close().expect("closed");
        service = service.again(|_| {}).await;
        for url in &urls {
            let is_failing = failing.iter().any(|end| url.ends_with(&format!("/{end}")));
            let got = get(&service, url).await;
            assert_eq!(got == Got::Problem("/problems/damaged".to_owned()), is_failing, "{sql}: {url}");
        }
    }
    // and it can be deleted
    let job = urls[2].trim_end_matches("/report");
    assert_eq!(service.delete(job).send().await.expect("answered").status(), 204);
}
