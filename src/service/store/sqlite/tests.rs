use std::io::ErrorKind;
use std::sync::Mutex;

use sqlx::Connection as _;
use tempfile::TempDir;

use super::*;
use crate::service::faults::FaultPoint;
use crate::service::store::conformance::{self, Subject};
use crate::service::store::tests::new_job;

/// Stores in folders of their own.
#[derive(Default)]
struct OnDisk(Mutex<Vec<TempDir>>);

const NAME: &str = "jobs.sqlite3";

impl OnDisk {
    fn folder(&self) -> TempDir {
        tempfile::tempdir().expect("a folder")
    }

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
        Box::new(self.open(self.folder(), rules).await)
    }

    /// A copy of the files of a store that is open: what a crash at this moment would leave.
    async fn after_crash(&self, rules: Rules) -> Option<Box<dyn JobStore>> {
        let copy = self.folder();
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

const RULES: Rules = Rules { max_queued: 100, max_attempts: 3 };

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

/// The database itself says that there is no room, as on a full disk.
#[tokio::test]
async fn a_full_database_is_no_room_and_takes_jobs_again_later() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(NAME);
    SqliteStore::open(&path, RULES, Faults::default()).await.expect("it opens").close().await;
    let options = SqliteConnectOptions::new().filename(&path).pragma("max_page_count", "1");
    let connection = options.clone().connect().await.expect("it opens");
    let listeners = Arc::<Listeners>::default();
    // Whoever opens the file anew after the failure finds room.
    let roomy = SqliteConnectOptions::new().filename(&path);
    let writer = Writer::start(connection, roomy, listeners, Faults::default());
    let mut large = new_job();
    large.spec.buffers = vec!["x".repeat(1 << 20)];
    let error = writer.carry_out(Create(large.clone(), RULES)).await.expect_err("no room");
    assert_eq!(error.kind, Kind::InsufficientStorage, "{error}");
    writer.carry_out(Create(large, RULES)).await.expect("there is room again");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_command_that_fails_takes_no_other_with_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let store =
        Arc::new(SqliteStore::open(&folder.path().join(NAME), RULES, Faults::default()).await.expect("it opens"));
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

/// Tables as they were before ends to be told had one of their own.
#[tokio::test]
async fn an_end_that_was_to_be_told_before_an_update_is_told_after_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(NAME);
    let options = SqliteConnectOptions::new().filename(&path).create_if_missing(true);
    let connection = options.connect().await.expect("it opens");
    let mut connection = schema::migrate_to(2, connection).await.expect("made");
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
        query(
            "INSERT INTO jobs (id, tenant, state, spec, progress, problem, untold, created_at, ended_at) \
             VALUES (?1, ?2, ?3, ?4, '{}', ?5, ?6, 1, 2)",
        )
        .bind(id.to_string())
        .bind(&spec.tenant)
        .bind(state.name())
        .bind(rows::json(&spec).expect("JSON"))
        .bind(problem.as_ref().map(|problem| rows::json(problem).expect("JSON")))
        .bind(untold)
        .execute(&mut connection)
        .await
        .expect("written");
        if let (Some(place), Some(webhook)) = (untold, spec.webhook) {
            let ended_at = rows::time(2);
            told.push((place, Notice { job: id, webhook, trace_parent: None, state, problem, ended_at }));
        }
    }
    connection.close().await.expect("closed");
    told.sort_by_key(|(place, _)| *place);
    let store = SqliteStore::open(&path, RULES, Faults::default()).await.expect("it opens");
    let untold = store.untold().await.expect("readable");
    assert_eq!(untold, told.iter().map(|(_, notice)| notice.job).collect::<Vec<_>>());
    for (id, (_, expected)) in untold.into_iter().zip(told) {
        assert_eq!(store.notice(id).await.expect("readable"), Some(expected));
    }
    assert_eq!(store.list(&ListQuery { limit: 9, ..ListQuery::default() }).await.expect("listed").jobs.len(), 4);
}

#[tokio::test]
async fn tables_of_a_later_version_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(NAME);
    let store = SqliteStore::open(&path, RULES, Faults::default()).await.expect("it opens");
    query(
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
           VALUES (9999, 'later', 1, x'00', 0)",
    )
    .execute(&mut SqliteConnectOptions::new().filename(&path).connect().await.expect("it opens"))
    .await
    .expect("written");
    store.close().await;
    let error = SqliteStore::open(&path, RULES, Faults::default()).await.expect_err("too new");
    assert!(error.message.contains("9999") && error.message.contains(NAME), "{error}");
}
