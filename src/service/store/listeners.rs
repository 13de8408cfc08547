//! What follows from a committed change: tasks that wait for the store wake, and the store counts.

use std::collections::HashMap;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::watch;

use super::job::JobId;
use super::terms::{Pulse, Statistics};

/// What a change leaves to be done when it is committed.
#[derive(Debug, Default)]
pub struct Effects {
    /// None for a job that was deleted.
    pub pulses: Vec<(JobId, Option<Pulse>)>,
    /// Whether a job may be claimed that could not be before: it waits, or another one ended.
    pub arrivals: bool,
    pub endings: bool,
    pub attempts_failed: u64,
    pub given_up: u64,
    /// Whether the file has fewer pages, which it gives back when the log is written into it.
    pub shrinks: bool,
}

#[derive(Debug, Default)]
pub struct Listeners {
    pub pulses: Pulses,
    pub arrivals: watch::Sender<()>,
    pub endings: watch::Sender<()>,
    pub statistics: Mutex<Statistics>,
}

impl Listeners {
    pub fn publish(&self, effects: Effects) {
        let mut statistics = self.statistics.lock();
        statistics.attempts_failed += effects.attempts_failed;
        statistics.given_up += effects.given_up;
        drop(statistics);
        for (id, pulse) in effects.pulses {
            self.pulses.publish(id, pulse);
        }
        if effects.arrivals {
            self.arrivals.send_replace(());
        }
        if effects.endings {
            self.endings.send_replace(());
        }
    }

    /// Counts a transaction of so many commands, or one that failed.
    pub fn count(&self, commands: Option<usize>, time: Duration) {
        let mut statistics = self.statistics.lock();
        statistics.commits += u64::from(commands.is_some());
        statistics.commands += commands.unwrap_or(0) as u64;
        statistics.failures += u64::from(commands.is_none());
        statistics.commit_seconds += time.as_secs_f64();
    }
}

/// A receiver that is marked as changed, so that its task looks once before it waits.
pub fn marked(signal: &watch::Sender<()>) -> watch::Receiver<()> {
    let mut receiver = signal.subscribe();
    receiver.mark_changed();
    receiver
}

/// Receivers by job.
#[derive(Debug, Default)]
pub struct Pulses(Mutex<HashMap<JobId, watch::Sender<Pulse>>>);

impl Pulses {
    /// A receiver of every change of a job from now on. Subscribe first, then [`publish`](Self::publish) the stored
    /// state: no change in between is missed.
    pub fn subscribe(&self, id: JobId) -> watch::Receiver<Pulse> {
        let mut jobs = self.0.lock();
        jobs.retain(|_, pulse| pulse.receiver_count() > 0);
        jobs.entry(id).or_default().subscribe()
    }

    /// Wakes the receivers of a job, unless the last pulse was a later one. Without a pulse, they end.
    pub fn publish(&self, id: JobId, pulse: Option<Pulse>) {
        let mut jobs = self.0.lock();
        match (pulse, jobs.get(&id)) {
            (Some(pulse), Some(waiting)) => drop(waiting.send_if_modified(|last| {
                let is_later = pulse > *last;
                *last = pulse.max(*last);
                is_later
            })),
            (None, Some(_)) => drop(jobs.remove(&id)),
            (_, None) => {}
        }
    }

    #[cfg(feature = "postgres")]
    pub fn waited_for(&self) -> Vec<JobId> {
        self.0.lock().iter().filter(|(_, pulse)| pulse.receiver_count() > 0).map(|(id, _)| *id).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiters_leave_nothing_behind() {
        let pulses = Pulses::default();
        let kept = JobId::random();
        let waiting = pulses.subscribe(kept);
        for _ in 0..10_000 {
            drop(pulses.subscribe(JobId::random()));
        }
        assert!(pulses.0.lock().len() < 200);
        pulses.publish(kept, Some(Pulse { last_seq: 7, ..Pulse::default() }));
        pulses.publish(kept, Some(Pulse { last_seq: 3, ended: true, ..Pulse::default() }));
        assert_eq!(*waiting.borrow(), Pulse { last_seq: 7, ended: false, cancel_requested: false }, "an older one");
        for (last_seq, ended) in [(8, true), (9, false)] {
            let pulse = Pulse { last_seq, ended, cancel_requested: false };
            pulses.publish(kept, Some(pulse));
            assert_eq!(*waiting.borrow(), pulse, "a job that is run again");
        }
        pulses.publish(kept, None);
        assert!(waiting.has_changed().is_err());
    }
}
