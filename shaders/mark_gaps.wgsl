// Pieces in a hierarchy, after the search among listed faces: marks the gaps in the clusters as they were after the last
// merge, each in one piece. A gap is where faces left, with the pieces that are known to have been cut off.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> origins: array<u32>;
@group(0) @binding(3) var<storage, read> parents: array<u32>;
@group(0) @binding(4) var<storage, read_write> sizes: array<u32>;
@group(0) @binding(5) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(6) var<storage, read_write> gaps: array<u32>;
@group(0) @binding(7) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn mark_gaps(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face == FREE {
        return;
    }
    let before = origins[face];
    var gap = FREE;
    if before < UNLISTED && atomicLoad(&clusters[before].whole) == 0u {
        let root = parents[face];
        if before != labels[face] || (root != FREE && sizes[root] < OPEN) {
            gap = face;
            // the piece beside it, for `doubt`
            sizes[turn.faces + face] = FREE;
        }
    }
    gaps[face] = gap;
}
