//! Those who wait for jobs: who waits for which, for stores whose jobs are not in memory.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use super::{JobId, Pulse};

/// Waiters by job. Holds no more jobs than some are waiting for, give or take a factor of two.
#[derive(Debug, Default)]
pub(super) struct Pulses(Mutex<Waiters>);

#[derive(Debug, Default)]
struct Waiters {
    jobs: HashMap<JobId, watch::Sender<Pulse>>,
    /// Number of jobs at which those that nobody waits for are looked for.
    sweep_at: usize,
}

impl Pulses {
    /// Tells of every change of a job from now on. Begin with this, then [`publish`](Self::publish) what the store has:
    /// then no change in between is missed.
    pub fn subscribe(&self, id: JobId) -> watch::Receiver<Pulse> {
        let mut waiters = self.lock();
        if waiters.jobs.len() >= waiters.sweep_at {
            waiters.jobs.retain(|_, pulse| pulse.receiver_count() > 0);
            waiters.sweep_at = 2 * waiters.jobs.len() + 64;
        }
        waiters.jobs.entry(id).or_default().subscribe()
    }

    /// Tells those who wait for a job, if any. A pulse never goes back: what is older than what was told is not told. An
    /// ended job that runs again has newer events, so that its newer pulse replaces the older one.
    pub fn publish(&self, id: JobId, pulse: Pulse) {
        if let Some(waiting) = self.lock().jobs.get(&id) {
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

    /// A job is gone: nobody waits for it any more.
    pub fn forget(&self, id: JobId) {
        self.lock().jobs.remove(&id);
    }

    fn lock(&self) -> MutexGuard<'_, Waiters> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
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
        assert!(pulses.lock().jobs.len() < 200);
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
