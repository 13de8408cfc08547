//! How the allocator deals with memory that jobs give back.
//!
//! By default, the C library of Linux maps what is large, gives it back to the system at once, and gives each thread memory of
//! its own. The system then clears every page anew that is used a second time, at some microseconds a page, and threads wait for
//! each other while pages come and go; and what one thread gave back, the others do not find. A job gives and takes much memory,
//! a mesh's size at a time. So up to four processors share one place for it here, more have one for every four of them, and what
//! is given back stays: in a process that does one job until the end, in a service until it is quiet.
//!
//! Both are asked for before there is another thread. Where that is another C library or system, all stays as it is.

/// Keeps all memory until the process ends.
pub(crate) fn keep() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    glibc::set(&[(libc::M_MMAP_MAX, 0), (libc::M_TRIM_THRESHOLD, -1)]);
}

/// Keeps pieces of up to 32 MiB for the next job, and gives back what is not in use when the process has been quiet for half a
/// minute, by a thread of its own. What lies free at the end of a place beyond 256 MiB goes back at once. Of more than four
/// processors, up to 64 MiB stay for every further four.
pub(crate) fn keep_between_jobs() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        glibc::set(&[(libc::M_MMAP_THRESHOLD, 32 << 20), (libc::M_TRIM_THRESHOLD, 256 << 20)]);
        // where the thread cannot be started, memory stays kept
        let _ = std::thread::Builder::new().name("memory".to_owned()).spawn(glibc::trim_when_quiet);
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the standard library has no way to the allocator's settings")]
mod glibc {
    use std::time::Duration;

    use libc::c_int;
    use rustix::time::{ClockId, clock_gettime};

    /// By how much a place for memory grows at least, in bytes: addresses, not memory in use.
    const GROWTH: c_int = 16 << 20;

    /// Processors that share a place for memory.
    const SHARE: usize = 4;

    /// A process is quiet that has had less than [`LITTLE`] to do in this time.
    const WHILE: Duration = Duration::from_secs(30);

    /// Time of processors: requests that ask how a service is take less.
    const LITTLE: Duration = Duration::from_millis(200);

    pub fn set(settings: &[(c_int, c_int)]) {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let places = c_int::try_from(processors.div_ceil(SHARE)).unwrap_or(c_int::MAX);
        for &(parameter, value) in settings.iter().chain(&[(libc::M_TOP_PAD, GROWTH), (libc::M_ARENA_MAX, places)]) {
            // SAFETY: mallopt takes two integers and answers whether it knows the parameter and takes the value; nothing depends
            // on that. No other thread may allocate meanwhile: this runs at the start of the process, before there is one.
            unsafe { libc::mallopt(parameter, value) };
        }
    }

    /// Gives back what is free, once after each time that there was something to do.
    pub fn trim_when_quiet() {
        let mut is_due = false;
        let mut before = processor_time();
        loop {
            std::thread::sleep(WHILE);
            let now = processor_time();
            if now.saturating_sub(before) > LITTLE {
                is_due = true;
            } else if std::mem::take(&mut is_due) {
                // SAFETY: malloc_trim touches no memory that is in use, and any thread may call it at any time. It answers
                // whether there was anything to give.
                unsafe { libc::malloc_trim(0) };
            }
            before = now;
        }
    }

    /// What this process has taken of all processors so far.
    fn processor_time() -> Duration {
        clock_gettime(ClockId::ProcessCPUTime).try_into().unwrap_or_default()
    }
}
