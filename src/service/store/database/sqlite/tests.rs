mod opening;

use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Duration;

use tempfile::TempDir;

use super::*;
use crate::error::Error;
use crate::service::faults::FaultPoint;
use crate::service::store::JobStore;
use crate::service::store::conformance::{self, Subject, claims};
use crate::service::store::tests::{RULES, new_job};

/// Stores in folders of their own.
#[derive(Default)]
struct OnDisk(Mutex<Vec<TempDir>>);

const NAME: &str = "jobs.sqlite3";

/// A new folder, and a path for a store in it.
fn in_a_folder() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(NAME);
    (folder, path)
}

/// The store in the file at `path`, without faults.
async fn open(path: &Path) -> SqliteStore {
    SqliteStore::open(path, RULES, Faults::default()).await.expect("it opens")
}

impl OnDisk {
    /// Opens a store in the folder, which becomes the last one.
    async fn open(&self, folder: TempDir, rules: Rules) -> SqliteStore {
        let path = folder.path().join(NAME);
        self.0.lock().expect("no panic").push(folder);
        SqliteStore::open(&path, rules, Faults::default()).await.expect("it opens")
    }
}

#[async_trait]
impl Subject for OnDisk {
    async fn empty(&self, rules: Rules) -> Box<dyn JobStore> {
        Box::new(self.open(tempfile::tempdir().expect("a folder"), rules).await)
    }

