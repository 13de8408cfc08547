//! Rows of a job's report on their way to its events.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::report::Row;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::bounds::AGAIN;
use crate::store::{JobEvent, Progress, Store, Ticket};

/// Rows that were not appended when the last one came, and the progress after them.
pub(super) type Log = Mutex<Option<(Vec<JobEvent>, Progress)>>;

pub(super) type OnRow = Box<dyn FnMut(Row) + Send>;

/// Rows that are to become events.
pub(super) struct Inbox {
    rows: mpsc::UnboundedReceiver<Row>,
    clustered: CancellationToken,
}

impl Inbox {
    /// An inbox, and what puts rows there. It is unbounded, so that the device never waits; the report holds the same
    /// rows anyway. The job is clustered once that is dropped.
    pub fn open() -> (OnRow, Self) {
        let (sender, rows) = mpsc::unbounded_channel();
        let clustered = CancellationToken::new();
        let until = clustered.clone().drop_guard();
        let on_row = move |row| {
            let _until = &until;
            drop(sender.send(row));
        };
        (Box::new(on_row), Self { rows, clustered })
    }

    /// Appends rows to the events of a job until it is clustered; what is left then goes to `log`. No row wakes this.
    pub async fn tell(mut self, store: Arc<Store>, ticket: Ticket, log: Arc<Log>) -> Result<()> {
        let mut progress = Progress::default();
        let (mut events, mut at_once) = (Vec::new(), 1024);
        'rows: loop {
            // rows are gathered: a short job has all of them stored with its end
            let is_over = tokio::time::timeout(Duration::from_millis(50), self.clustered.cancelled()).await.is_ok();
            while events.len() < at_once
                && let Ok(row) = self.rows.try_recv()
            {
                events.push(event(row, &mut progress)?);
            }
            if is_over && self.rows.is_empty() {
                *log.lock() = (!events.is_empty()).then_some((events, progress));
                return Ok(());
            }
            if events.is_empty() {
                continue;
            }
            // As long as the disk fails they are kept; the job does not end before they are stored, or lost with it.
            while let Err(error) = store.append(ticket, events.clone(), progress).await {
                if !error.is_of_storage() {
                    return Err(error);
                }
                // on a full disk the end of the job stores them
                if error.kind == Kind::InsufficientStorage && self.clustered.is_cancelled() {
                    at_once = usize::MAX;
                    continue 'rows;
                }
                tokio::time::sleep(AGAIN).await;
            }
            events.clear();
        }
    }
}

fn event(row: Row, progress: &mut Progress) -> Result<JobEvent> {
    match row {
        Row::Iteration(row) => {
            progress.iterations = row.iteration;
            progress.phase = Some(row.phase);
            progress.energy = row.energy;
            serde_json::to_string(&row).map(JobEvent::Iteration)
        }
        Row::Round(row) => {
            progress.rounds = row.round;
            progress.clusters_left = Some(row.clusters);
            progress.energy = row.energy;
            serde_json::to_string(&row).map(JobEvent::Round)
        }
    }
    .map_err(|error| Error::internal(format_args!("a report cannot be written as JSON: {error}")))
}
