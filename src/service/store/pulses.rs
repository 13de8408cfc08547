//! Waking tasks that wait for the store: for a change of one job ([`Pulses`]), or for any job to arrive or to end.

use std::cmp::Ordering;
use std::collections::HashMap;

use parking_lot::Mutex;
use tokio::sync::watch;

use super::{JobId, Pulse};

/// A count that changes with every [`notify`](Self::notify), for tasks that wait for the next one.
#[derive(Debug, Default)]
pub(super) struct Signal(watch::Sender<u64>);

impl Signal {
    /// Wakes all receivers.
    pub fn notify(&self) {
        self.0.send_modify(|count| *count += 1);
    }

    /// A receiver that is marked as changed, so that its task looks once before it waits.
    pub fn subscribe(&self) -> watch::Receiver<u64> {
        let mut receiver = self.0.subscribe();
        receiver.mark_changed();
        receiver
    }
}

/// Receivers by job, for a store whose jobs are not in memory. Jobs without a receiver are dropped when their number
/// has doubled.
#[derive(Debug, Default)]
pub(super) struct Pulses(Mutex<Waiters>);

#[derive(Debug, Default)]
struct Waiters {
    jobs: HashMap<JobId, watch::Sender<Pulse>>,
    /// Number of jobs at which those without a receiver are dropped.
    sweep_at: usize,
}

impl Pulses {
    /// A receiver of every change of a job from now on. Subscribe first, then [`publish`](Self::publish) the stored
    /// state: no change in between is missed.
    pub fn subscribe(&self, id: JobId) -> watch::Receiver<Pulse> {
        let mut waiters = self.0.lock();
        if waiters.jobs.len() >= waiters.sweep_at {
            waiters.jobs.retain(|_, pulse| pulse.receiver_count() > 0);
            waiters.sweep_at = 2 * waiters.jobs.len() + 64;
        }
        waiters.jobs.entry(id).or_default().subscribe()
    }

    /// Wakes the receivers of a job. A pulse with older events than the last one is dropped. An ended job that runs
    /// again has newer events, so its pulse replaces the last one.
    pub fn publish(&self, id: JobId, pulse: Pulse) {
        if let Some(waiting) = self.0.lock().jobs.get(&id) {
            waiting.send_if_modified(|told| {
                let newer = match pulse.last_seq.cmp(&told.last_seq) {
                    Ordering::Less => *told,
                    Ordering::Greater => pulse,
                    Ordering::Equal => Pulse {
                        last_seq: told.last_seq,
                        cancel_requested: told.cancel_requested || pulse.cancel_requested,
                        ended: told.ended || pulse.ended,
                    },
                };
                let changed = newer != *told;
                *told = newer;
                changed
            });
        }
    }

    /// Jobs with a receiver.
    #[cfg(feature = "postgres")]
    pub fn waited_for(&self) -> Vec<JobId> {
        let waiters = self.0.lock();
        waiters.jobs.iter().filter(|(_, pulse)| pulse.receiver_count() > 0).map(|(id, _)| *id).collect()
    }

    /// Whether a job has a receiver.
    #[cfg(feature = "postgres")]
    pub fn is_waited_for(&self, id: JobId) -> bool {
        self.0.lock().jobs.get(&id).is_some_and(|pulse| pulse.receiver_count() > 0)
    }

    /// Drops the receivers of a deleted job.
    pub fn forget(&self, id: JobId) {
        self.0.lock().jobs.remove(&id);
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
        assert!(pulses.0.lock().jobs.len() < 200);
        pulses.publish(kept, Pulse { last_seq: 7, ..Pulse::default() });
        pulses.publish(kept, Pulse { last_seq: 3, ended: true, ..Pulse::default() });
        assert_eq!(*waiting.borrow(), Pulse { last_seq: 7, ended: false, cancel_requested: false }, "an older one");
        for (last_seq, ended) in [(8, true), (9, false)] {
            pulses.publish(kept, Pulse { last_seq, ended, ..Pulse::default() });
            assert_eq!(
                *waiting.borrow(),
                Pulse { last_seq, ended, cancel_requested: false },
                "a job that is run again"
            );
        }
        pulses.forget(kept);
        assert!(waiting.has_changed().is_err());
    }
}
