//! Disk room that is reserved (promised) for the results of accepted jobs.
//!
//! A job is accepted when the disk has room for the [estimate](super::needs) of its result beside all promises. The
//! promise is [updated](Room::try_secure) when the mesh has been read, and again when the size of the result is known.
//! A job that then needs more than its promise waits while other jobs can make room, and fails when none can. A job
//! that needs no more than its promise waits until other files leave the room free.
//!
//! Promises are in memory: they follow from the jobs that have not ended, and are made again when the service starts.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::disk::{STORE_ROOM, State};
use crate::service::store::JobId;

/// The promises of all jobs.
#[derive(Debug, Default)]
pub(super) struct Room(Mutex<Promises>);

#[derive(Debug, Default)]
struct Promises {
    jobs: HashMap<JobId, Promise>,
    /// Sum of all promises.
    bytes: u64,
    /// Number of the last job that began to wait.
    last: u64,
}

#[derive(Debug, Default)]
struct Promise {
    bytes: u64,
    stage: Stage,
    /// The attempt that it is for, 0 for a new job. Older attempts do not change it.
    attempt: u32,
}

/// The stage of a job.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// It is queued, or is being read.
    #[default]
    Accepted,
    /// It waits for room; later ones have larger numbers.
    Waiting(u64),
    /// It has room and will end.
    Secured,
    /// It will not get room.
    GivenUp,
}

/// The outcome of a request for room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// There is room.
    Secured,
    /// Other jobs or files may make room.
    Wait,
    /// Nothing can make room.
    Never,
}

impl Room {
    /// Bytes of all promises.
    pub fn promised(&self) -> u64 {
        self.lock().bytes
    }

    /// Jobs with a promise.
    pub fn jobs(&self) -> Vec<JobId> {
        self.lock().jobs.keys().copied().collect()
    }

    /// Promises room to a job, from an attempt on, if `check` allows so many bytes beside what others were promised.
    pub fn promise<E>(
        &self,
        job: JobId,
        attempt: u32,
        bytes: u64,
        check: impl FnOnce(u64) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut promises = self.lock();
        let before = promises.jobs.get(&job).map_or(0, |promise| promise.bytes);
        check((promises.bytes - before).saturating_add(bytes))?;
        promises.set(job, bytes);
        promises.set_stage(job, Stage::Accepted);
        promises.set_attempt(job, attempt);
        Ok(())
    }

    /// The job ended, and no attempt will follow.
    pub fn give_back(&self, job: JobId) {
        let mut promises = self.lock();
        promises.set(job, 0);
        promises.jobs.remove(&job);
    }

    /// The job ended with an attempt. Nothing happens if it has been promised room for a later one since.
    pub fn give_back_of(&self, job: JobId, attempt: u32) {
        let mut promises = self.lock();
        if promises.jobs.get(&job).is_some_and(|promise| promise.attempt <= attempt) {
            promises.set(job, 0);
            promises.jobs.remove(&job);
        }
    }

    /// Promises an attempt at a job what it turns out to need, of what is free on the disk. With `is_patient` it would
    /// rather wait for jobs that are still to be read.
    pub fn try_secure(&self, job: JobId, attempt: u32, needs: u64, disk: State, is_patient: bool) -> Outcome {
        let State { free, foreign } = disk;
        let mut promises = self.lock();
        promises.set_attempt(job, attempt);
        let promised = promises.jobs.get(&job).map_or(0, |promise| promise.bytes);
        let others = promises.bytes - promised;
        let fits = match needs <= promised {
            true => needs <= free,
            false => others.saturating_add(needs).saturating_add(STORE_ROOM) <= free,
        };
        if fits {
            promises.set(job, needs);
            promises.set_stage(job, Stage::Secured);
            return Outcome::Secured;
        }
        let since = match promises.jobs.get(&job).map(|promise| promise.stage) {
            Some(Stage::Waiting(since)) => since,
            _ => {
                promises.last += 1;
                promises.last
            }
        };
        promises.set_stage(job, Stage::Waiting(since));
        // of several that wait for each other, the last gives way
        let makes_room = |other: &Promise| match other.stage {
            Stage::Accepted => is_patient,
            Stage::Waiting(other) => other > since,
            Stage::Secured => true,
            Stage::GivenUp => true,
        };
        let is_others_fault = needs <= promised && needs <= free.saturating_add(foreign);
        let has_hope = promises.jobs.iter().any(|(id, other)| *id != job && makes_room(other));
        if is_others_fault || has_hope {
            return Outcome::Wait;
        }
        promises.set_stage(job, Stage::GivenUp);
        Outcome::Never
    }

    /// The job waits for its turn again after an attempt. Nothing happens if a later one has been secured room since.
    pub fn put_back(&self, job: JobId, attempt: u32) {
        let mut promises = self.lock();
        if promises.jobs.get(&job).is_some_and(|promise| promise.attempt <= attempt) {
            promises.set_stage(job, Stage::Accepted);
        }
    }

    /// Whether a job was refused room for good.
    pub fn gave_up(&self, job: JobId) -> bool {
        self.lock().jobs.get(&job).is_some_and(|promise| promise.stage == Stage::GivenUp)
    }

    fn lock(&self) -> MutexGuard<'_, Promises> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Promises {
    fn set(&mut self, job: JobId, bytes: u64) {
        let promise = self.jobs.entry(job).or_default();
        self.bytes = self.bytes - promise.bytes + bytes;
        promise.bytes = bytes;
    }

    fn set_stage(&mut self, job: JobId, stage: Stage) {
        self.jobs.entry(job).or_default().stage = stage;
    }

