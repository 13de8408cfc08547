// Pieces in a hierarchy, among listed faces: tells each cluster the largest of its pieces that are known whole, and how many
// faces are outside of those (`staying`).

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> parents: array<u32>;
@group(0) @binding(3) var<storage, read> sizes: array<u32>;
@group(0) @binding(4) var<storage, read_write> markets: array<Market>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn tally(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = searched_face(thread_number(turn, group, local));
    if face == FREE || parents[face] != face || sizes[face] >= OPEN {
        return;
    }
    atomicMax(&markets[labels[face]].best_bid, sizes[face]);
    atomicSub(&clusters[labels[face]].staying, sizes[face]);
}
