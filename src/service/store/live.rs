//! Labels of running jobs for clients that watch them. They live in the process that runs the job; other processes
//! have none. A job without a watcher copies no labels. The labels that were shown last stay in memory until the job
//! ends; a new watcher gets them first.
//!
//! There are at most [`MOST_WATCHERS`] watchers. Each costs at most [`MOST_FACES`] labels in memory, as does each
//! running job that was watched, and each of its events 8 bytes a face that changed, in base64. There is one event in
//! [`PACE`] at most, and a slow client misses labels in between.

use std::collections::HashMap;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use parking_lot::Mutex;
use serde::Serialize;
use tesserae_mesh::job::Viewer;
use tokio::sync::watch;
use utoipa::ToSchema;

use crate::store::JobId;

/// Faces of the largest mesh whose labels can be watched.
pub(crate) const MOST_FACES: u64 = 300_000;

/// Watchers of all jobs together; a stream beyond them has no labels.
const MOST_WATCHERS: usize = 32;

/// Least time between two sets of labels of a job.
const PACE: Duration = Duration::from_millis(250);

/// One label a face, in upload order.
type Labels = Arc<[u32]>;

/// Labels of a job; empty before the first ones.
type Shown = watch::Sender<Labels>;

/// The jobs that run, are watched, or both.
#[derive(Debug, Default)]
pub(crate) struct Live(Mutex<HashMap<JobId, Weak<Shown>>>);

#[derive(Debug)]
pub(crate) struct Channel {
    labels: Arc<Shown>,
    /// When the next labels are due.
    next: Mutex<Instant>,
}

#[derive(Debug)]
pub(crate) struct Watcher {
    labels: watch::Receiver<Labels>,
    sent: Labels,
    /// Kept for the next watcher, and so that the labels outlast the job.
    _job: Arc<Shown>,
}

/// Data of the event `labels`.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct LabelsEvent {
    /// Faces of the mesh.
    faces: u64,
    /// Base64: for each face whose label changed since the event before, and at first for every face, the face and its
    /// label, 32 bits each, little endian. Labels below the number of faces; the numbers are those of this attempt, not
    /// of the result.
    changes: String,
}

impl Live {
    /// A job that runs from now on, watched or not.
    pub fn job(&self, id: JobId) -> Channel {
        Channel { labels: of(&mut self.0.lock(), id), next: Mutex::new(Instant::now()) }
    }

    /// Watches a job from now on; none where there are too many watchers.
    pub fn watch(&self, id: JobId) -> Option<Watcher> {
        let mut jobs = self.0.lock();
        let watchers = jobs.values().filter_map(Weak::upgrade).map(|job| job.receiver_count());
        if watchers.sum::<usize>() >= MOST_WATCHERS {
            return None;
        }
        let job = of(&mut jobs, id);
        let mut labels = job.subscribe();
        if !labels.borrow().is_empty() {
            labels.mark_changed();
        }
        Some(Watcher { labels, sent: Labels::default(), _job: job })
    }
}

/// The labels of a job; those of jobs that are neither run nor watched go.
fn of(jobs: &mut HashMap<JobId, Weak<Shown>>, id: JobId) -> Arc<Shown> {
    jobs.retain(|_, job| job.strong_count() > 0);
    jobs.get(&id).and_then(Weak::upgrade).unwrap_or_else(|| {
        let job = Arc::default();
        jobs.insert(id, Arc::downgrade(&job));
        job
    })
}

impl Viewer for Channel {
    fn watches(&self) -> bool {
        self.labels.receiver_count() > 0
    }

    /// Whether a client watches, and the last labels are long enough ago.
    fn is_due(&self) -> bool {
        Instant::now() >= *self.next.lock() && self.watches()
    }

    fn show(&self, labels: Vec<u32>) {
        *self.next.lock() = Instant::now() + PACE;
        self.labels.send_replace(labels.into());
    }
}

impl Watcher {
    /// The next labels, once there are any.
    pub async fn next(&mut self) -> LabelsEvent {
        match self.labels.changed().await {
            Ok(()) => self.changes(),
            // it is there as long as this is
            Err(_) => std::future::pending().await,
        }
    }

    /// Labels that are there and were not sent.
    pub fn now(&mut self) -> Option<LabelsEvent> {
        self.labels.has_changed().unwrap_or(false).then(|| self.changes())
    }

    fn changes(&mut self) -> LabelsEvent {
        let labels = Arc::clone(&self.labels.borrow_and_update());
        let is_first = self.sent.len() != labels.len();
        let mut bytes = Vec::new();
        for (face, &label) in labels.iter().enumerate() {
            if is_first || self.sent[face] != label {
                bytes.extend((face as u32).to_le_bytes());
                bytes.extend(label.to_le_bytes());
            }
        }
        let faces = labels.len() as u64;
        self.sent = labels;
        LabelsEvent { faces, changes: STANDARD.encode(bytes) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(event: &LabelsEvent) -> Vec<[u32; 2]> {
        let bytes = STANDARD.decode(&event.changes).expect("base64");
        let numbers: Vec<u32> = bytes.as_chunks().0.iter().map(|&four| u32::from_le_bytes(four)).collect();
        numbers.as_chunks().0.to_vec()
    }

    #[test]
    fn each_watcher_gets_what_changed_since_its_last_labels() {
        let live = Arc::<Live>::default();
        let id = JobId::random();
        let job = live.job(id);
        let mut watcher = live.watch(id).expect("a watcher");
        assert!(watcher.now().is_none(), "nothing was shown");
        job.show(vec![0, 1, 1]);
        assert_eq!(watcher.now().map(|event| pairs(&event)), Some(vec![[0, 0], [1, 1], [2, 1]]));
        assert!(watcher.now().is_none());
        let mut late = live.watch(id).expect("a watcher");
        job.show(vec![0, 2, 1]);
        job.show(vec![0, 0, 1]);
        assert_eq!(watcher.now().map(|event| pairs(&event)), Some(vec![[1, 0]]));
        assert_eq!(late.now().map(|event| pairs(&event).len()), Some(3));
    }

    #[test]
    fn labels_stay_for_the_next_watcher_until_the_job_has_ended() {
        let live = Arc::<Live>::default();
        let id = JobId::random();
        let job = live.job(id);
        let watcher = live.watch(id).expect("a watcher");
        job.show(vec![4, 4]);
        drop(watcher);
        assert!(!job.watches() && !job.is_due());
        let mut next = live.watch(id).expect("a watcher");
        assert_eq!(next.now().map(|event| pairs(&event)), Some(vec![[0, 4], [1, 4]]));
        job.show(vec![4, 5]);
        drop(job);
        assert_eq!(next.now().map(|event| pairs(&event)), Some(vec![[1, 5]]));
        drop(next);
        drop(live.job(id));
        assert!(live.0.lock().values().all(|job| job.strong_count() == 0));
    }

    #[test]
    fn a_job_is_watched_as_long_as_it_has_watchers_of_which_there_are_not_too_many() {
        let live = Arc::<Live>::default();
        let id = JobId::random();
        let mut watchers: Vec<Watcher> = (0..MOST_WATCHERS).filter_map(|_| live.watch(id)).collect();
        assert_eq!(watchers.len(), MOST_WATCHERS);
        assert!(live.watch(JobId::random()).is_none());
        watchers.pop();
        assert!(live.watch(JobId::random()).is_some());
        watchers.clear();
        assert!(live.0.lock().values().all(|job| job.strong_count() == 0));
    }
}
