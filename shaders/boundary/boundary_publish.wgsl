//! uses: cover
// One thread: the faces that `boundary_build` or `boundary_compact` kept become the list. After the end of a phase, the
// `boundary_compact` of a batch that is still queued has no workgroups, and the list stays.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read_write> next_dispatch: array<u32, 3>;
@group(0) @binding(2) var<storage, read_write> boundary_list: BoundaryList;

@compute @workgroup_size(1)
fn boundary_publish() {
    if iteration.between != 0u || next_dispatch[0] != 0u {
        atomicStore(&boundary_list.length, atomicExchange(&boundary_list.kept, 0u));
        boundary_list.first = iteration.faces - boundary_list.first;
        cover_list();
    }
}
