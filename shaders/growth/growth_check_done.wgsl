//! uses: iteration, stats
// Last step of a pass of the growth, one thread: if no face was labelled, the passes that are still queued get no
// workgroups.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(2) var<storage, read_write> next_dispatch: array<u32, 3>;

@compute @workgroup_size(1)
fn growth_check_done() {
    if atomicLoad(&stats[iteration.slot].moves) == 0u {
        next_dispatch = array<u32, 3>(0u, 0u, 0u);
    }
}
