// Last step of an iteration of the refinement: labels follow what was decided, and a winner that was refused remembers it.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> labels: array<u32>;
@group(0) @binding(2) var<storage, read_write> offers: array<Offer>;
@group(0) @binding(3) var<storage, read_write> markets: array<Market>;
@group(0) @binding(4) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn commit_moves(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face == FREE {
        return;
    }
    let wanted = offers[face].cluster;
    if wanted == FREE {
        return;
    }
    let own = labels[face];
    if markets[own].dealt_in != turn.number || markets[own].target_cluster != wanted {
        return;
    }
    let verdict = markets[own].verdict;
    let is_winner = markets[own].winner == face;
    if verdict == ALL_MOVE || (verdict == WINNER_MOVES && is_winner) {
        labels[face] = wanted;
    } else if verdict == REFUSED && is_winner {
        offers[face].refused_in = turn.number;
    }
}
