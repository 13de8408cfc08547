// Pieces, last step: the faces of the other pieces are free.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> parents: array<u32>;
@group(0) @binding(2) var<storage, read_write> markets: array<Market>;
@group(0) @binding(3) var<storage, read_write> labels: array<u32>;
@group(0) @binding(4) var<storage, read_write> ring: array<Slot>;

var<workgroup> freed: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn cut(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face < turn.faces {
        let root = parents[face];
        if root != FREE && atomicLoad(&markets[labels[face]].best_face) != root {
            labels[face] = FREE;
            atomicAdd(&freed, 1u);
        }
    }
    workgroupBarrier();
    if local == 0u {
        let here = atomicLoad(&freed);
        if here != 0u {
            atomicAdd(&ring[turn.slot].moves, here);
        }
    }
}
