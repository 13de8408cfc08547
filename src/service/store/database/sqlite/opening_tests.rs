//! Files that a store finds when it is opened: of other versions, of other programs, damaged.

use super::*;

/// Tables as they were before ends to be told had one of their own.
#[tokio::test]
async fn an_end_that_was_to_be_told_before_an_update_is_told_after_it() {
    let (_folder, path) = in_a_folder();
    let mut connection = Place::shared(path.clone()).writing(true).expect("it opens");
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
    let mut connection = Place::shared(path.to_owned()).writing(true).expect("it opens");
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
        assert_eq!(connection.table_exists(None, "_sqlx_migrations"), Ok(false), "no migration writes it");
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
                Place::shared(path.clone()).writing(false).expect("it opens")
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
    assert!(!error.message.contains("jobs.sqlite3"), "the remedy is for the operator: {error}");
    assert!(store.statistics().failures > failures, "the service looks");
    for _ in 0..2 {
        let error = store.probe().await.expect_err("damaged");
        assert!(error.message.contains("damaged") && error.message.contains("backup"), "{error}");
    }
}
