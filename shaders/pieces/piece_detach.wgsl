// Pieces, last step: the faces of the other pieces are free, and listed.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> parents: array<u32>;
@group(0) @binding(2) var<storage, read_write> markets: array<Market>;
@group(0) @binding(3) var<storage, read_write> labels: array<u32>;
@group(0) @binding(4) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(5) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(6) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(7) var<storage, read_write> origins: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> lists: Lists;

var<workgroup> freed: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn piece_detach(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face < turn.faces {
        let root = parents[face];
        if root != FREE && atomicLoad(&markets[labels[face]].best_face) != root {
            let own = labels[face];
            labels[face] = FREE;
            add_to_cluster(own, -moment_of(faces[face]), -weight_of(faces[face]), -1i);
            // those beside it are of other clusters, and listed
            if claim(face, own) {
                add_newcomer(face);
            }
            atomicAdd(&freed, 1u);
        }
    }
    list_newcomers(local);
    if local == 0u {
        let here = atomicLoad(&freed);
        if here != 0u {
            atomicAdd(&ring[turn.slot].moves, here);
        }
    }
}
