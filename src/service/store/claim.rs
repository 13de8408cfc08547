//! Claims, and jobs of workers that were lost.
//!
//! A worker whose leases are all over is lost, with all its jobs: the rules see them together. A job whose lease is
//! over although its worker lives was given up by that worker. While the server of the database was stopped, no worker
//! could prolong a lease, so a lease that was over when the server started is valid for another term.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, SystemTime};

use tesserae_mesh::error::{Error, Kind, Result};

use super::change::{Live, Transaction, standing, unplaced};
use super::database::rows::{Abort, Query, Row, Rows, values};
use super::job::{Job, Ticket};
use super::store::Store;
use super::terms::What;
use crate::queue::{self, Change, Claiming, Picks, Refused, Standing, Suspect, Tenant, Turn, View, Waiting, crashed};

/// Tenants with waiting jobs. Each step goes to the next one.
macro_rules! names {
    ($($rest:expr),+) => {
        concat!(
            "WITH RECURSIVE names(tenant) AS (\
                SELECT min(tenant) FROM jobs WHERE state = 'queued' \
                UNION ALL SELECT (SELECT min(tenant) FROM jobs WHERE state = 'queued' AND tenant > names.tenant) \
                FROM names WHERE names.tenant IS NOT NULL\
            )",
            $($rest),+
        )
    };
}

const TENANTS: &str = names!(
    " SELECT names.tenant AS tenant, \
        (SELECT count(*) FROM jobs WHERE state = 'running' AND tenant = names.tenant) AS running, \
        coalesce((SELECT next FROM tenants WHERE name = names.tenant), 0.0) AS next, \
        coalesce((SELECT max(served) FROM tenants), 0.0) AS clock \
    FROM names WHERE names.tenant IS NOT NULL"
);

/// What the rules see of a job.
macro_rules! columns {
    () => {
        "number, tenant, urgency, last_seq, state, is_small, attempt, uncounted, begun, suspicion, not_before, \
        started_at, lease_until, cancel_requested"
    };
}

/// The first `$1` waiting jobs of a tenant, and its first suspect.
macro_rules! heads {
    ($tenant:literal) => {
        concat!(
            "SELECT * FROM (SELECT ",
            columns!(),
            " FROM jobs WHERE state = 'queued' AND suspicion = 0 AND tenant = ",
            $tenant,
            " ORDER BY urgency, number LIMIT $1) AS head UNION ALL SELECT * FROM (SELECT ",
            columns!(),
            " FROM jobs WHERE state = 'queued' AND suspicion > 0 AND tenant = ",
            $tenant,
            " ORDER BY not_before, number LIMIT 1) AS suspect"
        )
    };
}

const HEADS_OF_TENANT: &str = heads!("$2");

/// Those of all tenants.
const HEADS: &str = names!(" SELECT heads.* FROM names CROSS JOIN LATERAL (", heads!("names.tenant"), ") AS heads");

const MINE: &str = concat!("SELECT ", columns!(), " FROM jobs WHERE state = 'running' AND worker_id = $1");

/// Workers that run jobs, and no suspect.
const BUSY: &str = "SELECT worker_id, count(*) AS jobs FROM jobs WHERE state = 'running' \
    GROUP BY worker_id HAVING max(suspicion) = 0";

/// The event of a start. A client may change a waiting job during the claim, which every such change tells by an event.
const TELL: &str = "INSERT INTO events (job, seq, kind, data) SELECT number, last_seq + 1, $3, $4 FROM jobs \
    WHERE number = $1 AND last_seq = $2 FOR UPDATE";

const START: &str = "UPDATE jobs SET last_seq = last_seq + 1, state = $3, attempt = $4, begun = $5, not_before = $6, \
    started_at = $7, lease_until = $8, worker = $9, worker_id = $10 WHERE number = $1 AND last_seq = $2 RETURNING *";

const TURN: &str = "INSERT INTO tenants (name, served, next) VALUES ($1, $2, $3) \
    ON CONFLICT (name) DO UPDATE SET served = excluded.served, next = excluded.next";

/// A turn that is over is the same as none.
const FORGET: &str = "DELETE FROM tenants WHERE next < (SELECT max(served) FROM tenants)";

const ALIVE: &str = "INSERT INTO workers (id, name, version, started_at, seen_at, lease, alive_until) \
    VALUES ($1, $2, $3, $4, $4, $5, $6) ON CONFLICT (id) DO UPDATE SET name = excluded.name, \
    seen_at = excluded.seen_at, lease = excluded.lease, alive_until = CASE \
        WHEN workers.alive_until < excluded.alive_until THEN excluded.alive_until ELSE workers.alive_until END";

/// Running jobs whose lease is over, and what is known of their workers.
const OVER: &str = "SELECT *, (SELECT lease FROM workers WHERE id = worker_id) AS lease, \
    (SELECT alive_until FROM workers WHERE id = worker_id) AS alive_until \
    FROM jobs WHERE state = 'running' AND lease_until <= $1 FOR UPDATE";

