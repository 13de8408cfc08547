// Pieces, second step: for each two searched neighbours of a cluster, the root of the one tree is hooked to the root of the
// other, the larger to the smaller. So each tree ends as a whole piece with its smallest face as root, whoever comes first;
// who finds that somebody else hooked the root meanwhile looks for it again, and that happens once a root at most.
//
// The same for gaps (`mark_gaps`), where the clusters are those that faces left.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> cluster_of_face: array<u32>;
@group(0) @binding(3) var<storage, read_write> parents: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read> origins: array<u32>;
@group(0) @binding(5) var<storage, read_write> lists: Lists;

// Whether a face has a place in a tree.
fn is_searched(face: u32) -> bool {
    return (lists.everywhere != 0u || origins[face] != UNLISTED) && atomicLoad(&parents[face]) != FREE;
}

@compute @workgroup_size(WORKGROUP)
fn hook(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = searched_face(thread_number(turn, group, local));
    if face == FREE || atomicLoad(&parents[face]) == FREE {
        return;
    }
    let own = cluster_of_face[face];
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let near = neighbours[at];
        if near < face && cluster_of_face[near] == own && is_searched(near) {
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
