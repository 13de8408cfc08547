// Pieces in a hierarchy, a thread a cluster: where there are doubts, all that the search among listed faces found is forgotten,
// and what is queued for a search among all faces gets its workgroups.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> markets: array<Market>;
@group(0) @binding(2) var<storage, read_write> next_dispatch: array<u32, 3>;
@group(0) @binding(3) var<storage, read_write> second_search: array<u32, 3>;
@group(0) @binding(4) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn decide(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(turn, group, local);
    let cluster = living_cluster(thread);
    // complete since `doubt`; nothing here writes it
    let in_doubt = atomicLoad(&lists.doubts) != 0u;
    if thread == 0u {
        second_search = array<u32, 3>(0u, 0u, 0u);
        if in_doubt {
            lists.everywhere = 1u;
            second_search = cover(turn.faces);
            next_dispatch = second_search;
        }
    }
    if in_doubt && cluster != FREE {
        atomicStore(&markets[cluster].best_bid, 0u);
    }
}
