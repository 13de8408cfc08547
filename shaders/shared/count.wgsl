// Counts faces whose label changed, for one atomic addition to `stats` a workgroup.

var<workgroup> counted: atomic<u32>;

// Adds what the workgroup counted, and returns it to the first thread. Every thread of the workgroup must call this.
fn add_moves(local: u32) -> u32 {
    workgroupBarrier();
    var moves = 0u;
    if local == 0u {
        moves = atomicExchange(&counted, 0u);
        if moves != 0u {
            atomicAdd(&stats[iteration.slot].moves, moves);
        }
    }
    return moves;
}
