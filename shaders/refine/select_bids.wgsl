// Second step: each cluster takes the smallest face of those that bid most.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> offers: array<Offer>;
@group(0) @binding(3) var<storage, read_write> markets: array<Market>;
@group(0) @binding(4) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(5) var<storage, read_write> lists: Lists;

var<workgroup> bidding: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn select_bids(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face != FREE {
        let offer = offers[face];
        if offer.cluster != FREE {
            let own = labels[face];
            if atomicLoad(&markets[own].best_bid) == offer.bid {
                atomicMin(&markets[own].best_face, face);
            }
            if atomicLoad(&markets[offer.cluster].best_bid) == offer.bid {
                atomicMin(&markets[offer.cluster].best_face, face);
            }
            atomicAdd(&bidding, 1u);
        }
    }
    workgroupBarrier();
    if local == 0u {
        let here = atomicLoad(&bidding);
        if here != 0u {
            atomicAdd(&ring[turn.slot].bids, here);
        }
    }
}
