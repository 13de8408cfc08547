// First step of an iteration (P§3.2): every listed face compares its own cluster's proxy with those of its neighbours' clusters and
// writes down where it wants to go. Nothing that another thread reads here is written here.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> faces: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> labels: array<u32>;
@group(0) @binding(4) var<storage, read> proxies: array<vec4<i32>>;
@group(0) @binding(5) var<storage, read_write> wishes: array<u32>;
@group(0) @binding(6) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(7) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn boundary_propose(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(turn, group, local);
    let face = listed_face(thread);
    if face == FREE {
        return;
    }
    let own = labels[face];
    var best = FREE;
    if own != FREE {
        let here = faces[face];
        var best_distance = 0xfffffffffffffffflu;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let label = labels[neighbours[at]];
            if label != own && label != best && label != FREE {
                let distance = distance_squared(here, proxies[label]);
                if distance < best_distance || (distance == best_distance && label < best) {
                    best = label;
                    best_distance = distance;
                }
            }
        }
        if best != FREE {
            if best_distance < distance_squared(here, proxies[own]) {
                atomicSub(&clusters[own].staying, 1u);
                atomicMin(&clusters[own].first_leaver, face);
            } else {
                best = FREE;
            }
        }
    }
    wishes[thread] = best;
}
