//! reads: merged_into
//! writes: labels, label_at_merge
// A merge (P§5.4), second step, a thread a face: faces follow their clusters, and `label_at_merge` of listed faces is
// set. Rust: device::merge.

fn merge_relabel(face: u32) {
    var label = labels[face];
    if label == FREE {
        return;
    }
    // a label names a cluster that was left before this merge, so one step is enough
    let into = merged_into[label];
    if into != 0u {
        label = into - 1u;
        labels[face] = label;
    }
    if atomicLoad(&label_at_merge[face]) != UNLISTED {
        atomicStore(&label_at_merge[face], label);
    }
}