/// A claimed job with its ticket, and the number of its last event.
type Taken = (Ticket, u64, Job);

impl Store {
    /// Claims waiting jobs, in the order of the [rules](queue). They are running from then on. Also gives the time
    /// until a job that was passed over may be claimed, if that needs time only.
    pub async fn claim_as(&self, claiming: Claiming) -> Result<(Vec<(Ticket, Job)>, Option<Duration>)> {
        // a look without the lock of the queue: an arrival wakes many workers
        let waits =
            |rows: &mut dyn Rows| rows.first("SELECT number FROM jobs WHERE state = 'queued' LIMIT 1", Vec::new());
        if self.is_idle.load(Relaxed) && self.read("look", waits).await?.is_none() {
            return Ok((Vec::new(), None));
        }
        let is_alone = !self.is_shared();
        let (taken, wait) = self.change("claim", move |change| claim(change, &claiming, is_alone)).await?;
        self.is_idle.store(taken.is_empty(), Relaxed);
        let mut held = self.held.lock();
        held.extend(taken.iter().map(|(ticket, last_seq, _)| (*ticket, *last_seq)));
        Ok((taken.into_iter().map(|(ticket, _, job)| (ticket, job)).collect(), wait))
    }

    /// Claims jobs of tenants with equal shares.
    #[cfg(test)]
    pub async fn claim(&self, limit: usize, lease: Duration) -> Result<Vec<(Ticket, Job)>> {
        let (worker, shares) = ("test".into(), Default::default());
        Ok(self.claim_as(Claiming { limit, newcomers: 0, lease, worker, shares }).await?.0)
    }

    /// Releases the running jobs whose lease is over by the clock of the store; returns the tickets that held them.
    pub async fn reclaim(&self) -> Result<Vec<Ticket>> {
        let lost = self.change("reclaim", reclaim).await?;
        self.held.lock().retain(|ticket, _| !lost.contains(ticket));
        Ok(lost)
    }

    /// Releases all running jobs, as their process died, and forgets it; how many they were.
    pub(super) async fn recover(&self) -> Result<usize> {
        let recovered = self.change("reclaim", |change| {
            let rows = change.rows.query("SELECT * FROM jobs WHERE state = 'running'", Vec::new())?;
            let jobs = rows.iter().map(Live::of).collect::<Result<Vec<_>>>()?;
            let count = jobs.len();
            give_back_of_lost(change, jobs)?;
            change.rows.write("DELETE FROM workers WHERE id <> $1", values![change.me])?;
            Ok(count)
        });
        recovered.await
    }
}

/// Claims jobs; the time until more may be claimed.
fn claim(
    change: &mut Transaction<'_>,
    claiming: &Claiming,
    is_alone: bool,
) -> Result<(Vec<Taken>, Option<Duration>), Abort> {
    change.rows.lock_queue(true);
    let (view, heads) = view(change, claiming, is_alone)?;
    let now = change.now()?;
    let Picks { numbers, turns, again } = queue::claim(view, claiming, &change.rules, now);
    let wait = again.map(|again| again.duration_since(now).unwrap_or_default());
    if numbers.is_empty() {
        return Ok((Vec::new(), wait));
    }
    let mut starts = Vec::new();
    for row in numbers.iter().filter_map(|number| heads.get(number)) {
        starts.push(start(change, claiming, row, now)?);
    }
    for Turn { tenant, served, next } in turns {
        change.rows.write(TURN, values![tenant, served, next])?;
    }
    let Claiming { worker, lease, .. } = claiming;
    let version = env!("CARGO_PKG_VERSION");
    let alive = (ALIVE, values![change.me, &**worker, version, now, *lease, now + *lease]);
    let mut taken = Vec::new();
    for row in change.rows.conclude(&starts, alive)?.iter().flatten() {
        let (live, job) = (Live::of(row)?, unplaced(row)?);
        change.pulse(&live);
        taken.push((live.ticket(), live.last_seq, job));
    }
    Ok((taken, wait))
}

