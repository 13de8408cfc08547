//! The store in a file.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use tempfile::TempDir;

use super::super::database::rows::{Abort, Rows};
use super::super::tests::RULES;
use super::{claims, *};
use crate::ops::faults::{FaultPoint, Faults};

/// Stores in folders of their own.
#[derive(Default)]
struct OnDisk(Mutex<Vec<TempDir>>);

pub const NAME: &str = "jobs.sqlite3";

/// A new folder, and a path for a store in it.
pub fn in_a_folder() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(NAME);
    (folder, path)
}

/// The store in the file at `path`, without faults.
pub async fn open(path: &Path) -> Store {
    Store::open(path, RULES, Faults::default()).await.expect("it opens")
}

impl OnDisk {
    /// Opens a store in the folder, which becomes the last one.
    async fn open(&self, folder: TempDir, rules: Rules) -> Store {
        let path = folder.path().join(NAME);
        self.0.lock().expect("no panic").push(folder);
        Store::open(&path, rules, Faults::default()).await.expect("it opens")
    }
}

impl Subject for OnDisk {
    async fn empty(&self, rules: Rules) -> Store {
        self.open(tempfile::tempdir().expect("a folder"), rules).await
    }

    /// A copy of the files of a store that is open: what a crash at this moment would leave.
    async fn after_crash(&self, rules: Rules) -> Store {
        let copy = tempfile::tempdir().expect("a folder");
        {
            let folders = self.0.lock().expect("no panic");
            let last = folders.last().expect("a store was made").path();
            for name in [NAME.to_owned(), format!("{NAME}-wal")] {
                std::fs::copy(last.join(&name), copy.path().join(&name)).expect("copied");
            }
        }
        self.open(copy, rules).await
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn conforms() {
    run(&OnDisk::default()).await;
}

#[tokio::test]
async fn a_failed_commit_is_told_loses_nothing_and_passes() {
    let folder = tempfile::tempdir().expect("a folder");
    let faults = Faults::default();
    let store = Store::open(&folder.path().join(NAME), RULES, faults.clone()).await.expect("it opens");
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
    let (_folder, path) = in_a_folder();
    let store = open(&path).await;
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
    let (_folder, path) = in_a_folder();
    let store = open(&path).await;
    // of the connection that writes; the one that is opened after the failure finds room
    let limit = |change: &mut super::super::change::Transaction<'_>| {
        change.rows.query("PRAGMA max_page_count = 1", Vec::new()).map(drop)
    };
    store.change("test", limit).await.expect("set");
    let mut large = new_job();
    large.spec.buffers = vec!["x".repeat(1 << 20)];
    let error = store.create(large.clone()).await.expect_err("no room");
    assert_eq!(error.kind, Kind::InsufficientStorage, "{error}");
    store.create(large).await.expect("there is room again");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_command_that_fails_takes_no_other_with_it() {
    let (_folder, path) = in_a_folder();
    let store = open(&path).await;
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

/// A command with a defect.
fn panics(change: &mut super::super::change::Transaction<'_>) -> Result<(), Abort> {
    change.rows.write("DELETE FROM jobs", Vec::new())?;
    panic!("on purpose")
}

#[tokio::test]
async fn a_command_that_panics_fails_alone_and_leaves_nothing() {
    let (_folder, path) = in_a_folder();
    let faults = Faults::default();
    let store = Arc::new(Store::open(&path, RULES, faults.clone()).await.expect("it opens"));
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
        store.change("test", panics),
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
    let (_folder, path) = in_a_folder();
    let store = open(&path).await;
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
    let (_folder, path) = in_a_folder();
    let faults = Faults::default();
    let store = Store::open(&path, RULES, faults.clone()).await.expect("it opens");
    store.create(new_job()).await.expect("created");
    faults.hold(FaultPoint::Commit);
    let (created, (), ()) = tokio::join!(biased; store.create(new_job()), store.close(), async { faults.disarm() });
    created.expect("asked for before");
    assert_eq!(store.create(new_job()).await.expect_err("closed").kind, Kind::Unavailable);
    assert_eq!(store.counts().await.expect_err("closed").kind, Kind::Unavailable);
    let left: Vec<_> = std::fs::read_dir(path.parent().expect("a folder"))
        .expect("readable")
        .map(|entry| entry.expect("one").file_name())
        .collect();
    assert_eq!(left, [NAME]);
    let again = open(&path).await;
    assert_eq!(again.counts().await.expect("counted")[0], 2);
}

/// `CLAIM_JOBS=5000`, with `-- --nocapture`, gives the figures in `docs/farm.md`.
#[tokio::test(flavor = "multi_thread")]
async fn claimers_of_many_jobs_take_each_once() {
    let jobs = claims::jobs();
    for limit in [1, 8] {
        let (_folder, path) = in_a_folder();
        let rules = Rules { max_queued: jobs, ..RULES };
        let store = Store::open(&path, rules, Faults::default()).await.expect("it opens");
        let store = Arc::new(store);
        let claimers: Vec<_> = (0..16).map(|_| Arc::clone(&store)).collect();
        claims::claim_all(&claimers, limit, jobs).await;
    }
}
