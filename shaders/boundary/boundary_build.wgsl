// Lists the faces on boundaries, out of all, and those that moved since the last merge. All have origins.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> origins: array<u32>;
@group(0) @binding(4) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn boundary_build(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    var is_kept = false;
    if face < turn.faces {
        is_kept = is_on_boundary(face) || origins[face] != labels[face];
        if !is_kept {
            origins[face] = UNLISTED;
        }
    }
    keep(local, face, is_kept);
}
