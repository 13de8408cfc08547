//! uses: boundary_list, stats
// Lists the faces that belong to another cluster than after the last merge, in any order, for the host; `stats` counts
// them. A face that moved is listed.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_at_merge: array<u32>;
@group(0) @binding(3) var<storage, read_write> moves: array<Move>;
@group(0) @binding(4) var<storage, read_write> stats: array<IterationStats>;
@group(0) @binding(5) var<storage, read_write> boundary_list: BoundaryList;

// Rust: layout::Move.
struct Move {
    face: u32,
    // Its clusters after the merge and now.
    before: u32,
    after: u32,
}

var<workgroup> moved_here: atomic<u32>;
var<workgroup> moved_before: u32;

@compute @workgroup_size(WORKGROUP)
fn moves_list(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(iteration, group, local));
    var before = 0u;
    var after = 0u;
    if face != FREE {
        before = label_at_merge[face];
        after = labels[face];
    }
    var place = 0u;
    if before != after {
        place = atomicAdd(&moved_here, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        moved_before = atomicAdd(&stats[iteration.slot].moves, atomicLoad(&moved_here));
    }
    workgroupBarrier();
    if before != after {
        moves[moved_before + place] = Move(face, before, after);
    }
}
