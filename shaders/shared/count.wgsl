// Counts in a workgroup, for one atomic addition to `stats` a workgroup.

var<workgroup> counted: atomic<u32>;

// What the workgroup counted, for its first thread; 0 for the others. Every thread of the workgroup must call this.
fn counted_here(local: u32) -> u32 {
    workgroupBarrier();
    return select(0u, atomicLoad(&counted), local == 0u);
}

// Adds what the workgroup counted to the faces whose label changed. Every thread of the workgroup must call this.
fn add_moves(local: u32) {
    let moves = counted_here(local);
    if moves != 0u {
        atomicAdd(&stats[iteration.slot].moves, moves);
    }
}
