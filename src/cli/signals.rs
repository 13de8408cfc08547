//! Signals to a command that works on meshes: Ctrl-C and SIGTERM stop it.
//!
//! A command has one flag for stopping. Work looks at it and ends in order; a system call that may block for ever, such
//! as opening a named pipe, is marked by [`Blocking`], and the process then ends at once.

use std::io;
use std::process;
use std::sync::atomic::{AtomicUsize, Ordering, fence};
use std::sync::{Once, OnceLock};

use tesserae_mesh::device::Cancel;

use super::complain;

/// The flag of this process, and the signal that raised it.
static CANCEL: OnceLock<Cancel> = OnceLock::new();
static SIGNAL: OnceLock<&'static str> = OnceLock::new();

/// How many [`Blocking`] there are.
static BLOCKING: AtomicUsize = AtomicUsize::new(0);

/// A flag that the first request to stop raises. The second ends the process, as does the first while [`Blocking`].
pub fn cancel_when_asked() -> Cancel {
    CANCEL.get_or_init(raised_by_signals).clone()
}

/// To be called once: two threads would take one signal for two.
fn raised_by_signals() -> Cancel {
    let cancel = Cancel::default();
    let raised = cancel.clone();
    let on_request = move |signal| {
        if raised.is_cancelled() {
            process::exit(130);
        }
        let _ = SIGNAL.set(signal);
        raised.cancel();
        fence(Ordering::SeqCst); // either this thread sees the mark or `Blocking::begin` sees the flag
        if BLOCKING.load(Ordering::SeqCst) > 0 {
            say_stopped();
            process::exit(1);
        }
    };
    // Without handlers the system's own way of stopping stays in force.
    let _ = handle(on_request);
    cancel
}

/// Calls `on_request` with the name of each signal that asks to stop, on a thread of its own.
#[cfg(unix)]
fn handle(on_request: impl Fn(&'static str) + Send + 'static) -> io::Result<()> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGTERM, SIGINT])?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        signals.forever().for_each(|signal| on_request(if signal == SIGTERM { "SIGTERM" } else { "SIGINT" }));
    })?;
    Ok(())
}

/// Calls `on_request` at each Ctrl-C, on a thread of its own.
#[cfg(windows)]
fn handle(on_request: impl Fn(&'static str) + Send + 'static) -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(move || on_request("Ctrl-C"))
}

/// Says once that a request to stop has ended the command: its thread may notice it as well as that of the signals.
pub fn say_stopped() {
    static SAID: Once = Once::new();
    SAID.call_once(|| complain(&stopped()));
}

fn stopped() -> String {
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
