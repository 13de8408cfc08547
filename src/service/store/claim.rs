//! Claims, and jobs of lost workers. A worker whose leases are all over is lost, with all its jobs: the rules see them
//! together. A job whose lease is over although its worker lives was given up by that worker. While the server of the
//! database was stopped, no worker could prolong a lease: one that was over at its start is valid for another term.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, SystemTime};

use tesserae_mesh::error::{Error, Result};

use super::change::{LiveJob, Transaction, job, standing};
use super::database::{Abort, Query, Row, read, time, values};
use super::job::{Job, Ticket};
use super::store::Store;
use crate::queue::{self, Change, Claiming, Picks, Standing, Suspect, Tenant, Turn, View, Waiting, crashed};

/// Tenants with waiting jobs, each with the first of these and its first suspect, as JSON, since a subquery gives one
/// value: a join may read all jobs. Each step of the recursion goes to the next tenant.
const TENANTS: &str = "WITH RECURSIVE names(tenant) AS (\
        SELECT min(tenant) FROM jobs WHERE state = 'queued' \
        UNION ALL SELECT (SELECT min(tenant) FROM jobs WHERE state = 'queued' AND tenant > names.tenant) \
        FROM names WHERE names.tenant IS NOT NULL\
    ) SELECT names.tenant AS name, \
        (SELECT count(*) FROM jobs WHERE state = 'running' AND tenant = names.tenant) AS running, \
        coalesce((SELECT next FROM tenants WHERE name = names.tenant), 0.0) AS next, \
        coalesce((SELECT max(served) FROM tenants), 0.0) AS clock, \
        (SELECT '[' || string_agg('[' || CAST(urgency AS text) || ',' || CAST(number AS text) || ']', ',') || ']' \
            FROM (SELECT urgency, number FROM jobs WHERE state = 'queued' AND suspicion = 0 AND tenant = names.tenant \
            ORDER BY urgency, number LIMIT $1) AS first) AS waiting, \
        (SELECT '[' || CAST(number AS text) || ',' || CAST(suspicion AS text) || ',' \
                || CAST(coalesce(not_before, 0) AS text) || ']' \
            FROM jobs WHERE state = 'queued' AND suspicion > 0 AND tenant = names.tenant \
            ORDER BY not_before, number LIMIT 1) AS suspect \
    FROM names WHERE names.tenant IS NOT NULL";

/// A claimed job with its ticket, and the number of its last event.
type Taken = (Ticket, u64, Job);

