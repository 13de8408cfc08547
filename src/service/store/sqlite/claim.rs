//! Claims, and what happens to running jobs after a crash: see the [store](super::super) for the rules.

use std::time::SystemTime;

use parking_lot::Mutex;
use rusqlite::{Connection, params};

use super::super::fairness::{Waiting, first_tenants};
use super::super::{ALONE, ALONE_FROM, Claiming, Job, Rules, State, Ticket, What, guilty};
use super::claim_memory::ClaimMemory;
use super::connections::{Abort, all, execute, first, one};
use super::live::Live;
use super::rows::{self, column, count, micros, text};
use super::writer::Batch;
use crate::error::Result;

/// What suspects allow.
enum Suspects {
    /// Nothing may be claimed now.
    Alone,
    /// This one starts, and others beside it.
    Start(i64),
    /// This one starts, and nothing else.
    StartAlone(i64),
    /// Only other jobs may be claimed.
    None,
}

/// Claims jobs, in the order that the [store](super::super) describes.
pub(super) fn claim(
    batch: &mut Batch<'_>,
    claiming: &Claiming,
    memory: &Mutex<ClaimMemory>,
) -> Result<Vec<(Ticket, Job)>, Abort> {
    let sql = "SELECT name, queued, running FROM tenants WHERE queued > 0 OR running > 0";
    let tenants = all(batch.connection, sql, [], |row| {
        let tenant = Waiting { tenant: text(row, "name")?.to_owned(), running: count(row, "running")? };
        Ok((tenant, count(row, "queued")?))
    })?;
    let queued: u64 = tenants.iter().map(|(_, queued)| queued).sum();
    let running: u64 = tenants.iter().map(|(tenant, _)| tenant.running).sum();
    let mut memory = memory.lock();
    memory.next_start = None;
    memory.has_held_back = queued > 0;
    if queued == 0 {
        return Ok(Vec::new());
    }
    let now = rows::now();
    let mut taken = Vec::new();
    match suspects(batch.connection, claiming.limit > 0, running, now, &mut memory)? {
        Suspects::Alone => return Ok(taken),
        Suspects::StartAlone(number) => return Ok(vec![start(batch, claiming, number, now)?]),
        Suspects::Start(number) => taken.push(start(batch, claiming, number, now)?),
        Suspects::None => {}
    }
    let Claiming { limit, newcomers, shares, .. } = claiming;
    let mut waiting: Vec<_> = tenants.into_iter().filter(|(_, queued)| *queued > 0).map(|(tenant, _)| tenant).collect();
    for (_, job) in &taken {
        waiting.iter_mut().filter(|one| one.tenant == job.spec.tenant).for_each(|one| one.running += 1);
    }
    while taken.len() < limit + newcomers && !waiting.is_empty() {
        let tied = first_tenants(&waiting, &memory.virtual_times, shares, taken.len() >= *limit);
        let mut heads = Vec::new();
        let mut without = Vec::new();
        for index in tied {
            match head(batch.connection, &waiting[index].tenant)? {
                Some(place) => heads.push((place, index)),
                None => without.push(index),
            }
        }
        let Some(&((_, number), index)) = heads.iter().min() else {
            if without.is_empty() {
                break;
            }
            // all waiting jobs of these tenants are suspects that pause
            without.into_iter().rev().for_each(|index| drop(waiting.swap_remove(index)));
            continue;
        };
        taken.push(start(batch, claiming, number, now)?);
        let tenant = &mut waiting[index];
        tenant.running += 1;
        memory.virtual_times.serve(&tenant.tenant);
        memory.virtual_times.charge(&tenant.tenant, 1.0, shares.of(&tenant.tenant));
    }
    memory.has_held_back = queued > taken.len() as u64;
    Ok(taken)
}

/// Urgency and number of the job of a tenant that is claimed next.
fn head(connection: &Connection, tenant: &str) -> Result<Option<(i64, i64)>, Abort> {
    let sql = "SELECT urgency, number FROM jobs WHERE tenant = ?1 AND state = 'queued' AND suspicion = 0 \
               ORDER BY urgency, number LIMIT 1";
    first(connection, sql, [tenant], |row| Ok((column(row, "urgency")?, column(row, "number")?)))
}

