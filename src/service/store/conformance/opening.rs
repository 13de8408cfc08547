//! Files that a store finds when it is opened: of other versions, of other programs, damaged.

use std::path::Path;

use rusqlite::Connection;

use super::super::tests::RULES;
use super::sqlite::{NAME, in_a_folder, open};
use super::*;
use crate::ops::faults::Faults;
use crate::store::LOCAL_TENANT;

#[tokio::test]
async fn a_file_of_somebody_elses_is_refused_in_one_line() {
    let (_folder, path) = in_a_folder();
    Connection::open(&path).expect("it opens").execute_batch("CREATE TABLE jobs (x)").expect("written");
    let error = Store::open(&path, RULES, Faults::default()).await.expect_err("not ours");
    assert!(error.message.ends_with("jobs.sqlite3: table jobs already exists"), "{error}");
}

#[tokio::test]
async fn tables_of_another_version_are_refused_and_left_alone() {
    for found in [9999, -1] {
        let (_folder, path) = in_a_folder();
        open(&path).await.close().await;
        let connection = Connection::open(&path).expect("it opens");
        connection.pragma_update(None, "user_version", found).expect("written");
        connection.close().expect("closed");
        let before = std::fs::read(&path).expect("readable");
        let error = Store::open(&path, RULES, Faults::default()).await.expect_err("another version");
        for part in [&format!("version {found},"), NAME, "up to 1"] {
            assert!(error.message.contains(part), "{error}");
        }
        assert!(std::fs::read(&path).expect("readable") == before);
    }
}

/// Overwrites pages of the file, without the first one.
fn damage(path: &Path) {
    let mut content = std::fs::read(path).expect("a store");
    content[4096..].fill(0x5a);
    std::fs::write(path, content).expect("written");
}

#[tokio::test]
async fn damage_is_found_when_the_store_is_opened() {
    let (_folder, path) = in_a_folder();
    let store = open(&path).await;
    store.create(new_job()).await.expect("created");
    store.close().await;
    damage(&path);
    let before = std::fs::read(&path).expect("readable");
    let error = Store::open(&path, RULES, Faults::default()).await.expect_err("damaged");
    for part in ["damaged", "backup", NAME] {
        assert!(error.message.contains(part), "{error}");
    }
    assert!(std::fs::read(&path).expect("readable") == before, "it is left as it is");
    std::fs::write(&path, "no database, but a text that is long enough to be taken for one ".repeat(100))
        .expect("written");
    let error = Store::open(&path, RULES, Faults::default()).await.expect_err("no database");
    assert!(error.message.contains("damaged"), "{error}");
}

#[tokio::test]
async fn damage_that_a_reader_finds_fails_the_probe_until_the_store_is_opened_again() {
    let (_folder, path) = in_a_folder();
    let store = Store::open(&path, Rules { max_queued: 1000, ..RULES }, Faults::default()).await.expect("it opens");
    for _ in 0..300 {
        store.create(new_job()).await.expect("created");
    }
    store.close().await;
    let store = open(&path).await;
    let failures = store.statistics().failures;
    damage(&path);
    let query = ListQuery { tenant: LOCAL_TENANT.to_owned(), limit: 1000, ..ListQuery::default() };
    let error = store.list(&query).await.expect_err("damaged");
    assert_eq!(error.kind, Kind::Unavailable, "{error}");
    assert!(!error.message.contains("jobs.sqlite3"), "the remedy is for the operator: {error}");
    assert!(store.statistics().failures > failures, "the service looks");
    for _ in 0..2 {
        let error = store.probe().await.expect_err("damaged");
        assert!(error.message.contains("damaged") && error.message.contains("backup"), "{error}");
    }
}