impl Store {
    /// Claims waiting jobs, in the order of the [rules](queue). They are running from then on. Also gives the time
    /// until a job that was passed over may be claimed, if that needs time only.
    pub async fn claim_as(&self, claiming: Claiming) -> Result<(Vec<(Ticket, Job)>, Option<Duration>)> {
        // an arrival wakes the workers of all services that share the queue: an idle one looks without the lock
        let waits = "SELECT number FROM jobs WHERE state = 'queued' LIMIT 1";
        let is_alone = !self.is_shared();
        if !is_alone && self.is_idle.load(Relaxed) && self.query("look", waits, Vec::new()).await?.is_empty() {
            return Ok((Vec::new(), None));
        }
        let (taken, wait) = self.change("claim", move |change| claim(change, &claiming, is_alone)).await?;
        self.is_idle.store(taken.is_empty(), Relaxed);
        self.held.lock().extend(taken.iter().map(|(ticket, last_seq, _)| (*ticket, *last_seq)));
        if !is_alone && !taken.is_empty() {
            // The claim did not wait for the disk; this commit does, and comes after it. If it fails, the jobs begin
            // all the same: after a crash that undid the claim, the store refuses what this worker writes.
            let sql = "UPDATE workers SET seen_at = seen_at WHERE id = $1";
            if let Err(error) = self.query("heartbeat", sql, values![self.me]).await {
                tracing::warn!(%error, jobs = taken.len(), "jobs begin before their claim is known to be stored");
            }
        }
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
            let jobs = rows.iter().map(LiveJob::of).collect::<Result<Vec<_>>>()?;
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
    change.rows.lock_queue(true)?;
    let view = view(change, claiming, is_alone)?;
    let now = change.now()?;
    let Picks { numbers, turns, again } = queue::claim(view, claiming, &change.rules, now);
    let wait = again.map(|again| again.duration_since(now).unwrap_or_default());
    if numbers.is_empty() {
        return Ok((Vec::new(), wait));
    }
    // none where a client ended the job meanwhile
    let sql = "SELECT *, NULL AS queue_position FROM jobs WHERE number = $1 AND state = 'queued' FOR UPDATE";
    let picked: Vec<Query> = numbers.into_iter().map(|number| (sql, values![number])).collect();
    let rows = change.rows.all(&picked)?;
    let found = rows.iter().flatten().map(|row| Ok((LiveJob::of(row)?, job(row)))).collect::<Result<Vec<_>>>()?;
    let Claiming { worker, lease, .. } = claiming;
    let mut taken = Vec::new();
    for (mut live, job) in found {
        // a job of a later release: it does not begin, so that the end of its lease is no failure, and others do
        live.standing.is_small &= job.is_ok();
        let live = change.apply(live, Change::Claim(worker.clone(), *lease), None)?;
        let Standing { state, attempt, started_at, .. } = live.standing;
        match job {
            Ok(job) => {
                let job = Job { state, attempt, started_at, worker: live.worker.clone(), ..job };
                taken.push((live.ticket(), live.last_seq, job));
            }
            Err(error) => tracing::warn!(job = %live.id, %error, "a claimed job waits until its lease is over"),
        }
    }
    for Turn { tenant, served, next } in turns {
        let sql = "INSERT INTO tenants (name, served, next) VALUES ($1, $2, $3) \
            ON CONFLICT (name) DO UPDATE SET served = excluded.served, next = excluded.next";
        change.rows.write(sql, values![tenant, served, next])?;
    }
    let sql = "INSERT INTO workers (id, name, version, started_at, seen_at, lease, alive_until) \
        VALUES ($1, $2, $3, $4, $4, $5, $6) ON CONFLICT (id) DO UPDATE SET name = excluded.name, \
        seen_at = excluded.seen_at, lease = excluded.lease, alive_until = CASE \
            WHEN workers.alive_until < excluded.alive_until THEN excluded.alive_until ELSE workers.alive_until END";
    change.rows.write(sql, values![change.me, &**worker, env!("CARGO_PKG_VERSION"), now, *lease, now + *lease])?;
    Ok((taken, wait))
}

fn view(change: &mut Transaction<'_>, claiming: &Claiming, is_alone: bool) -> Result<View, Abort> {
    let (me, most) = (change.me, claiming.limit + claiming.newcomers);
    let mine = "SELECT * FROM jobs WHERE state = 'running' AND worker_id = $1";
    let found = change.rows.all(&[(TENANTS, values![most]), (mine, values![me])])?;
    let [names, mine] = &found[..] else { return Err(Abort::Broken(Error::internal("a query is lost"))) };
    let clock = names.first().map(|row| row.get("clock")).transpose()?.unwrap_or(0.0);
    let tenants = names.iter().map(tenant).collect::<Result<Vec<_>>>()?;
    let is_least_busy = is_alone || tenants.iter().all(|tenant| tenant.suspect.is_none()) || {
        let load = (mine.len() as u64, me.to_string());
        // workers that run jobs, and no suspect
        let sql = "SELECT worker_id, count(*) AS jobs FROM jobs WHERE state = 'running' \
            GROUP BY worker_id HAVING max(suspicion) = 0";
        let busy = change.rows.query(sql, Vec::new())?;
        let loads = busy.iter().map(|row| Ok((row.get("jobs")?, row.get("worker_id")?)));
        loads.collect::<Result<Vec<(u64, String)>>>()?.iter().all(|other| load <= *other)
    };
    Ok(View { tenants, clock, mine: mine.iter().map(standing).collect::<Result<_>>()?, is_least_busy })
}

fn tenant(row: &Row) -> Result<Tenant> {
    let waiting = row.json::<Option<Vec<(i16, i64)>>>("waiting")?.unwrap_or_default();
    let mut waiting: Vec<_> = waiting.into_iter().map(|(urgency, number)| Waiting { urgency, number }).collect();
    waiting.sort_unstable();
    let suspect = row.json::<Option<(i64, u32, i64)>>("suspect")?;
    let suspect = suspect.map(|(number, crashes, micros)| Suspect { number, crashes, not_before: time(micros) });
    Ok(read!(row, Tenant { name, running, next; waiting: waiting, suspect: suspect }))
}

/// Gives back jobs whose lease is over; the tickets that held them.
fn reclaim(change: &mut Transaction<'_>) -> Result<Vec<Ticket>, Abort> {
    change.rows.lock_queue(false)?;
    let now = change.now()?;
    // a turn that is over is the same as none
    change.rows.write("DELETE FROM tenants WHERE next < (SELECT max(served) FROM tenants)", Vec::new())?;
    let sql = "SELECT *, (SELECT lease FROM workers WHERE id = worker_id) AS lease, \
        (SELECT alive_until FROM workers WHERE id = worker_id) AS alive_until \
        FROM jobs WHERE state = 'running' AND lease_until <= $1 FOR UPDATE";
    let rows = change.rows.query(sql, values![now])?;
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let up_since = change.rows.up_since()?;
    let (mut lost, mut workers) = (Vec::new(), BTreeMap::<_, Vec<LiveJob>>::new());
    for row in &rows {
        let live = LiveJob::of(row)?;
        let lease = row.get::<Option<Duration>>("lease")?.unwrap_or_default();
        let alive_until: Option<SystemTime> = row.get("alive_until")?;
        let until = live.standing.lease_until.unwrap_or(now);
        let is_gone = alive_until.is_none_or(|until| until <= now);
        let was_given_up = alive_until.is_some_and(|alive| until + lease / 2 <= alive);
        if until <= up_since && up_since + lease >= now || !is_gone && !was_given_up {
            continue;
        }
        lost.push(live.ticket());
        match is_gone {
            true => workers.entry(live.worker_id).or_default().push(live),
            false => drop(change.apply(live, Change::LeaseOver, None)?),
        }
    }
    for jobs in workers.into_values() {
        give_back_of_lost(change, jobs)?;
    }
    Ok(lost)
}

fn give_back_of_lost(change: &mut Transaction<'_>, jobs: Vec<LiveJob>) -> Result<(), Abort> {
    let standings: Vec<Standing> = jobs.iter().map(|job| job.standing).collect();
    for (job, what) in jobs.into_iter().zip(crashed(&standings)) {
        change.apply(job, what, None)?;
    }
    Ok(())
}
