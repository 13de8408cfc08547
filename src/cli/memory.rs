//! Settings of the allocator: what becomes of memory that jobs free.
//!
//! By default, glibc maps large blocks, unmaps them when they are freed, and gives each thread an arena of its own. The
//! kernel then clears every page again that is used a second time, at some microseconds a page; threads wait for each
//! other while pages are mapped; and what one thread frees, others cannot use. A job allocates and frees as much as its
//! mesh takes, many times. So there are fewer arenas here, and freed memory is kept: until the end of a process that
//! does one job, and in a service until it is idle. A process that does one job uses large pages, too: a tenth or more
//! less processor time (`benches/results/2026-11-23-two-cores/images.md`). A service uses the same memory again and
//! gains nothing from them.
//!
//! Both functions must be called before there is a second thread. With another C library they do nothing.

/// Keeps all memory until the process ends, in one arena for every four processors, the first GiB of the first one in
/// large pages.
pub fn keep() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        glibc::set(glibc::processors().div_ceil(4), &[(libc::M_MMAP_MAX, 0), (libc::M_TRIM_THRESHOLD, -1)]);
        glibc::use_large_pages();
    }
}

/// Keeps blocks of up to 32 MiB for the next job. A thread of its own frees what is not in use when the process has
/// been idle for half a minute. There are two arenas for each processor: with one for two processors, a service did 293
/// small jobs a second in place of 370. Free memory at the end of an arena beyond 32 MiB is unmapped at once.
pub fn keep_between_jobs() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// Bytes.
        const MOST: libc::c_int = 32 << 20;
        glibc::set(2 * glibc::processors(), &[(libc::M_MMAP_THRESHOLD, MOST), (libc::M_TRIM_THRESHOLD, MOST)]);
        // if the thread cannot be started, memory is kept
        let _ = std::thread::Builder::new().name("memory".to_owned()).spawn(glibc::trim_when_quiet);
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the standard library has no way to the allocator's settings")]
mod glibc {
    use std::hint::black_box;
    use std::time::Duration;

    use libc::c_int;
    use rustix::process::{Resource, getrlimit};
    use rustix::time::{ClockId, clock_gettime};

    /// Least growth of an arena, in bytes: addresses, not memory in use.
    const GROWTH: c_int = 16 << 20;

    /// Addresses of the arena that large pages back, in bytes.
    const LARGE: usize = 1 << 30;

    /// A process is idle if it used less processor time than [`LITTLE`] in this time.
    const WHILE: Duration = Duration::from_secs(30);

    /// Processor time. Requests for `/healthz` and `/readyz` every second and `/metrics` every five take 40 ms.
    const LITTLE: Duration = Duration::from_millis(200);

    pub fn processors() -> usize {
        std::thread::available_parallelism().map_or(1, usize::from)
    }

    /// Applies settings, and the number of arenas.
    pub fn set(arenas: usize, settings: &[(c_int, c_int)]) {
        let arenas = c_int::try_from(arenas).unwrap_or(c_int::MAX);
        for &(parameter, value) in settings.iter().chain(&[(libc::M_TOP_PAD, GROWTH), (libc::M_ARENA_MAX, arenas)]) {
            // SAFETY: mallopt takes two integers and answers whether it knows the parameter and takes the value;
            // nothing depends on that. No other thread may allocate meanwhile: this runs at the start of the process,
            // before there is one.
            unsafe { libc::mallopt(parameter, value) };
        }
    }

    /// Lets the first arena grow by [`LARGE`] bytes of addresses, which the kernel then backs with pages of 2 MiB: one
    /// fault for each of them, in place of one for every 4 KiB. Nothing changes where addresses are limited or counted
    /// as memory (`vm.overcommit_memory`), and where large pages have another size.
    pub fn use_large_pages() {
        let is_limited = [Resource::As, Resource::Data].iter().any(|&limited| getrlimit(limited).current.is_some());
        let says = |path, value| std::fs::read_to_string(path).is_ok_and(|text: String| text.trim() == value);
        if is_limited
            || !says("/sys/kernel/mm/transparent_hugepage/hpage_pmd_size", "2097152")
            || says("/proc/sys/vm/overcommit_memory", "2")
        {
            return;
        }
        let mut block = Vec::<u8>::new();
        // SAFETY: as above.
        unsafe { libc::mallopt(libc::M_TOP_PAD, LARGE as c_int) };
        // more than is left of the arena, which grows behind it, and than the alignment takes
        let grown = block.try_reserve_exact(4 << 20);
        // SAFETY: as above.
        unsafe { libc::mallopt(libc::M_TOP_PAD, GROWTH) };
        if grown.is_ok() {
            let start = black_box(&block).as_ptr().addr().next_multiple_of(2 << 20);
            // SAFETY: the advice changes no content, and the kernel skips addresses that are not mapped.
            unsafe { libc::madvise(std::ptr::without_provenance_mut(start), LARGE, libc::MADV_HUGEPAGE) };
        }
    }

    /// Unmaps free memory once after each busy time.
    pub fn trim_when_quiet() {
        let mut is_due = false;
        let mut before = processor_time();
        loop {
            std::thread::sleep(WHILE);
            let now = processor_time();
            if now.saturating_sub(before) > LITTLE {
                is_due = true;
            } else if std::mem::take(&mut is_due) {
                // SAFETY: malloc_trim touches no memory that is in use, and any thread may call it at any time. It
                // answers whether there was anything to give.
                unsafe { libc::malloc_trim(0) };
            }
            before = now;
        }
    }

    /// Processor time of this process.
    fn processor_time() -> Duration {
        clock_gettime(ClockId::ProcessCPUTime).try_into().unwrap_or_default()
    }
}
