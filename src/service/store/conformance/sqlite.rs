//! The store in a file.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use parking_lot::Mutex;
use rusqlite::Connection;
use tempfile::TempDir;

use super::super::database::{Abort, Rows};
use super::*;
use crate::ops::faults::{FaultPoint, Faults};
use crate::store::LOCAL_TENANT;

const NAME: &str = "jobs.sqlite3";

/// A new folder, and a path for a store in it.
fn in_a_folder() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(NAME);
    (folder, path)
}

/// The store in the file at `path`, without faults.
async fn open(path: &Path) -> Store {
    Store::open(path, false, RULES, Faults::default()).await.expect("it opens")
}

/// A store in a new folder, and its path.
async fn new_store(rules: Rules, faults: Faults) -> (TempDir, PathBuf, Store) {
    let (folder, path) = in_a_folder();
    let store = Store::open(&path, false, rules, faults).await.expect("it opens");
    (folder, path, store)
}

#[tokio::test(flavor = "multi_thread")]
async fn conforms() {
    let folders = Mutex::new(Vec::new());
    let last = || folders.lock().last().map(|(_, path): &(TempDir, PathBuf)| path.clone()).expect("a store was made");
    let empty = async |rules| {
        folders.lock().push(in_a_folder());
        Store::open(&last(), false, rules, Faults::default()).await.expect("it opens")
    };
    // a copy of the files of a store that is open: what a crash at this moment would leave
    let after_crash = async || {
        let (folder, copy) = in_a_folder();
        for end in ["", "-wal"] {
            let [from, to] = [&last(), &copy].map(|path| format!("{}{end}", path.display()));
            std::fs::copy(from, to).expect("copied");
        }
        folders.lock().push((folder, copy));
        open(&last()).await
    };
    run(empty, after_crash).await;
}

#[tokio::test]
async fn a_failed_commit_is_told_loses_nothing_and_passes() {
    let faults = Faults::default();
    let (_folder, _, store) = new_store(RULES, faults.clone()).await;
    let kept = new_job();
    store.create(kept.clone()).await.expect("created");
    for (kind, expected) in [
        (ErrorKind::StorageFull, Kind::InsufficientStorage),
        (ErrorKind::ReadOnlyFilesystem, Kind::Unavailable),
        (ErrorKind::NotFound, Kind::Unavailable),
    ] {
        faults.arm(FaultPoint::Commit, kind, 0, 1);
        let refused = new_job();
        assert_eq!(store.create(refused.clone()).await.expect_err("it fails").kind, expected);
        assert_eq!(store.get(refused.id).await, Ok(None), "nothing is left of it");
        assert!(store.get(kept.id).await.expect("readable").is_some());
        store.create(refused).await.expect("the disk is back");
    }
    assert_eq!(store.statistics().failures, 3);
}

#[tokio::test]
async fn the_disk_gets_the_pages_of_deleted_jobs_back() {
    let (_folder, path, store) = new_store(RULES, Faults::default()).await;
    let mut jobs = Vec::new();
    for _ in 0..10 {
        let mut job = new_job();
        job.spec.buffers = vec!["x".repeat(1 << 20)];
        jobs.push(job.id);
        store.create(job).await.expect("created");
    }
    for id in jobs {
        store.cancel(id).await.expect("cancelled");
        assert_eq!(store.delete(id).await, Ok(Deletion::Deleted));
    }
    let bytes = || path.metadata().expect("there").len();
    assert!(bytes() > 8 << 20, "{} bytes", bytes());
    for _ in 0..5 {
        store.give_back().await.expect("given back");
    }
    assert!(bytes() < 1 << 20, "{} bytes", bytes());
    store.close().await;
}

/// The database itself says that there is no room, as on a full disk.
#[tokio::test]
async fn a_full_database_is_no_room_and_takes_jobs_again_later() {
    let (_folder, _, store) = new_store(RULES, Faults::default()).await;
    // of the connection that writes; the one that is opened after the failure finds room
    let limited = store.change("test", |change| change.rows.query("PRAGMA max_page_count = 1", Vec::new()));
    limited.await.expect("set");
    let mut large = new_job();
    large.spec.buffers = vec!["x".repeat(1 << 20)];
    let error = store.create(large.clone()).await.expect_err("no room");
    assert_eq!(error.kind, Kind::InsufficientStorage, "{error}");
    store.create(large).await.expect("there is room again");
}

#[tokio::test]
async fn a_row_whose_text_is_damaged_stops_no_other() {
    let (_folder, _, store) = new_store(RULES, Faults::default()).await;
    let [damaged, other] = [create(&store).await.id, create(&store).await.id];
    let sql = "UPDATE jobs SET spec = CAST(x'ff' AS TEXT), request_digest = CAST(x'ff' AS TEXT) WHERE number = 1";
    store.change("test", |change| change.rows.write(sql, Vec::new())).await.expect("written");
    assert_eq!(store.get(damaged).await.expect_err("no spec").kind, Kind::Internal);
    assert_eq!(jobs_of(&store.claim(9, LEASE).await.expect("the other")), [other]);
}

