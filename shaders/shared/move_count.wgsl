//! uses: stats
// Counts moves, one atomic addition to `stats` a workgroup.

var<workgroup> moves_here: atomic<u32>;

// Every thread of the workgroup must call this, after the last addition to `moves_here`.
fn add_moves(local: u32) {
    workgroupBarrier();
    if local == 0u {
        let here = atomicLoad(&moves_here);
        if here != 0u {
            atomicAdd(&stats[iteration.slot].moves, here);
        }
    }
}
