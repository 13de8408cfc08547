//! uses: copied_sums
//! reads: host_list
//! writes: clusters, copied_sums
// Copies the sums of the clusters of `host_list`, a thread each, for the host. Rust: device::sums_of.

fn sums_copy(entry: u32) {
    copy_sums(host_list[entry], entry);
}