#[tokio::test]
async fn a_file_that_is_removed_or_replaced_is_noticed() {
    let (_folder, path, store) = new_store(RULES, Faults::default()).await;
    assert_eq!(store.probe().await, Ok(()));
    for replace in [|path: &Path| std::fs::remove_file(path), |path: &Path| std::fs::write(path, "")] {
        replace(&path).expect("done");
        assert_eq!(store.probe().await.expect_err("another file, or none").kind, Kind::Unavailable);
        assert_eq!(store.create(new_job()).await.expect_err("it would be lost").kind, Kind::Unavailable);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_command_that_fails_takes_no_other_with_it() {
    let (_folder, _, store) = new_store(RULES, Faults::default()).await;
    let asked = join_all((0..40).map(async |number| match number % 10 {
        // it breaks the transaction that it is in
        0 => {
            let sql = "INSERT INTO identity (id, name) VALUES (1, '')";
            store.change("test", move |change| change.rows.write(sql, Vec::new())).await
        }
        _ => store.create(new_job()).await.map(drop),
    }));
    let created = asked.await.iter().filter(|asked| asked.is_ok()).count();
    assert_eq!(created, 36);
    assert_eq!(store.counts().await.expect("counted")[0], 36);
}

#[tokio::test]
async fn a_command_that_panics_fails_alone_and_leaves_nothing() {
    let faults = Faults::default();
    let (_folder, _, store) = new_store(RULES, faults.clone()).await;
    let store = Arc::new(store);
    faults.hold(FaultPoint::Commit);
    let first = Arc::clone(&store);
    let first = tokio::spawn(async move { first.create(new_job()).await.map(drop) });
    while faults.waiting(FaultPoint::Commit) == 0 {
        tokio::task::yield_now().await;
    }
    // sent while the writer waits, so that they share a transaction
    let (before, defect, after, ()) = tokio::join!(
        biased;
        store.create(new_job()),
        store.change("test", |change| -> Result<(), Abort> {
            change.rows.write("DELETE FROM jobs", Vec::new())?;
            panic!("on purpose")
        }),
        store.create(new_job()),
        async { faults.disarm() },
    );
    assert_eq!(first.await.expect("no panic"), Ok(()));
    assert_eq!(defect.expect_err("a defect").kind, Kind::Internal);
    assert!(before.is_ok() && after.is_ok());
    assert_eq!(store.counts().await.expect("counted")[0], 3);
    assert_eq!(store.statistics().failures, 2, "once together, once alone");
    store.create(new_job()).await.expect("the writer is still there");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn a_read_that_waits_leaves_the_runtimes_only_thread_to_others() {
    let (_folder, _, store) = new_store(RULES, Faults::default()).await;
    let waits = |_: &mut dyn Rows| {
        let (tell, told) = std::sync::mpsc::channel();
        tokio::spawn(async move { tell.send(()) });
        Ok(told.recv_timeout(Duration::from_secs(100)))
    };
    let told = tokio::spawn(async move { store.read("test", waits).await }).await.expect("no panic");
    assert_eq!(told.expect("read"), Ok(()), "another task had its turn");
}

#[tokio::test]
async fn closing_carries_out_what_was_asked_for_and_leaves_one_file() {
    let faults = Faults::default();
    let (_folder, path, store) = new_store(RULES, faults.clone()).await;
    store.create(new_job()).await.expect("created");
    faults.hold(FaultPoint::Commit);
    let (created, (), ()) = tokio::join!(biased; store.create(new_job()), store.close(), async { faults.disarm() });
    created.expect("asked for before");
    assert_eq!(store.create(new_job()).await.expect_err("closed").kind, Kind::Unavailable);
    assert_eq!(store.counts().await.expect_err("closed").kind, Kind::Unavailable);
    let left = std::fs::read_dir(path.parent().expect("a folder")).expect("readable");
    let left: Vec<_> = left.map(|entry| entry.expect("one").file_name()).collect();
    assert_eq!(left, [NAME]);
    let again = open(&path).await;
    assert_eq!(again.counts().await.expect("counted")[0], 2);
}

/// `CLAIM_JOBS=5000`, with `-- --nocapture`, gives the figures in `docs/farm.md`.
#[tokio::test(flavor = "multi_thread")]
async fn claimers_of_many_jobs_take_each_once() {
    let jobs = at_once::jobs();
    for limit in [1, 8] {
        let (_folder, _, store) = new_store(Rules { max_queued: jobs, ..RULES }, Faults::default()).await;
        let store = Arc::new(store);
        let claimers: Vec<_> = (0..16).map(|_| Arc::clone(&store)).collect();
        at_once::claim_all(&claimers, limit, jobs).await;
    }
}

#[tokio::test]
async fn a_file_of_somebody_elses_is_refused_in_one_line() {
    let (_folder, path) = in_a_folder();
    Connection::open(&path).expect("it opens").execute_batch("CREATE TABLE jobs (x)").expect("written");
    let error = Store::open(&path, false, RULES, Faults::default()).await.err().expect("not ours");
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
        let error = Store::open(&path, false, RULES, Faults::default()).await.err().expect("another version");
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
    let (_folder, path, store) = new_store(RULES, Faults::default()).await;
    store.create(new_job()).await.expect("created");
    store.close().await;
    damage(&path);
    let before = std::fs::read(&path).expect("readable");
    let error = Store::open(&path, false, RULES, Faults::default()).await.err().expect("damaged");
    for part in ["damaged", "backup", NAME] {
        assert!(error.message.contains(part), "{error}");
    }
    assert!(std::fs::read(&path).expect("readable") == before, "it is left as it is");
    std::fs::write(&path, "no database, but a text that is long enough to be taken for one ".repeat(100))
        .expect("written");
    let error = Store::open(&path, false, RULES, Faults::default()).await.err().expect("no database");
    assert!(error.message.contains("damaged"), "{error}");
}

#[tokio::test]
async fn damage_that_a_reader_finds_fails_the_probe_until_the_store_is_opened_again() {
    let (_folder, path, store) = new_store(Rules { max_queued: 1000, ..RULES }, Faults::default()).await;
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
