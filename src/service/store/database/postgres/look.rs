//! How services learn what others did: each looks at the tables five times a second.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::super::super::job::JobId;
use super::super::super::listeners::Listeners;
use super::super::super::terms::Pulse;
use super::super::rows::values;
use super::connections::Connections;
use super::run;

const LOOK: Duration = Duration::from_millis(200);

/// Looks after which a worker looks at a queue without new jobs, and the deliveries of webhooks for ends.
const SELDOM: u64 = 5;

const QUEUE: &str = "SELECT coalesce((SELECT max(number) FROM jobs), 0) AS newest, \
    EXISTS (SELECT FROM jobs WHERE state = 'queued') AS waits";

const WATCHED: &str =
    "SELECT id, last_seq, cancel_requested, state FROM jobs WHERE id = ANY (string_to_array($1, ','))";

/// Looks at the queue for workers, and at the jobs that tasks wait for.
pub async fn look(connections: Connections, listeners: Arc<Listeners>) {
    let mut seen = 0;
    for turn in 0u64.. {
        sleep(LOOK).await;
        let started = Instant::now();
        let watched = listeners.pulses.waited_for();
        let ids = watched.iter().map(JobId::to_string).collect::<Vec<_>>().join(",");
        let found = run(&connections, false, move |rows, _| {
            let queue = rows.one(QUEUE, Vec::new())?;
            let watched = match ids.is_empty() {
                true => Vec::new(),
                false => rows.query(WATCHED, values![&*ids])?,
            };
            Ok((queue.get::<i64>("newest")?, queue.get::<bool>("waits")?, watched))
        });
        let Ok(((newest, waits, rows), _)) = found.await else {
            listeners.failed(started.elapsed());
            continue;
        };
        let is_seldom = turn.is_multiple_of(SELDOM);
        if waits && (is_seldom || newest > seen) {
            listeners.arrivals.notify();
        }
        seen = newest;
        if is_seldom {
            listeners.endings.notify();
        }
        let mut deleted: HashSet<JobId> = watched.into_iter().collect();
        for row in &rows {
            if let (Ok(id), Ok(pulse)) = (row.get("id"), Pulse::of(row)) {
                deleted.remove(&id);
                listeners.pulses.publish(id, pulse);
            }
        }
        deleted.into_iter().for_each(|id| listeners.pulses.forget(id));
    }
}
