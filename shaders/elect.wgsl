// Pieces, fourth step: of its largest pieces, a cluster keeps the one with the smallest face; where not all faces were searched,
// what is left outside of the pieces that are known whole, being larger. `best_bid` and `staying` are complete since `weigh` and
// `tally`; nothing here writes them.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read_write> parents: array<u32>;
@group(0) @binding(3) var<storage, read> sizes: array<u32>;
@group(0) @binding(4) var<storage, read_write> markets: array<Market>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn elect(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = searched_face(thread_number(turn, group, local));
    if face == FREE || parents[face] == FREE {
        return;
    }
    let root = parents[face];
    let own = labels[face];
    if root == face {
        let size = sizes[root];
        let is_all = lists.everywhere != 0u || atomicLoad(&clusters[own].staying) == 0u;
        if is_all && size == atomicLoad(&markets[own].best_bid) {
            atomicMin(&markets[own].best_face, face);
        }
        // it will be, when the others are cut off
        atomicStore(&clusters[own].whole, 1u);
    }
    if sizes[root] >= OPEN {
        // it stays
        parents[face] = FREE;
    }
}
