//! Signals to the service: Ctrl-C and SIGTERM stop it, SIGHUP makes it read its tokens again.

use std::io;
use std::sync::Arc;

use tokio::sync::Notify;

/// Takes requests to stop from here on; the future completes with the first. Needs a tokio runtime around it.
#[cfg(unix)]
pub fn requests_to_stop() -> io::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    })
}

/// Takes requests to stop from here on; the future completes with the first. Needs a tokio runtime around it.
#[cfg(windows)]
pub fn requests_to_stop() -> io::Result<impl Future<Output = ()>> {
    let mut interrupt = tokio::signal::windows::ctrl_c()?;
    Ok(async move {
        interrupt.recv().await;
    })
}

/// Notifies at every SIGHUP from here on, which would end the process otherwise. Needs a tokio runtime around it.
#[cfg(unix)]
pub fn notify_at_hangup(notify: Arc<Notify>) -> io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut hangups = signal(SignalKind::hangup())?;
    tokio::spawn(async move {
        while hangups.recv().await.is_some() {
            tracing::info!("SIGHUP: reading the tokens again, where there are any");
            notify.notify_one();
        }
    });
    Ok(())
}

/// There is no such signal.
#[cfg(windows)]
pub fn notify_at_hangup(_: Arc<Notify>) -> io::Result<()> {
    Ok(())
}
