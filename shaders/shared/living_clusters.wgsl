// The cluster of a thread, or FREE.
fn living_cluster(thread: u32) -> u32 {
    if thread >= iteration.clusters {
        return FREE;
    }
    return living_clusters[thread];
}