/// What the rules see of the queue, and the jobs that they choose from by their numbers.
fn view(change: &mut Transaction<'_>, claiming: &Claiming, is_alone: bool) -> Result<(View, HashMap<i64, Row>), Abort> {
    let (me, most) = (change.me, claiming.limit + claiming.newcomers);
    let mut queries = vec![(TENANTS, Vec::new()), (MINE, values![me])];
    queries.extend(change.rows.knows_lateral().then(|| (HEADS, values![most])));
    let mut found = change.rows.all(&queries)?.into_iter();
    let mut next = || found.next().unwrap_or_default();
    let (tenants, mine) = (next(), next());
    let clock = tenants.first().map(|row| row.get("clock")).transpose()?.unwrap_or(0.0);
    let mut tenants = tenants.iter().map(tenant).collect::<Result<Vec<_>>>()?;
    let heads = match found.next() {
        Some(heads) => heads,
        None => {
            let of_tenant = |tenant: &Tenant| (HEADS_OF_TENANT, values![most, &*tenant.name]);
            let queries: Vec<Query> = tenants.iter().map(of_tenant).collect();
            change.rows.all(&queries)?.into_iter().flatten().collect()
        }
    };
    let places: HashMap<String, usize> = tenants.iter().map(|tenant| tenant.name.clone()).zip(0..).collect();
    let mut by_number = HashMap::new();
    for row in heads {
        let Some(&place) = places.get(row.text("tenant")?) else { continue };
        let (standing, number) = (standing(&row)?, row.get("number")?);
        match standing.suspicion {
            0 => tenants[place].waiting.push(Waiting { urgency: row.get("urgency")?, number }),
            crashes => {
                let not_before = standing.not_before.unwrap_or(SystemTime::UNIX_EPOCH);
                tenants[place].suspect = Some(Suspect { number, crashes, not_before });
            }
        }
        by_number.insert(number, row);
    }
    tenants.iter_mut().for_each(|tenant| tenant.waiting.sort());
    let is_least_busy = match is_alone || tenants.iter().all(|tenant| tenant.suspect.is_none()) {
        true => true,
        false => {
            let load = (mine.len() as u64, me.to_string());
            let busy = change.rows.query(BUSY, Vec::new())?;
            let loads = busy.iter().map(|row| Ok((row.get("jobs")?, row.get("worker_id")?)));
            loads.collect::<Result<Vec<(u64, String)>>>()?.iter().all(|other| load <= *other)
        }
    };
    Ok((View { tenants, clock, mine: mine.iter().map(standing).collect::<Result<_>>()?, is_least_busy }, by_number))
}

fn tenant(row: &Row) -> Result<Tenant> {
    let (name, running, next) = (row.get("tenant")?, row.get("running")?, row.get("next")?);
    Ok(Tenant { name, running, next, waiting: Vec::new(), suspect: None })
}

/// Tells the start of the next attempt at a job; the statement that starts it, unless a client changed the job.
fn start(change: &mut Transaction<'_>, claiming: &Claiming, row: &Row, now: SystemTime) -> Result<Query, Abort> {
    let (number, last_seq): (i64, u64) = (row.get("number")?, row.get("last_seq")?);
    let Claiming { worker, lease, .. } = claiming;
    let claim = Change::Claim { worker: worker.clone(), lease: *lease };
    let refused = |Refused(_)| Error::new(Kind::Internal, "a job was picked that does not wait");
    let (standing, event) = standing(row)?.apply(claim, &change.rules, now).map_err(refused)?;
    if let Some(event) = event {
        let [kind, data] = What::from(event).columns()?;
        change.rows.write(TELL, values![number, last_seq, kind, data])?;
    }
    let Standing { state, attempt, has_begun, not_before, started_at, lease_until, .. } = standing;
    let values = values![
        number,
        last_seq,
        state,
        attempt,
        has_begun,
        not_before,
        started_at,
        lease_until,
        &**worker,
        change.me,
    ];
    Ok((START, values))
}

/// Gives back jobs whose lease is over; the tickets that held them.
fn reclaim(change: &mut Transaction<'_>) -> Result<Vec<Ticket>, Abort> {
    change.rows.lock_queue(false);
    let now = change.now()?;
    change.rows.write(FORGET, Vec::new())?;
    let rows = change.rows.query(OVER, values![now])?;
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let up_since = change.rows.up_since()?;
    let (mut lost, mut workers) = (Vec::new(), BTreeMap::<_, Vec<Live>>::new());
    for row in &rows {
        let live = Live::of(row)?;
        let (lease, alive_until): (Option<u64>, Option<SystemTime>) = (row.get("lease")?, row.get("alive_until")?);
        let lease = Duration::from_micros(lease.unwrap_or_default());
        let until = live.standing.lease_until.unwrap_or(now);
        let is_gone = alive_until.is_none_or(|until| until <= now);
        let was_given_up = alive_until.is_some_and(|alive| until + lease / 2 <= alive);
        if until <= up_since && up_since + lease >= now || !is_gone && !was_given_up {
            continue;
        }
        lost.push(live.ticket());
        match is_gone {
            true => workers.entry(live.worker_id).or_default().push(live),
            false => drop(change.worked(live, Change::LeaseOver, None)?),
        }
    }
    for jobs in workers.into_values() {
        give_back_of_lost(change, jobs)?;
    }
    Ok(lost)
}

fn give_back_of_lost(change: &mut Transaction<'_>, jobs: Vec<Live>) -> Result<(), Abort> {
    let standings: Vec<Standing> = jobs.iter().map(|job| job.standing).collect();
    for (job, what) in jobs.into_iter().zip(crashed(&standings)) {
        change.worked(job, what, None)?;
    }
    Ok(())
}
