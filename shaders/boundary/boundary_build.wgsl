//! uses: boundary_keep
// Lists the boundary faces, out of all faces, and those that moved since the last merge. `label_at_merge` is set for
// all.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read_write> label_at_merge: array<u32>;
@group(0) @binding(4) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(WORKGROUP)
fn boundary_build(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(iteration, group, local);
    var is_kept = false;
    if face < iteration.faces {
        is_kept = is_on_boundary(face) || label_at_merge[face] != labels[face];
        if !is_kept {
            label_at_merge[face] = UNLISTED;
        }
    }
    keep(local, face, is_kept);
}
