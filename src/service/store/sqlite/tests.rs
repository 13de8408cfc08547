use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Duration;

use tempfile::TempDir;

use super::*;
use crate::service::faults::FaultPoint;
use crate::service::store::JobStore;
use crate::service::store::conformance::{self, Subject};
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
            let connection = connections::writing(&path, false).expect("it opens");
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
    let connection = connections::writing(&path, false).expect("it opens");
    connection.pragma_update(None, "max_page_count", 1).expect("set");
    // the connection that is opened after the failure finds room
    let writer = Writer::start(connection, path, Arc::default(), Arc::default(), Faults::default()).expect("it starts");
    let mut large = new_job();
    large.spec.buffers = vec!["x".repeat(1 << 20)];
    let create = move |batch: &mut writer::Batch<'_>| commands::create(batch, &large, &RULES);
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
fn panics(batch: &mut writer::Batch<'_>) -> Result<(), connections::Abort> {
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
    let readers = Readers::open(&path).expect("it opens");
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

/// Tables as they were before ends to be told had one of their own.
#[tokio::test]
async fn an_end_that_was_to_be_told_before_an_update_is_told_after_it() {
    let (_folder, path) = in_a_folder();
    let mut connection = connections::writing(&path, true).expect("it opens");
    schema::migrate_to(2, &mut connection).expect("made");
    let error = Error::new(Kind::InvalidMesh, "x");
    let mut told = Vec::new();
    for (untold, webhook, state, problem) in [
        (Some(2), Some("https://b.example/"), State::Succeeded, None),
        (None, None, State::Succeeded, None),
        (Some(1), Some("https://a.example/"), State::Failed, Some(error)),
        (None, Some("https://c.example/"), State::Succeeded, None),
    ] {
        let NewJob { id, mut spec, .. } = new_job();
        spec.webhook = webhook.map(ToOwned::to_owned);
        let sql = "INSERT INTO jobs (id, tenant, state, spec, progress, problem, untold, created_at, ended_at) \
                   VALUES (?1, ?2, ?3, ?4, '{}', ?5, ?6, 1, 2)";
        let problem_json = problem.as_ref().map(|problem| rows::json(problem).expect("JSON"));
        let spec_json = rows::json(&spec).expect("JSON");
        let row = params![id.to_string(), spec.tenant, state.name(), spec_json, problem_json, untold];
        connection.execute(sql, row).expect("written");
        if let (Some(place), Some(webhook)) = (untold, spec.webhook) {
            let ended_at = rows::time(2);
            told.push((place, Notice { job: id, webhook, trace_parent: None, state, problem, ended_at, end: 1 }));
        }
    }
    connection.close().expect("closed");
    told.sort_by_key(|(place, _)| *place);
    let store = open(&path).await;
    let untold = store.untold().await.expect("readable");
    assert_eq!(untold, told.iter().map(|(_, notice)| notice.job).collect::<Vec<_>>());
    for (id, (_, expected)) in untold.into_iter().zip(told) {
        assert_eq!(store.notice(id).await.expect("readable"), Some(expected));
    }
    assert_eq!(store.list(&ListQuery { limit: 9, ..ListQuery::default() }).await.expect("listed").jobs.len(), 4);
}

/// The bookkeeping of migrations as a table of sqlx's, with the checksums that it had for the first three.
const BY_ROWS: &str = "
CREATE TABLE _sqlx_migrations (
    version BIGINT PRIMARY KEY,
    description TEXT NOT NULL,
    installed_on TIMESTAMP NOT NULL DEFAULT CURRENT_TIMESTAMP,
    success BOOLEAN NOT NULL,
    checksum BLOB NOT NULL,
    execution_time BIGINT NOT NULL
);
INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) VALUES
    (1, 'jobs and events', 1,
     x'AF1D01B559AF86D06BB2905040BBC0CAF5A681658210F5CC9813A60E8ADC4CA4A14914534767A14E53663A566CEA42DB', 1234567),
    (2, 'small blobs', 1,
     x'38CF0710A226B78C9BED54EC4E33DEDA3B4A4D04FC831ECFF721954874498F34EDF4634CAA19FC556E71150ED82833A2', 234567),
    (3, 'ends to be told', 1,
     x'90B6465808734AD7AEFDC4D10D483A94E5DAF8963397B0E82E4E8864CF2FFBC85EE7F8FC3248AB61D3C9038D1A09BFA3', 345678);
";

/// A file as it was written when migrations were rows of a table, with tables of a version.
fn with_rows(path: &Path, version: u32) -> Connection {
    let mut connection = connections::writing(path, true).expect("it opens");
    schema::migrate_to(version, &mut connection).expect("made");
    connection.execute_batch(BY_ROWS).expect("written");
    connection.execute("DELETE FROM _sqlx_migrations WHERE version > ?1", [version]).expect("written");
    connection.pragma_update(None, "user_version", 0).expect("written");
    connection
}

