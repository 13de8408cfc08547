// The faces that `boundary_build` or `boundary_compact` kept are the list from now on. When a phase has ended, the `boundary_compact` of a batch that was
// queued had no workgroups, and the list stays.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> lists: Lists;
@group(0) @binding(2) var<storage, read_write> next_dispatch: array<u32, 3>;

@compute @workgroup_size(1)
fn boundary_publish() {
    if turn.forced != 0u || next_dispatch[0] != 0u {
        atomicStore(&lists.length, atomicExchange(&lists.kept, 0u));
        lists.first = turn.faces - lists.first;
        cover_list();
    }
}
