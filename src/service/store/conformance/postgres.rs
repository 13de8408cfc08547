//! The store in a database that several services share.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use futures_util::future::try_join_all;
use parking_lot::Mutex;
use tempfile::TempDir;

use super::super::StoreUrl;
use super::super::database::{MIGRATIONS, postgres, values};
use super::*;
use crate::queue::Change;

/// Services on a database, in the order of their ids, which decides between workers that are equally busy.
pub async fn open_all(url: &StoreUrl, count: usize, rules: Rules) -> Vec<Store> {
    let mut stores = try_join_all((0..count).map(|_| Store::shared(url, 12, rules))).await.expect("they open");
    stores.sort_unstable_by_key(|store| store.me);
    stores
}

async fn open(url: &StoreUrl, rules: Rules) -> Store {
    Store::shared(url, 12, rules).await.expect("it opens")
}

/// A server, and services on a new database of it; none where PostgreSQL is not installed.
async fn services<const N: usize>() -> Option<(Server, StoreUrl, [Store; N])> {
    let server = Server::start()?;
    let url = server.database();
    let stores = open_all(&url, N, RULES).await.try_into().ok()?;
    Some((server, url, stores))
}

/// Ends the leases of all workers.
async fn expire(store: &Store) {
    let expired = store.change("test", |change| {
        let now = change.now()?;
        change.rows.write("UPDATE jobs SET lease_until = $1 WHERE state = 'running'", values![now])?;
        change.rows.write("UPDATE workers SET alive_until = $1", values![now])
    });
    expired.await.expect("expired");
}

