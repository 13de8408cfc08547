// Last step of an iteration: proxies from sums, the energy of the new state, and an end to the iterations that are still
// queued when nothing moved. Forced, it also makes everything ready for a phase.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(2) var<storage, read_write> proxies: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read_write> markets: array<Market>;
@group(0) @binding(4) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(5) var<storage, read_write> next_dispatch: array<u32, 3>;
@group(0) @binding(6) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn proxies_fit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let thread = thread_number(turn, group, local);
    let cluster = living_cluster(thread);
    // complete since `boundary_apply`; nothing here writes it
    let live = turn.forced != 0u || atomicLoad(&ring[turn.slot].moves) != 0u;
    if thread == 0u {
        if live {
            cover_list();
        } else {
            cover_nothing();
        }
    }
    var energy = Wide(0li, 0li);
    var shift = 0u;
    if live && cluster != FREE {
        let weight = weight_in(cluster);
        if weight != 0li {
            let sum = sum_of(cluster);
            let proxy = proxy_of(sum, weight);
            energy = explained_by(proxy, sum, weight);
            shift = u32(proxies[cluster].w);
            proxies[cluster] = vec4<i32>(i32(proxy.x), i32(proxy.y), i32(proxy.z), i32(shift));
        }
        atomicStore(&clusters[cluster].staying, atomicLoad(&clusters[cluster].count));
        atomicStore(&clusters[cluster].first_leaver, FREE);
        if turn.forced != 0u {
            atomicStore(&markets[cluster].best_bid, 0u);
            atomicStore(&markets[cluster].best_face, FREE);
            markets[cluster].dealt_in = 0u;
            markets[cluster].changed_in = 0u;
        }
    }
    report_energy(local, energy, shift);
}