#[tokio::test]
async fn a_file_with_the_earlier_bookkeeping_is_taken_over_with_its_jobs() {
    for version in [2, 3] {
        let (_folder, path) = in_a_folder();
        let NewJob { id, spec, .. } = new_job();
        let connection = with_rows(&path, version);
        let sql =
            "INSERT INTO jobs (id, tenant, state, spec, progress, created_at) VALUES (?1, ?2, 'queued', ?3, '{}', 1)";
        let row = params![id.to_string(), spec.tenant, rows::json(&spec).expect("JSON")];
        connection.execute(sql, row).expect("written");
        connection.close().expect("closed");
        for is_again in [false, true] {
            if is_again {
                // what an earlier build does that is tried on the file, before it fails
                let connection = Connection::open(&path).expect("it opens");
                connection.execute_batch(BY_ROWS).expect("written");
                connection.execute("DELETE FROM _sqlx_migrations", []).expect("written");
            }
            let store = open(&path).await;
            assert_eq!(store.get(id).await.expect("readable").map(|job| job.spec), Some(spec.clone()));
            assert_eq!(store.untold().await, Ok(vec![]), "there is a table for it");
            store.close().await;
        }
        let connection = Connection::open(&path).expect("it opens");
        let version: u32 = connection.pragma_query_value(None, "user_version", |row| row.get(0)).expect("readable");
        assert_eq!(version, 5);
        assert_eq!(connection.table_exists(None, "_sqlx_migrations"), Ok(false), "nobody keeps it up");
    }
}

#[tokio::test]
async fn a_file_of_somebody_elses_is_refused_in_one_line() {
    let (_folder, path) = in_a_folder();
    Connection::open(&path).expect("it opens").execute_batch("CREATE TABLE jobs (x)").expect("written");
    let error = SqliteStore::open(&path, RULES, Faults::default()).await.expect_err("not ours");
    assert!(error.message.ends_with("jobs.sqlite3: table jobs already exists"), "{error}");
}

#[tokio::test]
async fn tables_of_a_later_version_are_refused_and_left_alone() {
    for (by_rows, found, later) in [
        (false, "9999", "PRAGMA user_version = 9999"),
        (false, "-1", "PRAGMA user_version = -1"),
        (true, "9999", "INSERT INTO _sqlx_migrations VALUES (9999, 'later', CURRENT_TIMESTAMP, 1, x'00', 0)"),
        // whose last 32 bits are those of a known version
        (true, "4294967298", "UPDATE _sqlx_migrations SET version = 4294967298 WHERE version = 3"),
    ] {
        let (_folder, path) = in_a_folder();
        let connection = match by_rows {
            true => with_rows(&path, 3),
            false => {
                open(&path).await.close().await;
                connections::writing(&path, false).expect("it opens")
            }
        };
        connection.execute_batch(later).expect("written");
        connection.close().expect("closed");
        let before = std::fs::read(&path).expect("readable");
        let error = SqliteStore::open(&path, RULES, Faults::default()).await.expect_err("too new");
        for part in [&format!("version {found},"), NAME, "up to 5"] {
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
    let error = SqliteStore::open(&path, RULES, Faults::default()).await.expect_err("damaged");
    assert!(error.message.contains("damaged") && error.message.contains("backup"), "{error}");
    std::fs::write(&path, "no database, but a text that is long enough to be taken for one ".repeat(100))
        .expect("written");
    let error = SqliteStore::open(&path, RULES, Faults::default()).await.expect_err("no database");
    assert!(error.message.contains("damaged"), "{error}");
}

#[tokio::test]
async fn damage_that_a_reader_finds_fails_the_probe_until_the_store_is_opened_again() {
    let (_folder, path) = in_a_folder();
    let store =
        SqliteStore::open(&path, Rules { max_queued: 1000, ..RULES }, Faults::default()).await.expect("it opens");
    for _ in 0..300 {
        store.create(new_job()).await.expect("created");
    }
    store.close().await;
    let store = open(&path).await;
    let failures = store.statistics().failures;
    damage(&path);
    let query = ListQuery { limit: 1000, ..ListQuery::default() };
    let error = store.list(&query).await.expect_err("damaged");
    assert_eq!(error.kind, Kind::Unavailable, "{error}");
    assert!(store.statistics().failures > failures, "the service looks");
    for _ in 0..2 {
        let error = store.probe().await.expect_err("damaged");
        assert!(error.message.contains("damaged"), "{error}");
    }
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
