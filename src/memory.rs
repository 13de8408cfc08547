//! How the allocator deals with memory that jobs give back.
//!
//! By default, the C library of Linux maps what is large, gives it back to the system at once, and gives each thread memory of
//! its own. The system then clears every page anew that is used a second time, at some microseconds a page, and threads wait for
//! each other while pages come and go; and what one thread gave back, the others do not find. A job gives and takes much memory,
//! a mesh's size at a time. So few threads have memory of their own here, and what is given back stays: until the end in a
//! process that does one job, within bounds in a service.
//!
//! Where that is another C library or system, all stays as it is.

/// Keeps all memory until the process ends.
pub(crate) fn keep() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    glibc::set(&[(libc::M_MMAP_MAX, 0), (libc::M_TRIM_THRESHOLD, -1)]);
}

/// Keeps memory from one job for the next: pieces of up to 32 MiB, and no more than 256 MiB at the end of what there is.
pub(crate) fn keep_between_jobs() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    glibc::set(&[(libc::M_MMAP_THRESHOLD, 32 << 20), (libc::M_TRIM_THRESHOLD, 256 << 20)]);
}

/// Gives back to the system what is kept and not in use.
pub(crate) fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    glibc::trim();
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the standard library has no way to the allocator's settings")]
mod glibc {
    use libc::c_int;

    /// By how much memory grows at least, in bytes: addresses, not memory in use.
    const GROWTH: c_int = 16 << 20;

    /// Processors that share the memory of one thread.
    const SHARE: usize = 4;

    pub fn set(settings: &[(c_int, c_int)]) {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let own = c_int::try_from(processors.div_ceil(SHARE)).unwrap_or(c_int::MAX);
        for &(parameter, value) in settings.iter().chain(&[(libc::M_TOP_PAD, GROWTH), (libc::M_ARENA_MAX, own)]) {
            // SAFETY: mallopt takes two integers, and may be called at any time by any thread. It answers whether it knows the
            // parameter and takes the value; nothing depends on that.
            unsafe { libc::mallopt(parameter, value) };
        }
    }

    pub fn trim() {
        // SAFETY: malloc_trim touches no memory that is in use, and may be called at any time by any thread. It answers whether
        // there was anything to give.
        unsafe { libc::malloc_trim(0) };
    }
}
