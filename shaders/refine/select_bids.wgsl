//! uses: boundary_list, bids, stats
// Second step, a thread a listed face: each cluster takes the smallest face of those with its best bid.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> face_bids: array<FaceBid>;
@group(0) @binding(3) var<storage, read_write> cluster_bids: array<ClusterBids>;
@group(0) @binding(4) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(5) var<storage, read_write> boundary_list: BoundaryList;

var<workgroup> bids_here: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn select_bids(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(iteration, group, local));
    if face != FREE {
        let bid = face_bids[face];
        if bid.cluster != FREE {
            let own = labels[face];
            if atomicLoad(&cluster_bids[own].best_bid) == bid.bid {
                atomicMin(&cluster_bids[own].best_face, face);
            }
            if atomicLoad(&cluster_bids[bid.cluster].best_bid) == bid.bid {
                atomicMin(&cluster_bids[bid.cluster].best_face, face);
            }
            atomicAdd(&bids_here, 1u);
        }
    }
    workgroupBarrier();
    if local == 0u {
        let here = atomicLoad(&bids_here);
        if here != 0u {
            atomicAdd(&stats[iteration.slot].bids, here);
        }
    }
}
