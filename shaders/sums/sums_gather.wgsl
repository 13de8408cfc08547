//! uses: cluster_sums
//! reads: faces, labels
//! writes: clusters
// Sums of the clusters from labels; the host has cleared the sums. A thread takes a few faces in a row and adds up
// those with the same label before it touches global memory: neighbouring faces often have the same. Rust:
// device::plain::sums.

fn sums_gather(run: u32) {
    let first = run * RUN;
    let end = min(first + RUN, iteration.faces);
    var label = FREE;
    var sums = NO_SUMS;
    var count = 0i;
    for (var face = first; face < end; face++) {
        let next = labels[face];
        if next != label {
            if label != FREE {
                add_to_cluster(label, sums, count);
            }
            label = next;
            sums = NO_SUMS;
            count = 0i;
        }
        sums = sums_plus(sums, sums_of(faces[face]));
        count += 1i;
    }
    if label != FREE {
        add_to_cluster(label, sums, count);
    }
}