#[tokio::test(flavor = "multi_thread")]
async fn conforms() {
    let Some(server) = Server::start() else { return };
    let last = Mutex::new(None);
    let empty = async |rules| {
        let url = server.database();
        *last.lock() = Some(url.clone());
        open(&url, rules).await
    };
    // another service on the same database, when the leases of the first are over
    let after_crash = async || {
        let url = last.lock().clone().expect("a store was made");
        let store = open(&url, RULES).await;
        expire(&store).await;
        store.reclaim().await.expect("reclaimed");
        store
    };
    run(empty, after_crash).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn services_share_jobs_changes_and_cancellations() {
    let Some((_server, _, [one, other])) = services().await else { return };
    assert!(one.is_shared() && one.is_durable());
    let mut arrivals = other.arrivals();
    arrivals.borrow_and_update();
    let job = create(&one).await.id;
    soon(arrivals.changed()).await.expect("still there");
    let ticket = claim(&other).await.0;
    assert_eq!(ticket.job, job);
    assert!(one.claim(9, LEASE).await.expect("claimable").is_empty(), "it is claimed once");
    let mut pulses = one.watch(job).await.expect("watchable").expect("a job");
    let mut asked = other.watch(job).await.expect("watchable").expect("a job");
    one.cancel(job).await.expect("asked");
    soon(asked.wait_for(|pulse| pulse.cancel_requested)).await.expect("told");
    let other_attempt = one.end(Ticket { attempt: 2, ..ticket }, End::Cancelled).await;
    assert_eq!(other_attempt.expect_err("other").kind, Kind::Conflict);
    other.append(ticket, vec![JobEvent::Iteration("{}".into())], Default::default()).await.expect("appended");
    other.end(ticket, End::Cancelled).await.expect("finished");
    soon(pulses.wait_for(|pulse| pulse.ended)).await.expect("told");
    assert_eq!(events(&one, job, 0, 99).await.len(), 4);
    other.delete(job).await.expect("deleted");
    // a deletion is noticed
    soon(async { while pulses.changed().await.is_ok() {} }).await;
    one.close().await;
    other.close().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_happens_to_running_jobs_because_a_service_starts() {
    let Some((_server, url, [first])) = services().await else { return };
    create(&first).await;
    let ticket = claim(&first).await.0;
    first.begin(ticket).await.expect("begun");
    let second = open(&url, RULES).await;
    assert_eq!(second.reclaim().await, Ok(vec![]));
    assert_eq!(get(&second, ticket.job).await.state, State::Running);
    // the zombie: its lease is over, another one has the job, and what it writes is refused
    expire(&second).await;
    assert_eq!(second.reclaim().await, Ok(vec![ticket]));
    let again = claim(&second).await.0;
    assert_eq!(again.attempt, 2);
    for refused in [
        first.end(ticket, End::Succeeded(SUMMARY)).await,
        first.append(ticket, vec![JobEvent::Iteration("{}".into())], Default::default()).await,
        first.release(ticket, None).await.map(drop),
        first.begin(ticket).await,
    ] {
        assert_eq!(refused.expect_err("it is another's").kind, Kind::Conflict);
    }
    second.end(again, End::Succeeded(SUMMARY)).await.expect("finished");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_is_cancelled_during_its_claim_is_not_claimed() {
    let Some((_server, _, [client, worker])) = services().await else { return };
    let (first, second) = (create(&client).await.id, create(&client).await.id);
    let held = Arc::new(tokio::sync::Notify::new());
    let holds = Arc::clone(&held);
    let cancelled = client.change("test", move |change| {
        let live = change.find(first)?.expect("a job");
        holds.notify_one();
        // the claim sees that the job waits, and is held up by its row
        std::thread::sleep(Duration::from_millis(500));
        change.apply(live, Change::Cancel, None).map(drop)
    });
    let claimed = async {
        held.notified().await;
        worker.claim(9, LEASE).await
    };
    let (cancelled, claimed) = tokio::join!(cancelled, claimed);
    cancelled.expect("cancelled");
    assert_eq!(jobs_of(&claimed.expect("claimable")), [second]);
    assert_eq!(whats(&client, first).await, [JobEvent::Queued, JobEvent::End(State::Cancelled, None)]);
}

#[tokio::test(flavor = "multi_thread")]
async fn claimed_jobs_have_their_worker_though_the_wait_for_the_disk_failed() {
    let Some((_server, _, [store])) = services().await else { return };
    let id = create(&store).await.id;
    for sql in [
        "CREATE FUNCTION fail() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN RAISE EXCEPTION ''on purpose''; END'",
        "CREATE TRIGGER fail BEFORE UPDATE ON workers FOR EACH ROW EXECUTE FUNCTION fail()",
    ] {
        store.change("test", move |change| change.rows.write(sql, Vec::new())).await.expect("written");
    }
    let (ticket, _) = claim(&store).await;
    assert_eq!(ticket.job, id);
    assert!(store.heartbeat(&[], LEASE).await.is_err(), "changes of workers fail");
    store.end(ticket, End::Cancelled).await.expect("finished");
}

#[tokio::test(flavor = "multi_thread")]
async fn changes_whose_answer_was_lost_are_not_made_twice() {
    let Some((_server, _, [store])) = services().await else { return };
    create(&store).await;
    let ticket = claim(&store).await.0;
    let rows = || vec![JobEvent::Iteration("1".into()), JobEvent::Iteration("2".into())];
    store.append(ticket, rows(), Default::default()).await.expect("appended");
    // as if the answer had not come
    *store.held.lock().get_mut(&ticket).expect("held") -= 2;
    store.append(ticket, rows(), Default::default()).await.expect("known");
    assert_eq!(events(&store, ticket.job, 2, 99).await.len(), 2);
    store.end(ticket, End::Cancelled).await.expect("ended");
    store.held.lock().insert(ticket, 5);
    store.end(ticket, End::Cancelled).await.expect("the same end again");
    store.held.lock().insert(ticket, 5);
    let other = store.end(ticket, End::Failed(Error::new(Kind::InvalidMesh, "x"))).await;
    assert_eq!(other.expect_err("another end").kind, Kind::Conflict);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_stops_is_unavailable_and_loses_nothing() {
    let Some((server, _, [store, idle])) = services().await else { return };
    let kept = create(&store).await.id;
    let ticket = claim(&store).await.0;
    let pulses = store.watch(kept).await.expect("watchable").expect("a job");
    server.down();
    for failed in [
        store.create(new_job()).await.map(drop),
        store.get(kept).await.map(drop),
        store.probe().await,
        store.heartbeat(&[ticket], LEASE).await.map(drop),
    ] {
        let error = failed.expect_err("the server is down");
        assert_eq!(error.kind, Kind::Unavailable, "{error}");
    }
    assert!(store.statistics().failures >= 4);
    let noticed = async {
        while idle.statistics().failures == 0 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    // by its looks, without an operation
    soon(noticed).await;
    server.up();
    store.probe().await.expect("it works again");
    assert_eq!(store.reclaim().await, Ok(vec![]), "no lease is over");
    store.end(ticket, End::Cancelled).await.expect("finished");
    assert!(pulses.borrow().ended);
}

#[tokio::test(flavor = "multi_thread")]
async fn one_service_cleans_up_and_delivers_webhooks() {
    let Some((_server, _, [one, other])) = services().await else { return };
    assert_eq!((one.may_clean_up().await, other.may_clean_up().await), (Ok(true), Ok(false)));
    assert_eq!(one.may_clean_up().await, Ok(true));
    let mut job = new_job();
    job.spec.webhook = Some("https://a.example/".to_owned());
    let id = job.id;
    one.create(job).await.expect("created");
    one.cancel(id).await.expect("cancelled");
    assert_eq!((one.untold().await, other.untold().await), (Ok(vec![id]), Ok(vec![])));
    one.close().await;
    assert_eq!(other.untold().await, Ok(vec![id]), "a service that stops leaves that to others");
    assert_eq!(other.may_clean_up().await, Ok(true));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_migration_is_run_once_and_its_version_is_kept() {
    const LATER: [&str; 2] = [MIGRATIONS[0], "ALTER TABLE jobs ADD COLUMN later TEXT"];
    let Some((_server, url, [store])) = services().await else { return };
    for _ in 0..2 {
        postgres::migrate(&url, &LATER).await.expect("older");
    }
    let found = store.read("test", |rows| rows.query("SELECT later FROM jobs", Vec::new())).await;
    assert!(found.expect("there is such a column").is_empty());
    let error = Store::shared(&url, 2, RULES).await.err().expect("a later version");
    assert!(error.message.contains("version 2"), "{error}");
}

/// `CLAIM_JOBS=5000`, with `-- --nocapture`, gives the figures in `docs/farm.md`.
#[tokio::test(flavor = "multi_thread")]
async fn claimers_of_many_services_take_each_job_once() {
    let Some(server) = Server::start() else { return };
    let jobs = at_once::jobs();
    for limit in [1, 8] {
        let services = open_all(&server.database(), 16, Rules { max_queued: jobs, ..RULES }).await;
        let services: Vec<_> = services.into_iter().map(Arc::new).collect();
        at_once::claim_all(&services, limit, jobs).await;
    }
}

/// Workers on devices that take 50 ms for a job: four do nearly four times as much as one, beside all other tests more
/// than twice as much. `WORKER_JOBS=100`, with `-- --nocapture`, gives the figure in `docs/farm.md`.
#[tokio::test(flavor = "multi_thread")]
async fn workers_add_up() {
    let Some(server) = Server::start() else { return };
    let (jobs, least) = match std::env::var("WORKER_JOBS") {
        Ok(jobs) => (jobs.parse().expect("a number"), 3.8),
        Err(_) => (16, 2.0),
    };
    let rules = Rules { max_queued: 4 * jobs, ..RULES };
    let mut rates = Vec::new();
    for count in [1, 4, 4, 1] {
        let stores = open_all(&server.database(), count, rules).await;
        for _ in 0..jobs * count {
            create(&stores[0]).await;
        }
        let started = Instant::now();
        let workers = stores.into_iter().map(|store| {
            tokio::spawn(async move {
                while let Some((ticket, _)) = store.claim(1, LEASE).await.expect("claimable").pop() {
                    tokio::time::sleep(Duration::from_millis(50)).await;
                    store.end(ticket, End::Cancelled).await.expect("ended");
                }
            })
        });
        try_join_all(workers).await.expect("no panic");
        let rate = (jobs * count) as f64 / started.elapsed().as_secs_f64();
        println!("{count} workers on devices that take 50 ms: {rate:.1} jobs a second");
        rates.push(rate);
    }
    let gain = (rates[1] + rates[2]) / (rates[0] + rates[3]);
    assert!(gain >= least, "four workers do {gain:.2} times as much as one");
}

/// A server of a test: of Debian's package, in a temporary folder, on a socket there; stopped when dropped.
pub(super) struct Server {
    folder: TempDir,
    programs: PathBuf,
    databases: AtomicUsize,
}

impl Server {
    /// Starts one; none, with a notice, where PostgreSQL is not installed.
    pub fn start() -> Option<Self> {
        let Some(programs) = programs() else {
            println!("skipped: PostgreSQL is not installed (deploy/install-missing.sh test installs it)");
            return None;
        };
        let folder = tempfile::tempdir().expect("a folder");
        if rustix::process::getuid().is_root() {
            std::os::unix::fs::chown(folder.path(), Some(UNPRIVILEGED), Some(UNPRIVILEGED)).expect("it is ours");
        }
        let server = Self { folder, programs, databases: AtomicUsize::new(0) };
        let data = server.data();
        server.run("initdb", &["--no-sync", "--auth=trust", "--encoding=UTF8", "--username=tesserae", "-D", &data]);
        server.up();
        Some(server)
    }

    /// Starts it again after [`down`](Self::down).
    pub fn up(&self) {
        let folder = self.folder.path().display();
        let options =
            format!("-c listen_addresses= -c unix_socket_directories={folder} -c fsync=off -c max_connections=300");
        self.run("pg_ctl", &["-w", "-s", "-D", &self.data(), "-l", &format!("{folder}/log"), "-o", &options, "start"]);
    }

    /// Stops it, as a crash does.
    pub fn down(&self) {
        self.run("pg_ctl", &["-w", "-s", "-D", &self.data(), "-m", "immediate", "stop"]);
    }

    /// The URL of a new database.
    pub fn database(&self) -> StoreUrl {
        let name = format!("test{}", self.databases.fetch_add(1, Ordering::Relaxed));
        let folder = self.folder.path().display().to_string();
        self.run("createdb", &["-h", &folder, "-U", "tesserae", "--strategy=file_copy", &name]);
        let host = folder.replace('/', "%2F");
        format!("postgres://tesserae@{host}/{name}").as_str().into()
    }

    fn data(&self) -> String {
        self.folder.path().join("data").display().to_string()
    }

    /// Runs a program of the package, as a user that is not root.
    fn run(&self, program: &str, arguments: &[&str]) {
        let mut command = Command::new(self.programs.join(program));
        command.args(arguments).current_dir(self.folder.path()).stdin(Stdio::null()).stdout(Stdio::null());
        if rustix::process::getuid().is_root() {
            std::os::unix::process::CommandExt::uid(&mut command, UNPRIVILEGED);
        }
        let status = command.status().expect("it starts");
        assert!(status.success(), "{program} {arguments:?}: {status}");
    }
}

/// The user that the server is of when the tests are root's, for which it refuses to run.
const UNPRIVILEGED: u32 = 65_534;

impl Drop for Server {
    fn drop(&mut self) {
        if self.folder.path().join("data/postmaster.pid").exists() {
            self.down();
        }
    }
}

/// The folder of the programs: of the newest version that Debian's packages installed, or one in the search path.
fn programs() -> Option<PathBuf> {
    let versions = std::fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten();
    let mut found: Vec<(u32, PathBuf)> = versions
        .filter_map(|entry| Some((entry.file_name().to_str()?.parse().ok()?, entry.path().join("bin"))))
        .filter(|(version, folder)| *version >= 15 && folder.join("initdb").exists())
        .collect();
    found.sort();
    let in_path = || {
        let path = std::env::var_os("PATH")?;
        std::env::split_paths(&path).find(|folder: &PathBuf| Path::join(folder, "initdb").exists())
    };
    found.pop().map(|(_, folder)| folder).or_else(in_path)
}
