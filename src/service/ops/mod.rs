//! Health, traces, named faults, and small parts that many rooms use.

pub mod blocking;
pub mod faults;
pub mod health;
pub mod private;
pub mod timestamp;
pub mod trace;

/// A number of bytes in a file of `/proc`; none where the system has no such file or line.
pub(crate) fn proc_bytes(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}
