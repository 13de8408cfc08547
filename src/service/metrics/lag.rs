//! How late the threads that answer requests begin what is due: much later only while all of them are busy or blocked.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

use crate::metrics::Metrics;

const EVERY: Duration = Duration::from_millis(250);

/// Measures it on the runtime of this task, until `close`.
pub(crate) async fn watch(metrics: Arc<Metrics>, close: CancellationToken) {
    loop {
        let due = Instant::now() + EVERY;
        if close.run_until_cancelled(sleep_until(due)).await.is_none() {
            return;
        }
        metrics.families.request_lag.observe(due.elapsed().as_secs_f64());
    }
}