    /// A copy of the files of a store that is open: what a crash at this moment would leave.
    async fn after_crash(&self, rules: Rules) -> Option<Box<dyn JobStore>> {
        let copy = tempfile::tempdir().expect("a folder");
        {
            let folders = self.0.lock().expect("no panic");
            let last = folders.last().expect("a store was made").path();
            for name in [NAME.to_owned(), format!("{NAME}-wal")] {
                std::fs::copy(last.join(&name), copy.path().join(&name)).expect("copied");
            }
        }
        Some(Box::new(self.open(copy, rules).await))
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn conforms() {
    conformance::run(&OnDisk::default()).await;
}

#[tokio::test]
async fn a_failed_commit_is_told_loses_nothing_and_passes() {
    let folder = tempfile::tempdir().expect("a folder");
    let faults = Faults::default();
    let store = SqliteStore::open(&folder.path().join(NAME), RULES, faults.clone()).await.expect("it opens");
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

/// An earlier store gives nothing back until it is opened with little in it.
#[tokio::test]
async fn the_disk_gets_the_pages_of_deleted_jobs_back() {
    for was_made_earlier in [false, true] {
        let (_folder, path) = in_a_folder();
        open(&path).await.close().await;
        if was_made_earlier {
            let connection = Place::shared(path.clone()).writing(false).expect("it opens");
            connection.execute_batch("PRAGMA auto_vacuum = NONE; VACUUM").expect("rewritten");
        }
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
        let free = store.free_bytes().await.expect("known");
        assert!(free > 8 << 20, "{free}");
        let mut before = free + 1;
        while store.free_bytes().await.expect("known") < before {
            before = store.free_bytes().await.expect("known");
            store.give_back().await.expect("given back");
        }
        assert_eq!(before, 0);
        let bytes = path.metadata().expect("there").len();
        assert!(bytes < 1 << 20, "{bytes} bytes, made earlier: {was_made_earlier}");
        store.close().await;
    }
}

/// The database itself says that there is no room, as on a full disk.
#[tokio::test]
async fn a_full_database_is_no_room_and_takes_jobs_again_later() {
    let (_folder, path) = in_a_folder();
    open(&path).await.close().await;
    let place = Arc::new(Place::shared(path));
    let connection = place.writing(false).expect("it opens");
    connection.pragma_update(None, "max_page_count", 1).expect("set");
    // the connection that is opened after the failure finds room
    let writer =
        Writer::start(connection, place, Arc::default(), Arc::default(), Faults::default()).expect("it starts");
    let mut large = new_job();
    large.spec.buffers = vec!["x".repeat(1 << 20)];
    let create = move |batch: &mut Batch<'_>| commands::create(batch, &large, &RULES);
    let error = writer.carry_out(create.clone()).await.expect_err("no room");
    assert_eq!(error.kind, Kind::InsufficientStorage, "{error}");
    writer.carry_out(create).await.expect("there is room again");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_command_that_fails_takes_no_other_with_it() {
    let (_folder, path) = in_a_folder();
    let store = Arc::new(open(&path).await);
    let twice = new_job();
    store.create(twice.clone()).await.expect("created");
    let asked: Vec<_> = (0..40)
        .map(|number| {
            let store = Arc::clone(&store);
            // the same id again breaks the transaction it is in
            let job = if number % 10 == 0 { twice.clone() } else { new_job() };
            tokio::spawn(async move { store.create(job).await.is_ok() })
        })
        .collect();
    let mut created = 0;
    for asked in asked {
        created += usize::from(asked.await.expect("no panic"));
    }
    assert_eq!(created, 36);
    assert_eq!(store.counts().await.expect("counted")[0], 37);
}

/// A command with a defect.
fn panics(batch: &mut Batch<'_>) -> Result<(), connections::Abort> {
    connections::execute(batch.connection, "DELETE FROM jobs", [])?;
    panic!("on purpose")
}

#[tokio::test]
async fn a_command_that_panics_fails_alone_and_leaves_nothing() {
    let (_folder, path) = in_a_folder();
    let faults = Faults::default();
    let store = Arc::new(SqliteStore::open(&path, RULES, faults.clone()).await.expect("it opens"));
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
        store.writer.carry_out(panics),
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
    let _store = open(&path).await;
    let readers = Readers::open(Arc::new(Place::shared(path))).expect("it opens");
    let waits = |_: &Connection| {
        let (tell, told) = std::sync::mpsc::channel();
        tokio::spawn(async move { tell.send(()) });
        Ok(told.recv_timeout(Duration::from_secs(10)))
    };
    let told = tokio::spawn(async move { readers.read(waits).await }).await.expect("no panic");
    assert_eq!(told.expect("read"), Ok(()), "another task had its turn");
}

#[tokio::test]
async fn closing_carries_out_what_was_asked_for_and_leaves_one_file() {
    let (_folder, path) = in_a_folder();
    let faults = Faults::default();
    let store = SqliteStore::open(&path, RULES, faults.clone()).await.expect("it opens");
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

/// Whether a crash counts for a suspect of `crashes` crashes that started a minute before a new job, or after it.
async fn is_blamed(crashes: u32, is_last: bool) -> bool {
    let subject = OnDisk::default();
    let store = subject.empty(RULES).await;
    let mut jobs = Vec::new();
    for _ in 0..2 {
        jobs.push(store.create(new_job()).await.expect("created"));
        let claimed = store.claim(1, Duration::from_secs(60)).await.expect("claimable");
        store.begin(claimed[0].0).await.expect("begun");
    }
    let Created::New(suspect) = &jobs[usize::from(is_last)] else { panic!("it is new") };
    {
        let folders = subject.0.lock().expect("no panic");
        let connection = Connection::open(folders[0].path().join(NAME)).expect("it opens");
        let sql = "UPDATE jobs SET suspicion = ?1 WHERE id = ?2";
        assert_eq!(connection.execute(sql, params![crashes, suspect.id.to_string()]), Ok(1));
        let sql = "UPDATE jobs SET started_at = started_at - 60000000 WHERE number = 1";
        assert_eq!(connection.execute(sql, []), Ok(1));
    }
    let again = subject.after_crash(RULES).await.expect("it is durable");
    assert_eq!(again.counts().await.expect("counted")[..2], [2, 0], "both wait");
    again.statistics().attempts_failed > 0
}

#[tokio::test]
async fn a_crash_does_not_count_for_a_suspect_when_a_new_job_started_after_it() {
    assert!(is_blamed(2, true).await, "the suspect started last");
    assert!(!is_blamed(2, false).await, "the new job may be the cause");
    assert!(!is_blamed(1, true).await, "it is no old suspect");
    assert!(is_blamed(5, false).await, "it was in too many crashes");
}

/// `CLAIM_JOBS=5000`, with `-- --nocapture`, gives the figures in `docs/farm.md`.
#[tokio::test(flavor = "multi_thread")]
async fn claimers_of_many_jobs_take_each_once() {
    let jobs = claims::jobs();
    for limit in [1, 8] {
        let (_folder, path) = in_a_folder();
        let rules = Rules { max_queued: jobs, ..RULES };
        let store = SqliteStore::open(&path, rules, Faults::default()).await.expect("it opens");
        claims::claim_all(&vec![Arc::new(store) as Arc<dyn JobStore>; 16], limit, jobs).await;
    }
}
