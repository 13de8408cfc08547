//! The clock by which jobs expire: the system's clock, but at most twice as fast as the time that this process saw
//! pass.
//!
//! Jobs must not expire because the clock jumped forward, and a jump cannot be distinguished from a time in which the
//! service was stopped. Therefore, while the system's clock is ahead, jobs age by two seconds a second. A file keeps
//! the time reached, so that a restart does not lose it.
//!
//! The time reached never goes back. While the system's clock is behind it, jobs age by the system's clock; once that
//! is corrected, nothing is to be caught up.

use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::private;

/// How far the clock may be ahead before that is worth a line in the log.
const NOTABLE: Duration = Duration::from_secs(600);

/// The clocks of the system, read at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    /// The system's clock, which people and other computers set.
    pub wall: SystemTime,
    /// The monotonic clock.
    pub steady: Instant,
}

impl Reading {
    /// As it is now.
    pub fn now() -> Self {
        Self { wall: SystemTime::now(), steady: Instant::now() }
    }
}

/// The time by which jobs grow old.
#[derive(Debug)]
pub(super) struct Aging {
    /// The latest time reached. Later than the clock when the clock was set back.
    reached: SystemTime,
    seen: Instant,
    is_behind: bool,
}

impl Aging {
    /// Continues at the time that was `reached` earlier, or starts at the system's clock.
    pub fn new(reached: Option<SystemTime>, now: Reading) -> Self {
        let reached = reached.unwrap_or(now.wall);
        let mut aging = Self { reached, seen: now.steady, is_behind: false };
        aging.warn(now.wall);
        aging
    }

    /// The time now: the age of an ended job is counted up to it. Never later than the clock.
    pub fn time(&mut self, now: Reading) -> SystemTime {
        let passed = now.steady.saturating_duration_since(self.seen);
        self.seen = now.steady;
        // none: a time that no file of this service holds, which no clock reaches either
        let most = self.reached.checked_add(2 * passed).unwrap_or(now.wall);
        self.reached = self.reached.max(most.min(now.wall));
        self.warn(now.wall);
        self.reached.min(now.wall)
    }

    /// The latest time reached, for [`Aging::new`] after a restart.
    pub fn reached(&self) -> SystemTime {
        self.reached
    }

    fn warn(&mut self, wall: SystemTime) {
        let ahead = wall.duration_since(self.reached).unwrap_or_default();
        let is_behind = ahead > NOTABLE;
        if is_behind && !self.is_behind {
            let seconds = ahead.as_secs();
            tracing::warn!(
                seconds,
                "the clock jumped forward, or the service was stopped for so long: jobs grow old no faster than twice \
                 the time that passes until that is caught up"
            );
        }
        self.is_behind = is_behind;
    }
}

/// Reads the time that was reached from a file; none when there is none.
pub(super) fn load(path: &Path) -> Option<SystemTime> {
    let mut text = String::new();
    std::fs::File::open(path).ok()?.take(32).read_to_string(&mut text).ok()?;
    UNIX_EPOCH.checked_add(Duration::from_secs(text.trim().parse().ok()?))
}

/// Keeps the time that was reached in a file. Writes over what is there, which a full disk lets it.
pub(super) fn save(path: &Path, time: SystemTime) -> io::Result<()> {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let mut file = private::options().open(path)?;
    file.rewind()?;
    // always as long, so that nothing of an earlier time is left behind it
    file.write_all(format!("{seconds:020}\n").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: Duration = Duration::from_secs(86_400);

    fn later(now: Reading, wall: Duration, steady: Duration) -> Reading {
        Reading { wall: now.wall + wall, steady: now.steady + steady }
    }

    #[test]
    fn time_passes_as_the_clock_says() {
        let start = Reading::now();
        let mut aging = Aging::new(None, start);
        for seconds in [1, 30, 3600] {
            let passed = Duration::from_secs(seconds);
            assert_eq!(aging.time(later(start, passed, passed)), start.wall + passed);
        }
    }

    #[test]
    fn a_jump_is_caught_up_with_at_twice_the_time_that_passes() {
        let start = Reading::now();
        let mut aging = Aging::new(None, start);
        let second = Duration::from_secs(1);
        assert_eq!(aging.time(later(start, 9 * DAY, second)), start.wall + 2 * second);
        // the same after a restart
        let mut aging = Aging::new(Some(start.wall), later(start, 9 * DAY, Duration::ZERO));
        assert_eq!(aging.time(later(start, 9 * DAY, DAY)), start.wall + 2 * DAY);
        assert_eq!(aging.time(later(start, 18 * DAY, 9 * DAY)), start.wall + 18 * DAY, "caught up");
    }

    #[test]
    fn a_clock_that_is_set_back_and_corrected_stops_nothing() {
        let start = Reading::now();
        let (second, hour) = (Duration::from_secs(1), Duration::from_secs(3600));
        let back = Reading { wall: start.wall - 300 * DAY, steady: start.steady + second };
        let corrected = later(start, hour, hour);
        let mut aging = Aging::new(None, start);
        assert_eq!(aging.time(back), back.wall, "jobs that end now are not old");
        assert_eq!(aging.reached(), start.wall);
        // started while the clock is behind
        let mut restarted = Aging::new(Some(aging.reached()), back);
        for aging in [&mut aging, &mut restarted] {
            assert_eq!(aging.time(back), back.wall);
            assert_eq!(aging.time(corrected), corrected.wall);
        }
        // a time that only a damaged file holds
        let far = UNIX_EPOCH + Duration::from_secs(i64::MAX as u64);
        assert_eq!(Aging::new(Some(far), start).time(corrected), corrected.wall);
    }

    #[test]
    fn the_time_that_was_reached_outlasts_the_process() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("clock");
        assert_eq!(load(&path), None);
        for seconds in [1 << 40, 7] {
            let time = UNIX_EPOCH + Duration::from_secs(seconds);
            save(&path, time).expect("saved");
            assert_eq!(load(&path), Some(time));
        }
        std::fs::write(&path, "no time").expect("written");
        assert_eq!(load(&path), None);
    }
}
