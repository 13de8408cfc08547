// Optimal dual edges, last step, a thread a cluster: lists those that have one, for the host, and clears the
// choices for the next search.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> choices: array<Choice>;
@group(0) @binding(2) var<storage, read_write> found: array<Found>;
@group(0) @binding(3) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(4) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn dual_edges_publish(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let cluster = living_cluster(thread_number(turn, group, local));
    var cost = 0u;
    if cluster != FREE {
        cost = atomicLoad(&choices[cluster].cost);
    }
    let place = place_in_list(local, cost != 0u);
    if cost != 0u {
        found[place] = Found(cluster, ~atomicLoad(&choices[cluster].other), ~cost);
        atomicStore(&choices[cluster].cost, 0u);
        atomicStore(&choices[cluster].tie, 0u);
        atomicStore(&choices[cluster].other, 0u);
    }
}
