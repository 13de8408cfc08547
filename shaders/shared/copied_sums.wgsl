// Copies the sums of a cluster, for the host.
fn copy_sums(cluster: u32, place: u32) {
    for (var word = 0u; word < SUM_WORDS; word++) {
        copied_sums[place].sums[word] = atomicLoad(&clusters[cluster].sums[word]);
    }
    copied_sums[place].count = atomicLoad(&clusters[cluster].count);
}
