//! uses: boundary_list, cluster, energy
// First step of an iteration of the boundary phase (P§3.2), a thread a listed face: compares the proxy of the face's
// cluster with those of its neighbours' clusters and stores the nearest.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> faces: array<Face>;
@group(0) @binding(2) var<storage, read> neighbours: array<u32>;
@group(0) @binding(3) var<storage, read> labels: array<u32>;
@group(0) @binding(4) var<storage, read> proxies: array<Proxy>;
@group(0) @binding(5) var<storage, read_write> wanted_clusters: array<u32>;
@group(0) @binding(6) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(7) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn boundary_propose(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(iteration, group, local);
    let face = listed_face(thread);
    if face == FREE {
        return;
    }
    let own = labels[face];
    var best = FREE;
    if own != FREE {
        let here = faces[face];
        var best_cost = 0xfffffffffffffffflu;
        let end = neighbours[face + 1u];
        for (var at = neighbours[face]; at < end; at++) {
            let label = labels[neighbours[at]];
            if label != own && label != best && label != FREE {
                let next = cost(here, proxies[label]);
                if next < best_cost || (next == best_cost && label < best) {
                    best = label;
                    best_cost = next;
                }
            }
        }
        if best != FREE {
            if best_cost < cost(here, proxies[own]) {
                atomicSub(&clusters[own].staying, 1u);
                atomicMin(&clusters[own].first_leaver, face);
            } else {
                best = FREE;
            }
        }
    }
    wanted_clusters[thread] = best;
}