/// What suspects that run or wait allow, when one may start or not. Notes when that changes by itself.
fn suspects(
    connection: &Connection,
    may_start: bool,
    running: u64,
    now: SystemTime,
    memory: &mut ClaimMemory,
) -> Result<Suspects, Abort> {
    let sql = "SELECT suspicion, started_at FROM jobs WHERE suspicion > 0 AND state = 'running'";
    let at_work =
        all(connection, sql, [], |row| Ok((column::<u32>(row, "suspicion")?, rows::time(column(row, "started_at")?))))?;
    let until = at_work.iter().filter(|(crashes, _)| *crashes >= ALONE_FROM).map(|(_, started)| *started + ALONE);
    if let Some(until) = until.max().filter(|until| *until > now) {
        memory.next_start = Some(until);
        return Ok(Suspects::Alone);
    }
    let sql = "SELECT number, suspicion, not_before FROM jobs WHERE suspicion > 0 AND state = 'queued' \
               ORDER BY not_before LIMIT 1";
    let next = first(connection, sql, [], |row| {
        let not_before = column::<Option<i64>>(row, "not_before")?.map_or(SystemTime::UNIX_EPOCH, rows::time);
        Ok((column::<i64>(row, "number")?, column::<u32>(row, "suspicion")?, not_before))
    })?;
    let Some((number, crashes, not_before)) = next.filter(|_| at_work.is_empty()) else {
        return Ok(Suspects::None);
    };
    if not_before > now {
        memory.next_start = Some(not_before);
        return Ok(Suspects::None);
    }
    if crashes < ALONE_FROM {
        return Ok(if may_start { Suspects::Start(number) } else { Suspects::None });
    }
    if running > 0 && not_before + ALONE > now {
        memory.next_start = Some(not_before + ALONE);
        return Ok(Suspects::Alone);
    }
    Ok(if may_start { Suspects::StartAlone(number) } else { Suspects::Alone })
}

/// Starts the next attempt at a waiting job.
fn start(batch: &mut Batch<'_>, claiming: &Claiming, number: i64, now: SystemTime) -> Result<(Ticket, Job), Abort> {
    let Claiming { lease, worker, .. } = claiming;
    let (mut live, job) = one(
        batch.connection,
        "UPDATE jobs SET state = 'running', attempt = attempt + 1, started_at = ?1, lease_until = ?2, worker = ?3, \
         begun = coalesce(spec ->> 'is_small', 0), last_seq = last_seq + 1 WHERE number = ?4 \
         RETURNING *, NULL AS queue_position",
        params![micros(now), micros(now + *lease), &**worker, number],
        |row| {
            let job = rows::job(row)?;
            Ok((Live::from_row(job.id, row)?, job))
        },
    )?;
    // counted by the statement above
    live.last_seq -= 1;
    live.append(batch, &[What::Started(live.attempt, worker.to_string())])?;
    Ok((Ticket { job: job.id, attempt: live.attempt }, job))
}

/// What became of the jobs that ran when the process died.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Recovered {
    /// Those that wait again as if they had not been claimed.
    pub unharmed: usize,
    /// Those that wait again as suspects.
    pub suspects: usize,
    /// Those that ended: given up, or cancelled.
    pub ended: usize,
}

/// Gives back what ran when the process died.
pub(super) fn recover(batch: &mut Batch<'_>, rules: &Rules) -> Result<Recovered, Abort> {
    let now = rows::now();
    // no pause is longer than this, unless a clock was wrong when it began
    let latest = micros(now + rules.pause(u32::MAX));
    let sql = "UPDATE jobs SET not_before = ?1 WHERE state = 'queued' AND suspicion > 0 AND not_before > ?1";
    execute(batch.connection, sql, [latest])?;
    let sql = "SELECT * FROM jobs WHERE state = 'running' ORDER BY number";
    let jobs = all(batch.connection, sql, [], |row| {
        Ok((Live::from_row(rows::id(row, "id")?, row)?, column::<Option<i64>>(row, "started_at")?))
    })?;
    let begun: Vec<_> = jobs.iter().filter(|(job, _)| job.has_begun).collect();
    let starts: Vec<_> = begun.iter().map(|(job, started)| (job.suspicion, *started)).collect();
    let guilty = guilty(&starts).map(|index| begun[index].0.number);
    let mut recovered = Recovered::default();
    for (mut job, _) in jobs {
        let is_suspect = job.has_begun;
        let is_guilty = guilty == Some(job.number);
        match job.crashed(batch, is_guilty, now, rules)? {
            State::Queued if is_suspect => recovered.suspects += 1,
            State::Queued => recovered.unharmed += 1,
            _ => recovered.ended += 1,
        }
    }
    Ok(recovered)
}
