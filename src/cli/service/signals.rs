//! Signals to the service: Ctrl-C and SIGTERM stop it.

use std::io;
use std::sync::Arc;

use tokio::sync::Notify;

/// Takes requests to stop from here on: the future completes with the first, and each later one notifies `again`. Needs
/// a tokio runtime around it.
pub fn requests_to_stop(again: Arc<Notify>) -> io::Result<impl Future<Output = ()>> {
    let mut requests = Requests::new()?;
    Ok(async move {
        requests.next().await;
        tokio::spawn(async move {
            loop {
                requests.next().await;
                again.notify_one();
            }
        });
    })
}

/// Requests to stop: SIGTERM and Ctrl-C.
struct Requests {
    terminate: tokio::signal::unix::Signal,
    interrupt: tokio::signal::unix::Signal,
    /// Writes beyond the limit of a file's size fail, in place of ending the process.
    _file_size: tokio::signal::unix::Signal,
}

impl Requests {
    fn new() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self {
            terminate: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
            _file_size: signal(SignalKind::from_raw(signal_hook::consts::SIGXFSZ))?,
        })
    }

    async fn next(&mut self) {
        tokio::select! {
            _ = self.terminate.recv() => {}
            _ = self.interrupt.recv() => {}
        }
    }
}
