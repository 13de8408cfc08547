//! Time in which the device worked: time with one job or several counts once.

use std::time::{Duration, Instant};

use parking_lot::{Mutex, MutexGuard};

#[derive(Debug, Default)]
pub(super) struct Busy(Mutex<BusyTime>);

#[derive(Debug, Default)]
struct BusyTime {
    jobs: usize,
    /// When the first of them began, or was last counted.
    since: Option<Instant>,
    counted: Duration,
}

impl Busy {
    /// A job begins; it ends when this is dropped.
    pub fn begin(&self) -> Working<'_> {
        self.at(Instant::now()).jobs += 1;
        Working(self)
    }

    /// Seconds so far, jobs that have not ended included.
    pub fn seconds(&self) -> f64 {
        self.at(Instant::now()).counted.as_secs_f64()
    }

    /// The state after what passed until `now` was counted.
    fn at(&self, now: Instant) -> MutexGuard<'_, BusyTime> {
        let mut state = self.0.lock();
        if let Some(since) = state.since.replace(now).filter(|_| state.jobs > 0) {
            state.counted += now.saturating_duration_since(since);
        }
        state
    }
}

/// A job that is worked on.
#[derive(Debug)]
pub(crate) struct Working<'a>(&'a Busy);

impl Drop for Working<'_> {
    fn drop(&mut self) {
        self.0.at(Instant::now()).jobs -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_with_several_jobs_counts_once_and_time_without_does_not() {
        let busy = Busy::default();
        let start = Instant::now() + Duration::from_secs(1000);
        let after = |seconds| start + Duration::from_secs(seconds);
        let counted = |seconds| busy.at(after(seconds)).counted.as_secs();
        assert_eq!(counted(0), 0);
        assert_eq!(counted(5), 0, "nothing to do");
        busy.at(after(10)).jobs += 1;
        assert_eq!(counted(12), 2, "jobs that have not ended count");
        busy.at(after(13)).jobs += 1;
        busy.at(after(15)).jobs -= 1;
        assert_eq!(counted(16), 6);
        busy.at(after(20)).jobs -= 1;
        assert_eq!(counted(99), 10);
        drop(busy.begin());
        assert_eq!(busy.0.lock().jobs, 0);
    }
}
