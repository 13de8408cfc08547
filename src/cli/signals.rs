//! Signals: Ctrl-C and SIGTERM stop a command, SIGHUP makes the service read its tokens again.
//!
//! A command has one flag for stopping. Work looks at it and ends in order; a system call that may block for ever, such
//! as opening a named pipe, is marked by [`Blocking`], and the process then ends at once.

use std::io;
use std::process;
use std::sync::atomic::{AtomicUsize, Ordering, fence};
use std::sync::{Arc, OnceLock};

use tokio::sync::Notify;

use super::complain;
use crate::device::Cancel;

/// The flag of this process, and the signal that raised it.
static CANCEL: OnceLock<Cancel> = OnceLock::new();
static SIGNAL: OnceLock<&'static str> = OnceLock::new();

/// How many [`Blocking`] there are.
static BLOCKING: AtomicUsize = AtomicUsize::new(0);

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

/// A flag that the first request to stop raises. The second ends the process, as does the first while [`Blocking`].
pub fn cancel_when_asked() -> Cancel {
    let cancel = CANCEL.get_or_init(Cancel::default).clone();
    let raised = cancel.clone();
    std::thread::spawn(move || {
        // Without a runtime or handlers the system's own way of stopping stays in force.
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else {
            return;
        };
        runtime.block_on(async {
            let Ok(mut requests) = Requests::new() else { return };
            let _ = SIGNAL.set(requests.next().await);
            raised.cancel();
            fence(Ordering::SeqCst); // either this thread sees the mark or `Blocking::begin` sees the flag
            if BLOCKING.load(Ordering::SeqCst) > 0 {
                complain(&stopped());
                process::exit(1);
            }
            requests.next().await;
            process::exit(130);
        });
    });
    cancel
}

/// What is said when a request to stop has ended the command.
pub fn stopped() -> String {
    format!("stopped by {} before the end", SIGNAL.get().copied().unwrap_or("a signal"))
}

/// Whether the command was asked to stop.
pub fn is_stopped() -> bool {
    CANCEL.get().is_some_and(Cancel::is_cancelled)
}

/// Fails once the command was asked to stop.
pub fn check() -> io::Result<()> {
    if is_stopped() { Err(io::Error::other(stopped())) } else { Ok(()) }
}

/// While it lives, a request to stop ends the process at once. No temporary file may exist then.
pub struct Blocking(());

impl Blocking {
    /// Begins the time in which a system call may block. Fails where the command was already asked to stop.
    pub fn begin() -> io::Result<Self> {
        BLOCKING.fetch_add(1, Ordering::SeqCst);
        fence(Ordering::SeqCst);
        let blocking = Self(());
        check()?;
        Ok(blocking)
    }
}

impl Drop for Blocking {
    fn drop(&mut self) {
        BLOCKING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// The signals that ask to stop.
#[cfg(unix)]
struct Requests {
    terminate: tokio::signal::unix::Signal,
    interrupt: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Requests {
    fn new() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self { terminate: signal(SignalKind::terminate())?, interrupt: signal(SignalKind::interrupt())? })
    }

    /// Waits for the next request; gives the name of the signal.
    async fn next(&mut self) -> &'static str {
        tokio::select! {
            _ = self.terminate.recv() => "SIGTERM",
            _ = self.interrupt.recv() => "SIGINT",
        }
    }
}

/// The signals that ask to stop.
#[cfg(windows)]
struct Requests(tokio::signal::windows::CtrlC);

#[cfg(windows)]
impl Requests {
    fn new() -> io::Result<Self> {
        Ok(Self(tokio::signal::windows::ctrl_c()?))
    }

    /// Waits for the next request; gives the name of the signal.
    async fn next(&mut self) -> &'static str {
        self.0.recv().await;
        "Ctrl-C"
    }
}
