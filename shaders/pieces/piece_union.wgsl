//! uses: piece_tree
// Second step, a thread a face: for each two neighbours of a cluster, the larger root of their trees becomes a child of
// the smaller. In whatever order threads run, each tree ends as a whole piece with its smallest face as root. A thread
// whose exchange fails looks for the root again; a root changes once at most.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> parents: array<atomic<u32>>;

@compute @workgroup_size(WORKGROUP)
fn piece_union(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(iteration, group, local);
    if face >= iteration.faces || atomicLoad(&parents[face]) == FREE {
        return;
    }
    let own = labels[face];
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let near = neighbours[at];
        if near < face && labels[near] == own {
            var a = root_of(face);
            var b = root_of(near);
            while a != b {
                let high = max(a, b);
                let low = min(a, b);
                if atomicCompareExchangeWeak(&parents[high], high, low).exchanged {
                    break;
                }
                a = root_of(high);
                b = root_of(low);
            }
        }
    }
}
