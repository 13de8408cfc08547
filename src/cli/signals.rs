//! Being asked to stop: Ctrl-C, and on Unix SIGTERM.

use std::io;

use crate::device::Cancel;

/// Waits for the first request to stop.
pub async fn asked_to_stop() -> io::Result<()> {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let mut terminate = signal(SignalKind::terminate())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
        Ok(())
    }
    #[cfg(not(unix))]
    tokio::signal::ctrl_c().await
}

/// Cancels the work at the first request to stop, and ends the process at the second.
pub fn cancel_when_asked(cancel: Cancel) {
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        // Without a runtime or handlers the system's own way of stopping stays in force.
        if let Ok(runtime) = runtime
            && runtime.block_on(asked_to_stop()).is_ok()
        {
            cancel.cancel();
            if runtime.block_on(asked_to_stop()).is_ok() {
                std::process::exit(130);
            }
        }
    });
}
