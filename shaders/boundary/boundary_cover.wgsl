//! uses: cover
// One thread: the indirect dispatches that follow go over all faces that are listed now.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read_write> next_dispatch: array<u32, 3>;
@group(0) @binding(2) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(1)
fn boundary_cover() {
    cover_list();
}
