// Optimal dual edges, second pass: of the cheapest dual edges of a cluster, the one with the smallest tie. `cost` is complete
// since `min_dual_edge_cost`; nothing here writes it.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> proxies: array<vec4<i32>>;
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(5) var<storage, read_write> choices: array<Choice>;
@group(0) @binding(6) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn min_dual_edge_tie(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face == FREE {
        return;
    }
    let own = labels[face];
    if own == FREE {
        return;
    }
    var best = 0u;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let other = labels[neighbours[at]];
        if other != own
            && other != FREE
            && ~packed_cost(own, other) == atomicLoad(&choices[own].cost)
        {
            best = max(best, ~tie_of(own, other));
        }
    }
    if best != 0u {
        atomicMax(&choices[own].tie, best);
    }
}