    fn set_attempt(&mut self, job: JobId, attempt: u32) {
        let promise = self.jobs.entry(job).or_default();
        promise.attempt = promise.attempt.max(attempt);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    fn free(free: u64) -> State {
        State { free, foreign: 0 }
    }

    fn promise(room: &Room, bytes: u64, free: u64) -> Result<JobId, u64> {
        let id = JobId::random();
        room.promise(id, 0, bytes, |all| if all <= free { Ok(()) } else { Err(all) })?;
        Ok(id)
    }

    #[test]
    fn promises_add_up_and_are_given_back() {
        let room = Room::default();
        let first = promise(&room, 6, 10).expect("room");
        assert_eq!(promise(&room, 5, 10), Err(11));
        let second = promise(&room, 4, 10).expect("room");
        assert_eq!(room.promised(), 10);
        room.give_back(first);
        room.give_back(first);
        assert_eq!((room.promised(), room.jobs()), (4, vec![second]));
    }

    #[test]
    fn a_job_that_needs_less_than_it_was_promised_leaves_the_rest_to_others() {
        let room = Room::default();
        let job = promise(&room, 100 * MIB, u64::MAX).expect("room");
        assert_eq!(room.try_secure(job, 1, 40 * MIB, free(41 * MIB), true), Outcome::Secured);
        assert_eq!(room.promised(), 40 * MIB);
    }

    #[test]
    fn a_job_that_was_promised_room_waits_while_somebody_else_fills_the_disk() {
        let room = Room::default();
        let job = promise(&room, 100 * MIB, u64::MAX).expect("room");
        let others = State { free: 50 * MIB, foreign: 50 * MIB };
        assert_eq!(room.try_secure(job, 1, 90 * MIB, others, false), Outcome::Wait);
        assert_eq!(room.try_secure(job, 1, 90 * MIB, free(90 * MIB), false), Outcome::Secured);
        // without others, the service itself promised more than there is
        assert_eq!(room.try_secure(job, 1, 90 * MIB, free(50 * MIB), false), Outcome::Never);
    }

    #[test]
    fn a_job_that_needs_more_waits_for_jobs_that_will_end_and_fails_without_them() {
        let room = Room::default();
        let running = promise(&room, 20 * MIB, u64::MAX).expect("room");
        let larger = promise(&room, 10 * MIB, u64::MAX).expect("room");
        assert_eq!(room.try_secure(running, 1, 20 * MIB, free(60 * MIB), false), Outcome::Secured);
        assert_eq!(room.try_secure(larger, 1, 60 * MIB, free(60 * MIB), false), Outcome::Wait);
        room.give_back(running);
        // less than what it needs and the store's room
        assert_eq!(room.try_secure(larger, 1, 60 * MIB, free(60 * MIB), false), Outcome::Never);
        assert!(room.gave_up(larger));
        room.give_back(larger);
        assert!(!room.gave_up(larger));
    }

    #[test]
    fn of_jobs_that_wait_for_each_other_the_last_gives_way() {
        let room = Room::default();
        let jobs = [10, 10, 10].map(|bytes| promise(&room, bytes * MIB, u64::MAX).expect("room"));
        for job in &jobs[..2] {
            assert_eq!(room.try_secure(*job, 1, 50 * MIB, free(60 * MIB), true), Outcome::Wait);
        }
        // now all wait: patience changes nothing
        assert_eq!(room.try_secure(jobs[2], 1, 50 * MIB, free(60 * MIB), true), Outcome::Never);
        assert_eq!(room.try_secure(jobs[0], 1, 50 * MIB, free(60 * MIB), true), Outcome::Wait);
        assert_eq!(room.try_secure(jobs[1], 1, 50 * MIB, free(60 * MIB), true), Outcome::Wait);
        room.give_back(jobs[2]);
        assert_eq!(room.try_secure(jobs[0], 1, 50 * MIB, free(70 * MIB), true), Outcome::Secured);
        assert_eq!(room.try_secure(jobs[1], 1, 50 * MIB, free(70 * MIB), false), Outcome::Wait);
    }

    #[test]
    fn a_job_is_patient_with_jobs_that_are_still_to_be_read_but_not_for_ever() {
        let room = Room::default();
        let larger = promise(&room, MIB, u64::MAX).expect("room");
        promise(&room, MIB, u64::MAX).expect("room");
        assert_eq!(room.try_secure(larger, 1, 50 * MIB, free(50 * MIB), true), Outcome::Wait);
        assert_eq!(room.try_secure(larger, 1, 50 * MIB, free(50 * MIB), false), Outcome::Never);
    }

    #[test]
    fn an_attempt_that_is_over_changes_nothing_for_the_next_one() {
        let room = Room::default();
        let job = promise(&room, MIB, u64::MAX).expect("room");
        assert_eq!(room.try_secure(job, 1, MIB, free(9 * MIB), false), Outcome::Secured);
        // it is retried before the end of the first attempt was taken note of
        room.promise(job, 2, 3 * MIB, |all| if all == 3 * MIB { Ok(()) } else { Err(all) }).expect("room");
        room.give_back_of(job, 1);
        assert_eq!(room.promised(), 3 * MIB);
        assert_eq!(room.try_secure(job, 2, 50 * MIB, free(MIB), false), Outcome::Never);
        room.put_back(job, 1);
        assert!(room.gave_up(job), "the second attempt did not end");
        room.put_back(job, 2);
        assert!(!room.gave_up(job));
        room.give_back_of(job, 2);
        assert_eq!((room.promised(), room.jobs()), (0, vec![]));
    }
}
