// Second step of an iteration: the faces that want to move do, and take their share of the sums along. Of a cluster that
// everybody wants to leave, the smallest face stays.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> wishes: array<u32>;
@group(0) @binding(3) var<storage, read_write> labels: array<u32>;
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(5) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(6) var<storage, read> neighbours: array<u32>;
@group(0) @binding(7) var<storage, read_write> origins: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> lists: Lists;

var<workgroup> moved: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn boundary_apply(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(turn, group, local);
    let face = listed_face(thread);
    if face != FREE {
        let wish = wishes[thread];
        if wish != FREE {
            let own = labels[face];
            // `staying` and `first_leaver` were completed by `boundary_propose`; nothing here writes them
            let last = atomicLoad(&clusters[own].staying) == 0u
                && atomicLoad(&clusters[own].first_leaver) == face;
            if !last {
                let sum = moment_of(faces[face]);
                let weight = weight_of(faces[face]);
                add_to_cluster(own, -sum, -weight, -1i);
                add_to_cluster(wish, sum, weight, 1i);
                atomicStore(&clusters[own].whole, 0u);
                labels[face] = wish;
                atomicAdd(&moved, 1u);
                // those of its neighbours that saw no other cluster see one now
                let end = neighbours[face + 1u];
                for (var at = neighbours[face]; at < end; at++) {
                    if claim(neighbours[at], own) {
                        add_newcomer(neighbours[at]);
                    }
                }
            }
        }
    }
    list_newcomers(local);
    if local == 0u {
        let here = atomicLoad(&moved);
        if here != 0u {
            atomicAdd(&ring[turn.slot].moves, here);
        }
    }
}
