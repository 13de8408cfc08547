//! How the allocator deals with memory that jobs give back.
//!
//! By default, the C library of Linux maps what is large, gives it back to the system at once, and gives each thread memory of
//! its own. The system then clears every page anew that is used a second time, at some microseconds a page, and threads wait for
//! each other while pages come and go; and what one thread gave back, the others do not find. A job gives and takes much memory,
//! a mesh's size at a time. So fewer places for it are shared here, and what is given back stays: in a process that does one job
//! until the end, in a service until it is quiet.
//!
//! Both are asked for before there is another thread. Where that is another C library or system, all stays as it is.

/// Keeps all memory until the process ends. Up to four processors share one place for it, more have one for every four.
pub(crate) fn keep() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    glibc::set(glibc::processors().div_ceil(4), &[(libc::M_MMAP_MAX, 0), (libc::M_TRIM_THRESHOLD, -1)]);
}

/// Keeps pieces of up to 32 MiB for the next job, and gives back what is not in use when the process has been quiet for half a
/// minute, by a thread of its own. There are two places for each processor: with one for two processors, which a service of small
/// jobs often asks for a little, it did a fifth fewer of them (293 a second in place of 370). What lies free at the end of a place
/// beyond 32 MiB goes back at once; so much of each but the first may stay when all is quiet.
pub(crate) fn keep_between_jobs() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// Bytes.
        const MOST: libc::c_int = 32 << 20;
        glibc::set(2 * glibc::processors(), &[(libc::M_MMAP_THRESHOLD, MOST), (libc::M_TRIM_THRESHOLD, MOST)]);
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

    /// A process is quiet that has had less than [`LITTLE`] to do in this time.
    const WHILE: Duration = Duration::from_secs(30);

    /// Time of processors: who asks for `/healthz` and `/readyz` every second and for `/metrics` every five takes 40 ms.
    const LITTLE: Duration = Duration::from_millis(200);

    pub fn processors() -> usize {
        std::thread::available_parallelism().map_or(1, usize::from)
    }

    /// Settings, and how many places for memory there may be.
    pub fn set(places: usize, settings: &[(c_int, c_int)]) {
        let places = c_int::try_from(places).unwrap_or(c_int::MAX);
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
